"""Class tables: names, colours, and the map from the engine's classes to a table's ids.

A table's ids are 0 .. len(classes) - 1; `IGNORE_LABEL` marks ignored pixels. Every array of labels inside the
package holds table ids. Renderers write Cityscapes train ids; `from_train_id` maps those.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import msgspec
import numpy as np
from jaxtyping import UInt8

from common.labels.classes import Outline
from common.labels.target_file import SHIPPED, TargetFile, shipped
from common.labels.target_file import find_target as find_target

IGNORE_LABEL = 255


@dataclass(frozen=True, eq=False)
class ClassTable:
    """One set of classes to segment, and how labels of renders map onto it.

    Attributes:
        name: the name of the target that has these classes.
        classes: class names, in the order of the ids.
        colors: u8[classes, 3], RGB for images.
        from_train_id: u8[256], Cityscapes train id -> id of this table, or `IGNORE_LABEL`.
        outlines: of the classes that are drawn as a whole.
    """

    name: str
    classes: tuple[str, ...]
    colors: UInt8[np.ndarray, "classes 3"]
    from_train_id: UInt8[np.ndarray, "256"]
    outlines: tuple[Outline, ...] = ()


def table_of(target: TargetFile) -> ClassTable:
    """The classes of a target."""
    colors = np.array(target.palette, np.uint8)
    from_train_id = np.full(256, IGNORE_LABEL, np.uint8)
    from_train_id[: len(target.of_engine)] = target.of_engine
    for array in (colors, from_train_id):
        array.flags.writeable = False
    return ClassTable(
        target.name, target.class_names, colors, from_train_id, target.engine_outlines
    )


def table_text(target: TargetFile) -> str:
    """The text by which `class_table` finds a target: its name if the package has its file, else its file."""
    if target.name in SHIPPED and target == shipped(target.name):
        return target.name
    fields = msgspec.to_builtins(target)
    if not target.outlines:
        del fields["outlines"]  # evaluations of targets without any keep their keys
    return msgspec.json.encode(fields).decode()


@lru_cache
def class_table(name: str) -> ClassTable:
    """The classes of a target.

    Args:
        name: a target whose file comes with the package, such as "cityscapes"; or a text of `table_text`.

    Raises:
        ValueError: no target has that name; the message lists those that exist.
    """
    if name.startswith("{"):
        return table_of(msgspec.json.decode(name, type=TargetFile))
    if name not in SHIPPED:
        raise ValueError(f"unknown class table {name!r}; known tables: {', '.join(SHIPPED)}")
    return table_of(shipped(name))


def colorize(labels: np.ndarray, colors: Sequence[Sequence[int]] | np.ndarray) -> np.ndarray:
    """Labels u8[*shape] as RGB u8[*shape, 3]; ignored pixels are black.

    Args:
        labels: ids of classes.
        colors: RGB of each class.
    """
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(colors)] = colors
    return palette[labels]


CITYSCAPES_19, CAMVID_11, LABELMEFACADE_6 = map(
    class_table, ("cityscapes", "camvid", "labelmefacade")
)

SYNTHIA_16 = tuple(
    k for k in range(19) if CITYSCAPES_19.classes[k] not in ("terrain", "truck", "train")
)
SYNTHIA_13 = tuple(
    k for k in SYNTHIA_16 if CITYSCAPES_19.classes[k] not in ("wall", "fence", "pole")
)
"""Cityscapes ids of the 16 and 13 classes over which networks trained on SYNTHIA are compared."""
