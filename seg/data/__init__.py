"""Real labelled images, listed and read as their target's file describes them."""

from common.labels.listing import Entry, list_split
from seg.data.labelled import (
    LabelledImages,
    TargetData,
    fitted,
    load,
    read_split,
    read_target,
    refuse_shared,
    subset,
)
from seg.data.labels import LabelReader
from seg.errors import DataError

__all__ = [
    "DataError",
    "Entry",
    "LabelReader",
    "LabelledImages",
    "TargetData",
    "fitted",
    "list_split",
    "load",
    "read_split",
    "read_target",
    "refuse_shared",
    "subset",
]
