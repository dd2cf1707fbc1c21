"""The table of formats, with the paths of an image's files and the summary files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from common.errors import UserError, hint
from scene.dataset.formats import card, coco, parquet, yolo
from scene.dataset.formats.about import CITY, About

SPLITS: tuple[str, ...] = ("train", "val")


class Summary(NamedTuple):
    """A summary file about all images."""

    path: str  # with {split}
    text: Callable[[About], Iterator[str]]  # in pieces


class Layout(NamedTuple):
    """One format; paths are relative to the dataset."""

    files: dict[str, str]  # kind -> path, with {split} and {stem}
    summaries: dict[str, Summary]
    published: bool = True  # label images hold Cityscapes' labelIds; otherwise train ids
    packages: tuple[str, ...] = ()  # required packages (the extra parquet)
    pack: Callable[[Path, About], None] | None = None  # makes other files from those of the images

    def check(self) -> None:
        """Raise UserError if a package is missing."""
        for package in self.packages:
            try:
                import_module(package)
            except ImportError as error:
                raise UserError(
                    f"format parquet needs {package}: pip install 'sdr-jax[parquet]' ({error})"
                ) from None

    def paths(self, split: str, stem: str) -> dict[str, str]:
        """Kind -> path of one image's files."""
        return {kind: path.format(split=split, stem=stem) for kind, path in self.files.items()}

    def summary_paths(self, split: str) -> dict[str, str]:
        """Name -> path of each summary file."""
        return {name: summary.path.format(split=split) for name, summary in self.summaries.items()}


CARD = Summary("README.md", card.card)
_GT_FINE = f"gtFine/{{split}}/{CITY}/{{stem}}_gtFine"
_IMAGE = f"leftImg8bit/{{split}}/{CITY}/{{stem}}_leftImg8bit.png"
LAYOUTS: dict[str, Layout] = {
    # ``leftImg8bit``, ``gtFine``, ``disparity`` and ``camera`` are as published; the others are ours.
    "cityscapes": Layout(
        {
            "image": _IMAGE,
            "label_ids": f"{_GT_FINE}_labelIds.png",
            "train_ids": f"{_GT_FINE}_labelTrainIds.png",
            "instance_ids": f"{_GT_FINE}_instanceIds.png",
            "color": f"{_GT_FINE}_color.png",
            "panoptic": "gtFine/cityscapes_panoptic_{split}/{stem}_gtFine_panoptic.png",
            "depth": f"depth/{{split}}/{CITY}/{{stem}}_depth.png",
            "disparity": f"disparity/{{split}}/{CITY}/{{stem}}_disparity.png",
            "normals": f"normals/{{split}}/{CITY}/{{stem}}_normals.png",
            "camera": f"camera/{{split}}/{CITY}/{{stem}}_camera.json",
        },
        {
            "instances": Summary(
                "annotations/instances_{split}.json", partial(coco.instances, file_name=_IMAGE)
            ),
            "panoptic": Summary(
                "gtFine/cityscapes_panoptic_{split}.json",
                partial(
                    coco.panoptic,
                    # The doubled name is that of Cityscapes' script, which its readers expect.
                    file_name="{stem}_gtFine_leftImg8bit.png",
                    segments="{stem}_gtFine_panoptic.png",
                    by_stem=True,
                ),
            ),
            "card": CARD,
        },
    ),
    "coco": Layout(
        {
            "image": "images/{stem}.png",
            "panoptic": "panoptic/{stem}.png",
            "depth": "depth/{stem}.png",
            "normals": "normals/{stem}.png",
            "camera": "camera/{stem}.json",
        },
        {
            "instances": Summary(
                "annotations/instances.json", partial(coco.instances, file_name="{stem}.png")
            ),
            "panoptic": Summary("annotations/panoptic.json", coco.panoptic),
            "semantic": Summary(
                "annotations/semantic.json", partial(coco.semantic, file_name="{stem}.png")
            ),
            "card": CARD,
        },
    ),
    "folders": Layout(
        {"image": "images/{stem}.png", "label_ids": "masks/{stem}.png"},
        {
            "classes": Summary("classes.txt", card.class_list),
            "card": CARD,
        },
        published=False,
    ),
    "yolo-seg": Layout(
        {"image": "images/{split}/{stem}.png", "objects": "labels/{split}/{stem}.txt"},
        {"names": Summary("data.yaml", yolo.names), "card": CARD},
    ),
    "parquet": Layout(
        parquet.FILES,
        {"card": Summary("README.md", parquet.parquet_card)},
        published=False,
        packages=parquet.PACKAGES,
        pack=parquet.pack,
    ),
}
FORMATS: tuple[str, ...] = tuple(LAYOUTS)


def layout(name: str) -> Layout:
    """The format called ``name``.

    Raises:
        ValueError: unknown name.
    """
    if name not in LAYOUTS:
        raise ValueError(f"unknown format {name!r}; {hint(name, FORMATS)}")
    return LAYOUTS[name]
