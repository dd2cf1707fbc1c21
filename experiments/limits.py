"""What a job's sizes need in memory, at least; more than there is is refused by flag, before it is taken."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from experiments.config import Config, Fidelity, fidelities
from scene.render.protocol import MAX_PIXELS, refuse_large_images, refuse_many_shots
from scene.workers import refuse_many_workers
from seg.augment import DRAWS
from shell.errors import UserError
from shell.memory import refuse_larger

COUNTS = ("seeds", "candidate_seeds", "evaluations", "proposals", "repeats", "repeated")
"""Fields that count nets."""
PIXEL, FEATURES, SCORES = 4, 3.6, 4 * (3 + 11)
"""Bytes of a pixel: its colour and label; what a frozen trunk sees in it; in training, colour and the scores
of the fewest classes in single precision."""
MOST_BINS = 1000
"""More would only take time: a bin is a thousandth of an attribute's range."""
RECORD = 1000
"""Bytes of what is kept of a net."""


def refuse_too_large(config: Config) -> None:
    """Raise UserError for a size that this machine cannot hold; names flag, memory and bound."""
    refuse_many_workers("--workers", config.workers)
    for name, fidelity in fidelities(config).items():
        _refuse_fidelity(f"--{name}", fidelity)
    for name in COUNTS:
        value = getattr(config, name, None)
        if value is not None:
            refuse_larger(f"--{name.replace('_', '-')}", value, _times(RECORD), "records of nets")
    _refuse_search(getattr(config, "search", None))


def _times(each: float) -> Callable[[int], int]:
    """Bytes of so many; whole numbers, since a flag may have any number of digits."""
    return lambda count: count * math.ceil(each)


def _refuse_fidelity(flag: str, fidelity: Fidelity) -> None:
    train, pixels = fidelity.train, fidelity.width * fidelity.height
    if pixels > MAX_PIXELS:
        return  # the engine's own bound, which names width and height
    refuse_large_images(f"{flag}.samples", fidelity.render_settings())
    refuse_many_shots(f"{flag}.shots", fidelity.shots, fidelity.render_settings())
    dataset = f"images of {fidelity.size}"
    refuse_larger(
        f"{flag}.streets", fidelity.streets, _times(fidelity.shots * pixels * PIXEL), dataset
    )
    batch = f"a batch of {fidelity.size}"
    for name in ("batch", "predict_batch"):
        words = f"{flag}.train.{name.replace('_', '-')}"
        refuse_larger(words, getattr(train, name), _times(pixels * SCORES), batch)
    step = 4 * (train.batch * (DRAWS + 1) + 1)
    refuse_larger(f"{flag}.train.steps", train.steps, _times(step), "random numbers")
    if train.frozen:
        views = _times(fidelity.images * pixels * FEATURES)
        refuse_larger(f"{flag}.train.views", train.views, views, f"features of {dataset}")
    if train.net == "lite0":
        head = _times(train.batch * pixels / 64 * 4)
        refuse_larger(f"{flag}.train.head-width", train.head_width, head, "features of a batch")


def _refuse_search(search: Any) -> None:
    if search is None:
        return
    updates, datasets = (
        getattr(search, n, 1) for n in ("updates_per_group", "datasets_per_update")
    )
    if search.bins > MOST_BINS:
        raise UserError(f"--search.bins must lie in 2..{MOST_BINS}, not {search.bins}")
    # A model compares the datasets of an update pair by pair.
    refuse_larger("--search.datasets-per-update", datasets, lambda n: n * (n + RECORD), "records")
    refuse_larger("--search.updates-per-group", updates, _times(datasets * RECORD), "records")
