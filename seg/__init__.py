"""Segmentation: class tables, readers of real data, networks, their weights, training, metrics.

Names are imported on first use, so that reading data does not load JAX; `__init__.pyi` lists them. `train` is
the function; its module is `seg.train`, as in `from seg.train import TrainingError`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
