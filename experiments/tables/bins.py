"""Proposals with random bins, as ``--search.bins`` and ``--search.relaxation`` define them."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

import sdr_jax
from scene.attributes import SPACES, names
from scene.held import hold
from scene.proposal import Proposal


def random_bins(config: Any, count: int) -> list[Proposal]:
    """Draw proposals f32[attributes] with random bins for all attributes that are not held.

    A larger count starts with the same proposals.
    """
    rng = np.random.default_rng(config.seed)
    bins = rng.integers(0, config.search.bins, (count, len(SPACES[config.space])))
    space = sdr_jax.space(names(config.space), config.search.bins)
    intervals = jax.device_get(sdr_jax.relax(space, bins, config.search.relaxation))
    return [hold(Proposal(*pair), config.held) for pair in zip(*intervals, strict=True)]
