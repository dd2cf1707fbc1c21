"""Refuse sizes of a job that need more memory than the machine has."""

from __future__ import annotations

import math
from collections.abc import Callable

from common.errors import flagged
from common.memory import refuse_larger
from experiments.config.config import RECORD, Config, GroupsConfig, fidelities
from experiments.config.options import Fidelity, Search, SearchOptions
from experiments.config.trainers import training_processes
from scene.render.protocol import MAX_PIXELS, refuse_large_images, refuse_many_shots
from seg.augment import DRAWS
from seg.nets.backbones import backbone_of

PIXEL, SCORES = 4, 4 * (3 + 11)
"""Bytes of a pixel: its colour and label; in training, its colour and the scores of the fewest classes, in
single precision."""


def refuse_too_large(config: Config) -> None:
    """Raise UserError for a size that does not fit into memory; it names flag, memory and bound."""
    training = training_processes(config) if config.executor == "processes" else None
    for name, fidelity in fidelities(config).items():
        _refuse_fidelity(f"--{name}", fidelity)
        if training is not None and fidelity.width * fidelity.height <= MAX_PIXELS:
            sets = _times(training_bytes(fidelity))
            refuse_larger(*training, sets, f"training sets of --{name}")
    if isinstance(config, GroupsConfig):
        _refuse_search(config.search)


def _times(item_bytes: float) -> Callable[[int], int]:
    """Return the bytes of a count as a whole number, since a flag may have any number of digits."""
    return lambda count: count * math.ceil(item_bytes)


def training_bytes(fidelity: Fidelity, labelled: int = 0) -> int:
    """Count the least bytes that a process needs to train a network on renders plus labelled images.

    The arrays of both parts are joined, which copies them, and copied to JAX.
    """
    train, pixels = fidelity.train, fidelity.width * fidelity.height
    count = (fidelity.images + labelled) * (train.views if train.frozen else 1)
    # Labels, and features or colours.
    pixel_bytes = 1 + (backbone_of(train).pixel_bytes if train.frozen else 3)
    copies = 2 if labelled else 1
    return math.ceil(copies * count * pixels * pixel_bytes + train.batch * pixels * SCORES)


def _refuse_fidelity(flag: str, fidelity: Fidelity) -> None:
    train, pixels = fidelity.train, fidelity.width * fidelity.height
    if pixels > MAX_PIXELS:
        return  # the engine refuses these itself, naming width and height
    refuse_large_images(f"{flag}.samples", fidelity.render_settings())
    refuse_many_shots(f"{flag}.shots", fidelity.shots, fidelity.render_settings())
    dataset = f"images of {fidelity.size}"
    refuse_larger(
        f"{flag}.streets", fidelity.streets, _times(fidelity.shots * pixels * PIXEL), dataset
    )
    scores, batch = _times(pixels * SCORES), f"a batch of {fidelity.size}"
    refuse_larger(f"{flag}.train.batch", train.batch, scores, batch)
    refuse_larger(f"{flag}.train.predict-batch", train.predict_batch, scores, batch)
    step = 4 * (train.batch * (DRAWS + 1) + 1)
    refuse_larger(f"{flag}.train.steps", train.steps, _times(step), "random numbers")
    if train.frozen:
        with flagged(f"{flag}.train.net"):
            backbone = backbone_of(train)
        views = _times(fidelity.images * pixels * backbone.pixel_bytes)
        refuse_larger(f"{flag}.train.views", train.views, views, f"features of {dataset}")
    if train.has_backbone:
        head = _times(train.batch * pixels / 64 * 4)
        refuse_larger(f"{flag}.train.head-width", train.head_width, head, "features of a batch")


def _refuse_search(search: SearchOptions) -> None:
    # A model compares the datasets of an update pair by pair.
    datasets = search.datasets_per_update
    refuse_larger("--search.datasets-per-update", datasets, lambda n: n * (n + RECORD), "records")
    if isinstance(search, Search):
        updates = search.updates_per_group
        refuse_larger("--search.updates-per-group", updates, _times(datasets * RECORD), "records")
