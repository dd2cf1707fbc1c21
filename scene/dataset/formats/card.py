"""A dataset's card: README.md in the format of Hugging Face, with metadata on top."""

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
colours; in addition `depth/`, `disparity/`, `normals/`, `camera/` and masks in `annotations/`.
""",
    "coco": """\
The layout of COCO: `images/`, objects in `annotations/instances.json`, masks of classes in
`annotations/semantic.json`, and `panoptic/` with `annotations/panoptic.json`; in addition `depth/`,
`normals/` and `camera/`.
""",
    "yolo-seg": """\
Ultralytics' layout: `images/`, and `labels/` with one outline per thing and line; `data.yaml` names the
classes.
""",
    "folders": """\
`images/` and `masks/` hold one PNG of the same name for each image. Each line of `classes.txt` is a mask
value, a space, and the name of its class.
""",
    "parquet": """\
```
from datasets import load_dataset

dataset = load_dataset("parquet", data_files={"{split}": "data/*.parquet"})
```
`image` and `label` are images of the same size; `classes` lists the classes in the image by their row in
the table below.
""",
}
"""Description of the files, by layout."""


def card(about: About, features: str = "") -> Iterator[str]:
    """Yield the card in pieces.

    Args:
        about: the dataset.
        features: lines of YAML about columns, if any.
    """
    description = about.description
    size = next((name for most, name in SIZES if description["images"] < most), "n>1M")
    width, height = about.size
    yield (
        "---\npretty_name: Rendered streets\ntask_categories:\n- image-segmentation\n"
        f"tags:\n- synthetic\n- street-scenes\nsize_categories:\n- {size}\n{features}---\n"
    )
    streets, version = len(description["streets"]), description["versions"]["sdr-jax"]
    engine, renderer, seed = (description[name] for name in ("engine", "renderer", "seed"))
    things = description["format"] == "yolo-seg"
    what = "outlines of things" if things else "the class of every pixel"
    yield (
        f"# Rendered streets\n{description['images']} images of {width}x{height} pixels of {streets} "
        f"streets, with {what}, rendered by sdr-jax {version} (engine {engine}, "
        f"renderer {renderer}, seed {seed}). `dataset.json` holds all settings and the attributes of "
        "every street.\n\n"
    )
    yield USES[description["format"]].replace("{split}", SPLIT[about.split])
    yield "\n## Classes\n| value | class | share of pixels | images |\n| --- | --- | --- | --- |\n"
    labels = about.labels
    rows = [(k, labels.names[thing]) for k, thing in enumerate(labels.things)]
    for value, name in rows if things else labels.all_values:
        if name in description["class_frequency"]:
            share, images = (
                description["class_frequency"][name],
                description["images_with_class"][name],
            )
            yield f"| {_text(value)} | {name} | {100 * share:.2f} % | {images} |\n"
        else:
            yield f"| {_text(value)} | {name}: ignored | | |\n"
    if "target" in description:
        yield f"\nThe classes are those of the target {description['target']['name']}.\n"
    yield "\n## Rights\nStreets, shapes and textures are made by code"
    if description["own_assets"]:
        yield "; `assets.csv` lists the assets of others, with authors and licences"
    if "own_class" in description:
        own_class = description["own_class"]
        yield f"; objects of class {own_class['name']} are those of the user's file `{own_class['file']}`"
    yield ". This dataset contains no photographs.\n"


def class_list(about: About) -> Iterator[str]:
    """Yield ``classes.txt``: a value of label images and the name of its class on each line."""
    for value, name in about.labels.all_values:
        yield f"{_text(value)} {' '.join(name.split())}\n"


def _text(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
