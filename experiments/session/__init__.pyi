"""The one way into a run folder."""

from .session import Session, Work, open

__all__ = ["Session", "Work", "open"]
