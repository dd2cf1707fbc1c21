"""The configuration of a job: its fields, defaults by target and preset, checks, and command line.

Names are imported on first use, so that help loads no network and no search; ``__init__.pyi`` lists them.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
