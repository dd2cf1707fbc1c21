"""The classes of label images: the engine's, or a target's in its own ids or colours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from common.errors import UserError
from common.labels.classes import CLASSES, Outline
from common.labels.classes import OWN as OWN_ROW
from scene.classes import CLASS_NAMES, OWN, VOID, check_class_name
from scene.dataset.formats.segments import is_thing

if TYPE_CHECKING:
    from common.labels.target_file import TargetFile

ILLEGAL = 254
"""Class of invalid values in label images; a target has fewer classes."""


class Labels(NamedTuple):
    """Classes by index, and their values in label images."""

    names: tuple[str, ...]
    of_engine: np.ndarray  # u8[256], train id -> class, VOID
    values: np.ndarray  # u8 or u16[256] ids, or u8[256, 3] colours, of each class and of VOID
    colours: np.ndarray  # u8[256, 3] for display, VOID is black
    things: tuple[int, ...]  # classes with instances
    outlines: tuple[Outline, ...] = ()  # classes with closed outlines

    @property
    def rendered(self) -> tuple[str, ...]:
        """The classes of streets by train id: the engine's, and the user's own if there is one."""
        own_class = int(self.of_engine[OWN])
        return CLASS_NAMES if own_class == VOID else (*CLASS_NAMES, self.names[own_class])

    @property
    def category_ids(self) -> list[int]:
        """The id of each class in COCO's files: that in label images, or 1, 2, ... if they have colours."""
        ids = self.values if self.values.ndim == 1 else np.arange(1, 257)
        return ids[: len(self.names)].tolist()

    @property
    def all_values(self) -> list[tuple[Any, str]]:
        """The values of label images with class names: an id, or red, green and blue."""
        places = [*range(len(self.names)), VOID]
        return list(zip(self.values[places].tolist(), (*self.names, "void"), strict=True))

    def classes_of(self, label_image: np.ndarray) -> np.ndarray:
        """Classes u8[h, w] of a label image, `ILLEGAL` for invalid values."""
        coloured = self.values.ndim == 2
        codes = _codes(self.values, coloured).tolist()
        class_of = {codes[VOID]: VOID, **{codes[k]: k for k in range(len(self.names))}}
        values, places = np.unique(_codes(label_image, coloured), return_inverse=True)
        classes = np.array([class_of.get(value, ILLEGAL) for value in values.tolist()], np.uint8)
        return classes[places].reshape(label_image.shape[:2])


def _codes(values: np.ndarray, coloured: bool) -> np.ndarray:
    """Return ids unchanged, and colours [..., 3] as one number each."""
    if not coloured:
        return values.astype(np.int32)
    return values.astype(np.int32) @ np.array([1, 256, 65536], np.int32)


def _table(rows: Any, void: Any, dtype: Any) -> np.ndarray:
    """Make a table with a value for each class, and ``void`` for all other indices."""
    table = np.empty((256, *np.shape(void)), dtype)
    table[:] = void
    table[: len(rows)] = rows
    table.setflags(write=False)
    return table


def engine_labels(published: bool, own_class: str | None = None) -> Labels:
    """The engine's 19 classes, with the ids of Cityscapes or train ids.

    Args:
        published: whether label images hold labelIds and 0 for ignored pixels, or train ids and 255.
        own_class: name of the user's own class, if any, which becomes the 20th.

    Raises:
        UserError: the name is invalid.
    """
    rows = (
        CLASSES
        if own_class is None
        else (*CLASSES, OWN_ROW._replace(name=check_class_name(own_class)))
    )
    ids = np.arange(len(rows))
    return Labels(
        tuple(row.name for row in rows),
        _table(ids, VOID, np.uint8),
        _table(
            [row.file_id for row in rows] if published else ids, 0 if published else VOID, np.uint8
        ),
        _table([row.colour for row in rows], (0, 0, 0), np.uint8),
        tuple(k for k in range(len(rows)) if is_thing(k)),
    )


