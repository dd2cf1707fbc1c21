from .app.functions import Fitted as Fitted
from .app.functions import Reward as Reward
from .app.functions import Score as Score
from .app.functions import Searched as Searched
from .app.functions import fit as fit
from .app.functions import reward as reward
from .app.functions import search as search
