"""Measure which images to label next, and which first.

    python -m benchmarks.next_labels CAMVID --seed 6 --seeds 8 [--json FILE]    # two core-minutes per seed
    python -m benchmarks.next_labels DIR --first 7 14 --seed 0 --seeds 5 --target camvid --holdout 0006R0

A network as `sdr-jax fit` trains it on labels alone (240x176) is trained on 14 random images of the sequences
0016E5 and 0001TP and ranks the others; a new one is then trained on these and the first 14 of each ranking.
All are tested on the sequence 0006R0. Rankings of a seed start from the same network, so they are paired.
``spread`` is the order of `sdr-jax predict --rank`; ``margin`` and ``entropy`` are means over pixels;
``balanced`` weights the entropy of each pixel by the rarity of its classes in the predictions, as mIoU does.

``--first`` compares choices of the first images, before any network: ``spread`` over groups and time, as
``--few`` does, and ``k-centre``, which starts with a random image and adds the one whose pooled features are
farthest from all before it. A seed holds out a fifth of each group (`benchmarks.transfer`), on which networks
are tested; they train on the chosen images alone and mixed with ``--streets`` streets. The group of
``--holdout`` is not read.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.report import Row, count, gain_text, parser, table, write
from benchmarks.transfer.recipe import Recipe, rendered, sides
from common.command import exit_code
from common.labels.target_file import find_target
from experiments.app.fit.config import configured
from experiments.app.fit.job import RENDERED
from experiments.targets.few import share_of, spread
from experiments.targets.folder import parts_of, reader
from seg import pyramid
from seg.data import LabelledImages
from seg.inference import logits, score
from seg.metrics import mean_iou
from seg.nets.head import Maps
from seg.settings import TrainSettings
from seg.step import Params
from seg.train import train
from seg.uncertainty import order, uncertainty

FIRST = 14
"""Number of labelled images at the start, and of images that each ranking adds."""
WIDTH, HEIGHT = 240, 176
SETTINGS = replace(configured((WIDTH, HEIGHT)).final.train, average_mirror=False)
"""Without mirror images, so that a ranking uses the features of training."""
HELD_OUT = "0006R0"
BATCH = 32
RETRAINED = 1000
"""Added to the seed of networks that are trained on the chosen images."""
RANKINGS = ("random", "entropy", "margin", "balanced", "spread")


class Split(NamedTuple):
    """Images with the features of the frozen backbone."""

    pool: LabelledImages  # of all views
    test: LabelledImages
    classes: int


def read_split(data: Path) -> Split:
    """Read CamVid, and compute features once."""
    target = find_target("camvid", data)
    parts = parts_of(target, data, HELD_OUT)
    images, pool = reader(parts)(HEIGHT, WIDTH), len(parts.entries)
    unlabelled = images.between(0, pool)
    maps = pyramid.training_features(unlabelled.images, SETTINGS)
    test = images.between(pool, len(images.images))
    test = test._replace(features=pyramid.prediction_features(test.images, SETTINGS))
    return Split(unlabelled._replace(features=maps), test, len(target.classes))


def fitted(split: Split, chosen: Sequence[int], seed: int) -> Params:
    """Train a network on some images of the pool."""
    part = split.pool.take(chosen)
    return train(seed, *part[:2], SETTINGS, split.classes, features=part.features)


def tested(
    net: Params, test: LabelledImages, classes: int, settings: TrainSettings = SETTINGS
) -> float:
    """Compute the mIoU in percent on images with the features of the frozen backbone."""
    confusion = score(net, *test[:2], settings, classes, features=test.features)
    return 100 * float(mean_iou(confusion))


def _scores(split: Split, net: Params) -> Iterator[np.ndarray]:
    assert split.pool.features is not None
    for start in range(0, len(split.pool.images), BATCH):
        rows = slice(start, min(start + BATCH, len(split.pool.images)))
        maps = tuple(part[rows] for part in split.pool.features)
        yield from logits(net, split.pool.images[rows], SETTINGS, split.classes, features=maps)


def ranked(
    split: Split, net: Params, rng: np.random.Generator, rest: list[int]
) -> dict[str, list[int]]:
    """Order the unlabelled images by each ranking."""
    entropy, unsure, by_class, shares = [], [], [], []
    for scores in _scores(split, net):
        p = np.exp(scores - scores.max(axis=-1, keepdims=True))
        p /= p.sum(axis=-1, keepdims=True)
        h = -(p * np.log(np.maximum(p, 1e-12))).sum(axis=-1)
        entropy.append(h.mean())
        unsure.append(uncertainty(scores))
        by_class.append((p * h[..., None]).mean(axis=(0, 1)))
        shares.append(p.mean(axis=(0, 1)))
    rarity = 1 / np.maximum(np.mean(shares, axis=0), 1e-4)
    values = {
        "entropy": entropy,
        "margin": [image.margin for image in unsure],
        "balanced": (by_class * rarity).mean(axis=1),
    }
    rankings = {"random": rng.permutation(rest).tolist()}
    for name, scores_of in values.items():
        rankings[name] = [rest[k] for k in np.argsort(-np.array(scores_of)[rest], kind="stable")]
    return rankings | {"spread": [rest[k] for k in order([unsure[k] for k in rest], FIRST)]}


def measured(split: Split, seed: int) -> list[Row]:
    """Measure the mIoU at the start, and with the images of each ranking."""
    rng = np.random.default_rng(seed)
    first = rng.choice(len(split.pool.images), FIRST, replace=False).tolist()
    net = fitted(split, first, seed)
    rest = [k for k in range(len(split.pool.images)) if k not in first]
    rows = [{"seed": seed, "ranking": "none", HELD_OUT: tested(net, split.test, split.classes)}]
    for name, chosen in ranked(split, net, rng, rest).items():
        grown = fitted(split, [*first, *chosen[:FIRST]], RETRAINED + seed)
        rows.append(
            {"seed": seed, "ranking": name, HELD_OUT: tested(grown, split.test, split.classes)}
        )
    return rows


def summary(rows: Sequence[Row]) -> list[Row]:
    """Compute the mean of each ranking, and its gain over random images with a 95 % interval over seeds."""
    lines = []
    for name in ("none", *RANKINGS):
        line: Row = {"14 more by": name}
        values, base = (
            [row[HELD_OUT] for row in rows if row["ranking"] == k] for k in (name, "random")
        )
        line[HELD_OUT] = f"{np.mean(values):.1f}"
        line["over random"] = "" if name == "random" else gain_text(values, base)
        lines.append(line)
    return lines


CHOICES = ("spread", "k-centre")


def pooled(maps: Maps) -> np.ndarray:
    """Compute means of all channels over the cells of an image, with a deviation of 1 over images."""
    means = np.concatenate([m.astype(np.float32).mean(axis=(1, 2)) for m in maps], axis=1)
    return means / np.maximum(means.std(axis=0), 1e-6)


def k_centre(vectors: np.ndarray, count: int, start: int) -> list[int]:
    """Choose rows greedily: after ``start`` always the one farthest from its nearest chosen row."""
    chosen = [start]
    distance = np.linalg.norm(vectors - vectors[start], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(vectors - vectors[chosen[-1]], axis=1))
    return chosen


def first_choices(pool: LabelledImages, count: int, seed: int) -> dict[str, list[int]]:
    """Choose images by each of `CHOICES`; ``pool`` has features of all views."""
    assert pool.features is not None
    images = len(pool.images)
    vectors = pooled(tuple(m[:images] for m in pool.features))
    start = int(np.random.default_rng(seed).integers(images))
    return {
        "spread": spread(pool.names, pool.sequences, count, seed).tolist(),
        "k-centre": k_centre(vectors, count, start),
    }


def measured_first(recipe: Recipe, counts: Sequence[int], seed: int) -> list[Row]:
    """Measure the mIoU of networks of each choice on the images that the seed holds out."""
    settings, classes = recipe.train, len(recipe.classes.classes)
    pool, test = sides(recipe, seed)
    streets = None
    if recipe.streets:
        streets = rendered(recipe, RENDERED, seed)
        maps = pyramid.training_features(streets.images, settings)
        streets = streets._replace(features=maps)
    rows = []
    for labels in counts:
        for name, chosen in first_choices(pool, labels, seed).items():
            few = pool.take(chosen)
            for renders in (None, streets) if streets else (None,):
                net = train(
                    seed,
                    *(renders or few)[:2],
                    settings,
                    classes,
                    features=(renders or few).features,
                    extra=few if renders else None,
                    share=share_of(labels),
                )
                row = {"seed": seed, "labels": labels, "choice": name}
                row["renders"] = len(renders.images) if renders else 0
                rows.append({**row, "mIoU": tested(net, test, classes, settings)})
    return rows


def summary_first(rows: Sequence[Row]) -> list[Row]:
    """Compute the means of both choices, and the gain of k-centre with its 95 % interval over seeds."""
    lines = []
    for labels, renders in dict.fromkeys((row["labels"], row["renders"]) for row in rows):
        scores = {
            name: [
                row["mIoU"]
                for row in rows
                if (row["labels"], row["renders"], row["choice"]) == (labels, renders, name)
            ]
            for name in CHOICES
        }
        means = {name: f"{np.mean(values):.1f}" for name, values in scores.items()}
        gain = gain_text(scores["k-centre"], scores["spread"])
        lines.append({"labels": labels, "renders": renders, **means, "gain": gain})
    return lines


def main(arguments: list[str] | None = None) -> int:
    """Run the command line."""
    command = parser(__doc__)
    command.add_argument("data", type=Path, help="folder of CamVid; with --first, of any target")
    command.add_argument("--seed", type=int, default=6, help="first seed")
    command.add_argument("--seeds", type=partial(count, 1), default=8)
    command.add_argument(
        "--first", type=partial(count, 1), nargs="+", metavar="N", help="choices of so many images"
    )
    command.add_argument("--target", help="with --first: the target; by default the folder's")
    command.add_argument("--holdout", help="with --first: a group that is not read")
    command.add_argument(
        "--streets",
        type=partial(count, 0),
        default=300,
        help="with --first: streets to mix with (300)",
    )
    options = command.parse_args(arguments)
    run = _first if options.first else _rankings
    return exit_code(lambda: run(options), users=(ValueError,))


def _rankings(options: argparse.Namespace) -> None:
    split, rows = read_split(options.data), []
    for seed in range(options.seed, options.seed + options.seeds):
        rows += measured(split, seed)
        print(table(rows[-1 - len(RANKINGS) :]), flush=True)
    print(table(summary(rows)))
    write(options.json, rows=rows)


def _first(options: argparse.Namespace) -> None:
    recipe = Recipe(str(options.data), options.target, options.holdout, streets=options.streets)
    rows: list[Row] = []
    for seed in range(options.seed, options.seed + options.seeds):
        rows += measured_first(recipe, options.first, seed)
        print(table([row for row in rows if row["seed"] == seed]), flush=True)
    print(table(summary_first(rows)))
    write(options.json, recipe=recipe._asdict(), rows=rows)


if __name__ == "__main__":
    sys.exit(main())
