"""What a job can be told, its defaults by target and preset, what is refused, and its command line."""

from .check import check as check
from .check import check_net as check_net
from .check import refuse_share as refuse_share
from .check import refuse_unstarted as refuse_unstarted
from .config import NETS as NETS
from .config import BinsConfig as BinsConfig
from .config import Config as Config
from .config import FewConfig as FewConfig
from .config import GroupsConfig as GroupsConfig
from .config import LearntConfig as LearntConfig
from .config import MainConfig as MainConfig
from .config import NetsConfig as NetsConfig
from .config import Preset as Preset
from .config import Rederived as Rederived
from .config import SearchConfig as SearchConfig
from .config import TargetName as TargetName
from .config import TwinName as TwinName
from .config import fidelities as fidelities
from .method import make_method as make_method
from .method import make_space as make_space
from .method import read_attributes as read_attributes
from .method import start_of as start_of
from .options import Fidelity as Fidelity
from .options import MethodOptions as MethodOptions
from .options import Search as Search
