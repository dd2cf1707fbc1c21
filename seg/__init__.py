"""Segmentation: class tables, readers of real data, nets, their weights, training, metrics.

Names are imported on first use, so that reading data does not load JAX. The functions `train` and
`augment` share their name with their module: `from seg.train import train`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seg.classes import (
        CAMVID_11,
        CITYSCAPES_19,
        IGNORE_LABEL,
        SYNTHIA_13,
        SYNTHIA_16,
        ClassTable,
        class_table,
    )
    from seg.data import (
        DataError,
        Entry,
        RealSet,
        list_camvid,
        list_cityscapes,
        list_folders,
        load,
        read_camvid,
        read_cityscapes,
        read_folders,
    )
    from seg.losses import class_weights, cross_entropy
    from seg.metrics import absent_classes, confusion_matrix, iou, mean_iou
    from seg.nets import net
    from seg.recipes import RECIPES
    from seg.settings import TrainSettings, check_settings
    from seg.train import TrainingError, predict, score
    from seg.weights import WeightsError

_HOMES = {
    "seg.classes": (
        "CAMVID_11",
        "CITYSCAPES_19",
        "IGNORE_LABEL",
        "SYNTHIA_13",
        "SYNTHIA_16",
        "ClassTable",
        "class_table",
    ),
    "seg.data": (
        "DataError",
        "Entry",
        "RealSet",
        "list_camvid",
        "list_cityscapes",
        "list_folders",
        "load",
        "read_camvid",
        "read_cityscapes",
        "read_folders",
    ),
    "seg.losses": ("class_weights", "cross_entropy"),
    "seg.metrics": ("absent_classes", "confusion_matrix", "iou", "mean_iou"),
    "seg.nets": ("net",),
    "seg.recipes": ("RECIPES",),
    "seg.settings": ("TrainSettings", "check_settings"),
    "seg.train": ("TrainingError", "predict", "score"),
    "seg.weights": ("WeightsError",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "CAMVID_11",
    "CITYSCAPES_19",
    "IGNORE_LABEL",
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
    "load",
    "mean_iou",
    "net",
    "predict",
    "read_camvid",
    "read_cityscapes",
    "read_folders",
    "score",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'seg' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
