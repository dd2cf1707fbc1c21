"""A dataset's card: README.md in the format of Hugging Face, with metadata for machines first."""

from __future__ import annotations

from collections.abc import Iterator

from scene.dataset.formats.about import About

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""Limits of the number of images, and the names of the sizes below them."""
SPLIT = {"train": "train", "val": "validation"}
"""Hugging Face's names of splits."""
USES = {
    "cityscapes": """\
The layout of Cityscapes: images in `leftImg8bit/`, labels in `gtFine/` as ids, train ids, instances and
colours; beside them `depth/`, `disparity/`, `normals/`, `camera/` and outlines in `annotations/`.
""",
    "coco": """\
The layout of COCO: `images/`, objects in `annotations/instances.json`, masks of classes in
`annotations/semantic.json`, and `panoptic/` with `annotations/panoptic.json`; beside them `depth/`,
`normals/` and `camera/`.
""",
    "yolo-seg": """\
Ultralytics' layout: `images/`, and in `labels/` an outline of each thing on a line; `data.yaml` names the
classes.
""",
    "folders": """\
`images/` and `masks/` hold one PNG of the same name for each image, `classes.txt` on each line a value of the
masks, a space, and the name of its class.
""",
    "parquet": """\
```
from datasets import load_dataset

dataset = load_dataset("parquet", data_files={"{split}": "data/*.parquet"})
```
`image` and `label` are pictures of the same size; `classes` lists the classes that are in the image by their
places in the table below.
""",
}
"""Description of the files by layout."""


def card(about: About, features: str = "") -> Iterator[str]:
    """Yield the card in pieces.

    Args:
        about: the dataset.
        features: lines of YAML about columns, if there are any.
    """
    told = about.description
    size = next((name for most, name in SIZES if told["images"] < most), "n>1M")
    width, height = about.size
    yield (
        "---\npretty_name: Rendered streets\ntask_categories:\n- image-segmentation\n"
        f"tags:\n- synthetic\n- street-scenes\nsize_categories:\n- {size}\n{features}---\n"
    )
    yield (
        f"# Rendered streets\n{told['images']} images of {width}x{height} pixels of {len(told['streets'])} "
        "streets, with the class of every pixel, rendered by sdr-jax "
        f"{told['versions']['sdr-jax']} (engine {told['engine']}, renderer {told['renderer']}, seed "
        f"{told['seed']}). `dataset.json` holds all settings and the attributes of every street.\n\n"
    )
    yield USES[told["format"]].replace("{split}", SPLIT[about.split])
    yield "\n## Classes\n| value | class | share of pixels | images |\n| --- | --- | --- | --- |\n"
    for value, name in about.labels.all_values:
        if name in told["class_frequency"]:
            share, images = told["class_frequency"][name], told["images_with_class"][name]
            yield f"| {_text(value)} | {name} | {100 * share:.2f} % | {images} |\n"
        else:
            yield f"| {_text(value)} | {name}: counts for nothing | | |\n"
    if "target" in told:
        yield f"\nThe classes are those of the target {told['target']['name']}.\n"
    yield "\n## Rights\nStreets, shapes and textures are made by code"
    if told["own_assets"]:
        yield "; assets of others are listed in `assets.csv`, with authors and licences"
    if "own_class" in told:
        own = told["own_class"]
        yield f"; objects of class {own['name']} are those of the user's file `{own['file']}`"
    yield ". No photograph is in this dataset.\n"


def class_list(about: About) -> Iterator[str]:
    """Yield ``classes.txt``: a value of label pictures and the name of its class on each line."""
    for value, name in about.labels.all_values:
        yield f"{_text(value)} {' '.join(name.split())}\n"


def _text(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
