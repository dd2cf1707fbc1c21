"""Check that the files of a dataset are complete and that its labels agree.

    sdr-jax check streets
    sdr-jax check --overlaps 300   # without a dataset: count overlapping objects of streets

Prints one line per fault. Exit code 0: no faults; 1: faults; 2: not a dataset.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from common.command import Arguments, exit_code
from common.files import read_bytes, read_json
from scene import parsers
from scene.assets.catalogue import AssetPool
from scene.attributes import SpaceName, default_unit, street_params
from scene.dataset.edges import Overlap, overlap
from scene.dataset.formats.about import About
from scene.dataset.formats.planes import ids_of
from scene.dataset.formats.segments import TRAIN_OF_LABEL, label_ids
from scene.dataset.read import Described, describe
from scene.dataset.verify import load, verify
from scene.proposal import draw, random_proposal
from scene.street.clearance import pairs
from scene.street.instances import standing
from scene.street.street import sample_street

LEAST_LIFT = 1.8
"""Least ratio of depth jumps on id edges to chance. Typical: 2.4 to 5; off by one pixel: 1.2 to 1.6."""
ENOUGH_JUMPS = 3000
"""Least number of depth jumps on id edges that this check needs."""
SLACK = 0.02
"""Share of its pixels that the outline of an object may miss."""
DEEP = 0.05
"""Metres by which footprints may overlap."""


def findings(folder: Path) -> Iterator[str]:
    """Yield one line for each fault of a dataset.

    Raises:
        ValueError: the folder holds no dataset.
    """
    dataset = describe(folder)
    yield from _stray_files(dataset)
    entries: dict[str, Any] = {}
    for name, path in dataset.layout.summary_paths(dataset.split).items():
        try:
            if not path.endswith(".json"):
                yield from _text(dataset, name, dataset.folder / path)
                continue
            entries[name] = _by_stem(dataset, name, read_json(dataset.folder / path))
        except FileNotFoundError:
            if name != "card":
                yield f"{dataset.folder / path} is missing"
        except (OSError, ValueError) as error:
            yield str(error)
        except (LookupError, TypeError, AttributeError) as error:
            yield f"{dataset.folder / path} is not valid for its format: {error!r}"
    pixels, containing, edges, complete = Counter[int](), Counter[int](), Overlap(), True
    enclosed, objects = np.zeros(len(dataset.labels.names)), "objects" in dataset.layout.files
    for stem in dataset.stems:
        planes, faults = load(dataset, stem)
        yield from faults
        image_entries = {name: by_stem.get(stem, []) for name, by_stem in entries.items()}
        yield from (f"{stem}: {fault}" for fault in verify(planes, image_entries, dataset.labels))
        if "panoptic" in planes:
            ids = ids_of(planes["panoptic"])
            classes = dataset.labels.of_engine[TRAIN_OF_LABEL[label_ids(ids)]]
        elif "label_ids" in planes:
            classes = dataset.labels.classes_of(planes["label_ids"])
        else:
            complete = complete and objects and "objects" in planes
            enclosed += planes.get("objects", 0)
            continue
        values, counts = np.unique(classes, return_counts=True)
        pixels.update(dict(zip(values.tolist(), counts.tolist(), strict=True)))
        containing.update(values.tolist())
        if "depth" in planes and "panoptic" in planes:
            edges = edges.plus(overlap(ids, planes["depth"]))
    if complete and objects:
        yield from _enclosed(dataset, enclosed)
    elif complete:
        yield from _statistics(dataset, pixels, containing)
    if edges.aligned + edges.shifted > ENOUGH_JUMPS and edges.lift < LEAST_LIFT:
        yield (
            f"label and depth edges disagree: they coincide {edges.lift:.1f} times as often as by chance, "
            f"but should at least {LEAST_LIFT} times"
        )


def _stray_files(dataset: Described) -> Iterator[str]:
    """Report files in the folders of images that belong to no image."""
    if dataset.rows is not None:
        for name in sorted(set(dataset.rows) - set(dataset.stems)):
            yield f"{dataset.rows[name].shard}: {name} is not an image of dataset.json"
        return
    expected = {dataset.path(k, s) for s in dataset.stems for k in dataset.layout.files}
    for folder in sorted({path.parent for path in expected}):
        if folder.is_dir():
            for path in sorted(folder.iterdir()):
                hidden = path.name.startswith(".")  # such as .DS_Store
                if path.is_file() and path not in expected and not hidden:
                    yield f"{path} belongs to no image"


def _text(dataset: Described, name: str, path: Path) -> Iterator[str]:
    """Compare the list of classes with ``dataset.json``; users may edit other text files."""
    summary = dataset.layout.summaries[name]
    about = About(lambda: (), dataset.split, dataset.size, dataset.labels, dataset.description)
    content = read_bytes(path)
    if name == "classes" and content != "".join(summary.text(about)).encode():
        yield f"{path} and dataset.json disagree on the classes"


def _by_stem(dataset: Described, name: str, content: Any) -> dict[str, list[dict[str, Any]]]:
    """Group the entries of a file about all images by image."""
    stem_of = {}
    for image in content["images"]:
        file = Path(image["file_name"]).name
        stem_of[image["id"]] = file.split(".")[0].split("_leftImg8bit")[0].split("_gtFine")[0]
        if (image["width"], image["height"]) != dataset.size:
            raise ValueError(f"{dataset.folder}: {name} lists {file} with another size")
    missing = sorted(set(dataset.stems) ^ set(stem_of.values()))
    if missing:
        raise ValueError(f"{dataset.folder}: {name} and dataset.json differ on {missing[0]}")
    by_stem: dict[str, list[dict[str, Any]]] = {stem: [] for stem in dataset.stems}
    for annotation in content["annotations"]:
        entries = annotation["segments_info"] if name == "panoptic" else [annotation]
        if not all(isinstance(row["id"], int) for row in entries):
            raise TypeError("an id is not a whole number")
        by_stem[stem_of[annotation["image_id"]]] += entries
    return by_stem


def _enclosed(dataset: Described, enclosed: np.ndarray) -> Iterator[str]:
    """Compare the pixels f64[classes] inside the outlines of things with the rendered ones."""
    shares = dataset.description.get("class_frequency")
    total = len(dataset.stems) * dataset.size[0] * dataset.size[1]
    for k in dataset.labels.things:
        name = dataset.labels.names[k]
        share = shares.get(name) if isinstance(shares, dict) else None
        if (
            not isinstance(share, int | float)
            or abs(share * total - enclosed[k]) > SLACK * enclosed[k] + 1
        ):
            yield (
                f"dataset.json: class_frequency of {name} is {share}, but the outlines enclose "
                f"{enclosed[k] / total:.9f}"
            )


def _statistics(
    dataset: Described, pixels: Counter[int], containing: Counter[int]
) -> Iterator[str]:
    """Compare the labels with ``dataset.json``."""
    total = len(dataset.stems) * dataset.size[0] * dataset.size[1]
    recorded = {
        key: value if isinstance(value := dataset.description.get(key), dict) else {}
        for key in ("class_frequency", "images_with_class")
    }
    for k, name in enumerate(dataset.labels.names):
        share = round(pixels[k] / total, 9)
        for key, measured in (("class_frequency", share), ("images_with_class", containing[k])):
            stated = recorded[key].get(name)
            if not isinstance(stated, int | float) or abs(stated - measured) > 1e-8:
                yield f"dataset.json: {key} of {name} is {stated}, but the labels have {measured}"


def overlaps(units: np.ndarray, pool: AssetPool) -> Counter[str]:
    """Count overlaps of more than ``DEEP`` metres in streets, by pair of families.

    Args:
        units: f32[streets, attributes] attributes, in [0, 1].
        pool: the assets of the streets.
    """
    counts = Counter[str]()
    for seed, unit in enumerate(units):
        street = sample_street(street_params(unit), seed, 1, pool)
        objects, rectangles = standing(street.placements)
        for pair in pairs(rectangles, DEEP).tolist():
            counts[" and ".join(sorted(objects[k].family for k in pair))] += 1
    return counts


def _report_overlaps(count: int, space: SpaceName, pool: AssetPool) -> int:
    """Print overlaps in default and random streets; returns 1 if there are any, else 0."""
    total = 0
    default = np.tile(default_unit(space), (count, 1))
    for name, units in (("default", default), ("random", draw(random_proposal(space), 0, count))):
        counts = overlaps(units, pool)
        total += counts.total()
        print(f"{count} {name} streets ({space}): {counts.total()} overlaps of more than {DEEP} m")
        for families, number in counts.most_common():
            print(f"  {families}: {number}")
    return int(total > 0)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    command = parsers.check()
    options = command.parse_args(arguments)
    if (options.dataset is None) == (options.overlaps is None):
        command.error("pass either a dataset or --overlaps N")
    if options.overlaps is not None and options.overlaps < 1:
        command.error(f"--overlaps must be 1 or more, not {options.overlaps}")

    def work() -> int:
        if options.overlaps is not None:
            return _report_overlaps(
                options.overlaps, options.space, AssetPool(overlap=options.overlap)
            )
        count = 0
        for line in findings(options.dataset):
            print(line, flush=True)
            count += 1
        if not count:
            print(f"{options.dataset}: no faults: all files are complete and all labels agree")
        return int(count > 0)

    return exit_code(work, users=(ValueError,), debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
