"""The formats by name, and where each keeps the files of an image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from scene.dataset.formats import cityscapes, coco

FORMATS: tuple[str, ...] = ("cityscapes", "coco")
SPLITS: tuple[str, ...] = ("train", "val")


class Layout(NamedTuple):
    """One format."""

    files: dict[str, str]  # kind -> path, with {split} and {stem}
    summaries: Callable[[str], dict[str, str]]  # split -> name -> path
    summary_text: Callable[[str, str, coco.Records, tuple[int, int]], Iterator[str]]

    def paths(self, split: str, stem: str) -> dict[str, str]:
        """Kind -> path of one image's files, relative to the dataset."""
        return {kind: path.format(split=split, stem=stem) for kind, path in self.files.items()}


def layout(name: str) -> Layout:
    """The format called ``name``.

    Raises:
        ValueError: unknown name.
    """
    if name not in FORMATS:
        raise ValueError(f"unknown format {name!r}; known: {', '.join(FORMATS)}")
    module = coco if name == "coco" else cityscapes
    return Layout(module.FILES, module.summaries, module.summary_text)


def stem(street: int, shot: int) -> str:
    """The name of one image, as Cityscapes would name a frame of a sequence."""
    return f"{cityscapes.CITY}_{street:06d}_{shot:06d}"
