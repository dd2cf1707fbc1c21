"""The one way into a run folder."""

from .session import Session as Session
from .session import Work as Work
from .session import open as open