def target_entry(target: TargetFile | str | Path) -> dict[str, Any]:
    """The entry of a target in ``dataset.json``, which `target_labels` reads.

    Classes and ignored pixels get the first of their ids or colours, or a free one if they have none. If
    label files hold names, the value is the class's index.

    Raises:
        UserError: the target does not exist, or the engine renders none of its classes.
    """
    from common.labels.target_file import find_target  # workers do not need it

    if isinstance(target, str | Path):
        target = find_target(target)
    if not any(target.rendered):
        raise UserError(
            f"target {target.name}: none of its classes is rendered, so all pixels would be ignored; add "
            "'renders' to the classes in its file"
        )
    names, kind = target.class_names, target.kind
    own: list[list[Any]] = [[k] for k in range(len(names))]
    void: list[Any] = []
    if kind != "names":
        own = [list(getattr(target_class, kind)) for target_class in target.classes.values()]
        void = list(target.void)
    used = {value for values in (*own, void) for value in values}
    every = ((k, k, k) for k in range(256)) if kind == "colours" else (255, *range(65536))
    free = (value for value in every if value not in used)
    ignored, *values = (values[0] if values else next(free) for values in (void, *own))
    return {
        "name": target.name,
        "void": _plain(ignored),
        "classes": [
            {"name": name, "value": _plain(value), "colour": list(colour),
             "renders": [n for n, k in zip(CLASS_NAMES, target.of_engine, strict=True) if k == number]}
            | ({"outline": target.outlines[name]} if name in target.outlines else {})
            for number, (name, value, colour) in enumerate(
                zip(names, values, target.palette, strict=True)
            )
        ],
    }  # fmt: skip


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def target_labels(entry: Any) -> Labels:
    """The classes of a target from its entry in ``dataset.json``.

    Raises:
        ValueError: it does not have the form of `target_entry`.
    """
    try:
        rows, void = entry["classes"], entry["void"]
        names = tuple(str(row["name"]) for row in rows)
        renders = [[CLASS_NAMES.index(name) for name in row["renders"]] for row in rows]
        values, colours = [row["value"] for row in rows], [row["colour"] for row in rows]
        shape = np.shape(void)
        numbers = np.array([*values, void])
        bound = 65535 if shape == () else 255
        is_valid = shape in ((), (3,)) and numbers.dtype.kind == "i" and 0 < len(rows) < ILLEGAL
        if (
            not is_valid
            or numbers.min() < 0
            or numbers.max() > bound
            or len(set(names)) < len(names)
        ):
            raise ValueError("classes, values or colours")
        outlines = tuple(
            Outline(tuple(train_ids), float(row["outline"]))
            for row, train_ids in zip(rows, renders, strict=True)
            if "outline" in row
        )
        if not all(0 < outline.width < 1 for outline in outlines):
            raise ValueError("outlines")
        of_engine = np.full(256, VOID, np.uint8)
        for k, train_ids in enumerate(renders):
            of_engine[train_ids] = k
        return Labels(
            names,
            of_engine,
            _table(values, void, np.uint8 if numbers.max() < 256 else np.uint16),
            _table(colours, (0, 0, 0), np.uint8),
            tuple(k for k, ids in enumerate(renders) if ids and all(map(is_thing, ids))),
            outlines,
        )
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"the entry of the target is damaged: {error}") from None


def refuse_with_target(own_class: str, target: str) -> None:
    """Raise UserError, since a target's labels cannot hold a user's own class."""
    raise UserError(
        f"own class {own_class!r} cannot be combined with target {target}, whose labels have no such class; "
        "remove one of them"
    )


def labels_of(description: dict[str, Any], published: bool) -> Labels:
    """The classes of a dataset with this ``dataset.json``; raises as `target_labels`."""
    if description.get("target") is None:
        own_class = description.get("own_class")
        return engine_labels(published, None if own_class is None else str(own_class["name"]))
    return target_labels(description["target"])
