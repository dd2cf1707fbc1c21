"""An open run folder with its target, workers, stores and progress: ``session.open(config)``."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
