"""Measures whether a net that has seen fourteen images chooses the next fourteen better than chance.

    python -m benchmarks.next_labels CAMVID --seed 6 --seeds 8 [--json FILE]    # two minutes of a core a seed

A net as `sdr-jax fit` trains it on labels alone (240x176) learns from 14 random images of the drives 0016E5
and 0001TP and ranks the others; a fresh net then learns from these and the first 14 of each ranking. All
are tested on the drive 0006R0. Rankings of a seed begin with the same net, so they are paired. ``spread`` is
the order of `sdr-jax predict --rank`; ``margin`` and ``entropy`` are means over pixels alone; ``balanced``
weights each pixel's entropy by the rarity of its classes in the predictions, as mIoU does.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.report import Row, count, parser, table, write
from experiments.fit import configured
from experiments.study.stats import mean_ci95
from experiments.target.folder import parts_of, reader
from seg import pyramid
from seg.data import LabelledImages
from seg.metrics import mean_iou
from seg.train import Params, logits, score, train
from seg.uncertainty import order, uncertainty
from seg.views import view_images
from shell.target_file import find_target

FIRST = 14
"""Number of labelled images at the start, and of images that each ranking adds."""
WIDTH, HEIGHT = 240, 176
SETTINGS = configured((WIDTH, HEIGHT)).final.train
HELD_OUT = "0006R0"
BATCH = 32
AFRESH = 1000
"""Added to the seed of nets that learn from the chosen images."""
RANKINGS = ("random", "entropy", "margin", "balanced", "spread")


class Drives(NamedTuple):
    """Images with the frozen trunk's features."""

    pool: LabelledImages  # of all views
    test: LabelledImages
    classes: int


def drives(data: Path) -> Drives:
    """Read CamVid, and compute features once."""
    target = find_target("camvid", data)
    parts = parts_of(target, data, HELD_OUT)
    images, pool = reader(parts)(HEIGHT, WIDTH), len(parts.entries)
    own = images.between(0, pool)
    maps = pyramid.features(view_images(own.images, SETTINGS), SETTINGS)
    test = images.between(pool, len(images.images))
    test = test._replace(features=pyramid.features(test.images, SETTINGS))
    return Drives(own._replace(features=maps), test, len(target.classes))


def fitted(own: Drives, chosen: Sequence[int], seed: int) -> Params:
    """Train a net on some images of the pool."""
    part = own.pool.take(chosen)
    return train(seed, part.images, part.labels, SETTINGS, own.classes, features=part.features)


def tested(own: Drives, net: Params) -> float:
    """MIoU in percent on the held-out drive."""
    test = own.test
    found = score(net, test.images, test.labels, SETTINGS, own.classes, features=test.features)
    return 100 * float(mean_iou(found))


def _scores(own: Drives, net: Params) -> Iterator[np.ndarray]:
    assert own.pool.features is not None
    for start in range(0, len(own.pool.images), BATCH):
        there = slice(start, min(start + BATCH, len(own.pool.images)))
        maps = tuple(each[there] for each in own.pool.features)
        yield from logits(net, own.pool.images[there], SETTINGS, own.classes, features=maps)


def ranked(
    own: Drives, net: Params, rng: np.random.Generator, rest: list[int]
) -> dict[str, list[int]]:
    """The unlabelled images in the order of each ranking."""
    entropy, unsure, by_class, shares = [], [], [], []
    for scores in _scores(own, net):
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
        "margin": [each.margin for each in unsure],
        "balanced": (by_class * rarity).mean(axis=1),
    }
    found = {"random": rng.permutation(rest).tolist()}
    for name, of in values.items():
        found[name] = [rest[k] for k in np.argsort(-np.array(of)[rest], kind="stable")]
    return found | {"spread": [rest[k] for k in order([unsure[k] for k in rest], FIRST)]}


def measured(own: Drives, seed: int) -> list[Row]:
    """MIoU at the start, and with the images of each ranking."""
    rng = np.random.default_rng(seed)
    first = rng.choice(len(own.pool.images), FIRST, replace=False).tolist()
    net = fitted(own, first, seed)
    rest = [k for k in range(len(own.pool.images)) if k not in first]
    rows = [{"seed": seed, "ranking": "none", HELD_OUT: tested(own, net)}]
    for name, chosen in ranked(own, net, rng, rest).items():
        grown = fitted(own, [*first, *chosen[:FIRST]], AFRESH + seed)
        rows.append({"seed": seed, "ranking": name, HELD_OUT: tested(own, grown)})
    return rows


def summary(rows: Sequence[Row]) -> list[Row]:
    """Each ranking's mean, and its gain over random images with a 95 % interval over seeds."""
    found = []
    for name in ("none", *RANKINGS):
        line: Row = {"14 more by": name}
        values, base = (
            np.array([row[HELD_OUT] for row in rows if row["ranking"] == k])
            for k in (name, "random")
        )
        gain, ci95 = mean_ci95((values - base).tolist())
        line[HELD_OUT] = f"{values.mean():.1f}"
        between = "" if ci95 is None else f" ({ci95[0]:+.1f} to {ci95[1]:+.1f})"
        line["over random"] = "" if name == "random" else f"{gain:+.1f}{between}"
        found.append(line)
    return found


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    command = parser(__doc__)
    command.add_argument("data", type=Path, help="folder of CamVid")
    command.add_argument("--seed", type=int, default=6, help="the first")
    command.add_argument("--seeds", type=partial(count, 1), default=8)
    options = command.parse_args(arguments)
    own, rows = drives(options.data), []
    for seed in range(options.seed, options.seed + options.seeds):
        rows += measured(own, seed)
        print(table(rows[-1 - len(RANKINGS) :]), flush=True)
    print(table(summary(rows)))
    write(options.json, rows=rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
