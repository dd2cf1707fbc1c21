"""Segmentation: class tables, readers of real data, nets, their weights, training, metrics.

Names are imported on first use, so that reading data does not load JAX. The functions `train` and
`augment` share their name with their module: `from seg.train import train`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from shell.interrupt import while_loading

while_loading(__name__)  # before all else

if TYPE_CHECKING:
    from seg.classes import (
        CAMVID_11,
        CITYSCAPES_19,
        IGNORE_LABEL,
        LABELMEFACADE_6,
        SYNTHIA_13,
        SYNTHIA_16,
        ClassTable,
        class_table,
    )
    from seg.data import (
        Entry,
        RealSet,
        list_camvid,
        list_cityscapes,
        list_folders,
        list_labelmefacade,
        load,
        read_camvid,
        read_cityscapes,
        read_folders,
        read_labelmefacade,
    )
    from seg.errors import DataError, WeightsError
    from seg.losses import class_weights, cross_entropy
    from seg.metrics import absent_classes, confusion_matrix, iou, mean_iou
    from seg.nets import net
    from seg.recipes import RECIPES
    from seg.settings import TrainSettings, check_settings
    from seg.train import TrainingError, predict, score

__all__ = [
    "CAMVID_11",
    "CITYSCAPES_19",
    "IGNORE_LABEL",
    "LABELMEFACADE_6",
    "RECIPES",
    "SYNTHIA_13",
    "SYNTHIA_16",
    "ClassTable",
    "DataError",
    "Entry",
    "RealSet",
    "TrainSettings",
    "TrainingError",
    "WeightsError",
    "absent_classes",
    "check_settings",
    "class_table",
    "class_weights",
    "confusion_matrix",
    "cross_entropy",
    "iou",
    "list_camvid",
    "list_cityscapes",
    "list_folders",
    "list_labelmefacade",
    "load",
    "mean_iou",
    "net",
    "predict",
    "read_camvid",
    "read_cityscapes",
    "read_folders",
    "read_labelmefacade",
    "score",
]
_HOMES = ("classes", "errors", "data", "metrics", "settings", "recipes", "losses", "nets", "train")
"""Where the names are; those that need JAX come last."""


def __getattr__(name: str) -> Any:
    for home in _HOMES if name in __all__ else ():
        module = import_module(f"seg.{home}")
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module 'seg' has no attribute {name!r}")
