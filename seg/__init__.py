"""Segmentation: class tables, readers of real data, nets, their weights, training, metrics.

Names are imported on first use, so that reading data does not load JAX; `__init__.pyi` lists them. The
functions `train` and `augment` share their name with their module: `from seg.train import train`.
"""

from shell.interrupt import while_loading
from shell.lazy import import_on_use

while_loading(__name__)  # before all else
__all__ = import_on_use(__name__)
