"""Proposals of given or random bins, as ``--search.bins`` and ``--search.relaxation`` cut attributes."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

import sdr_jax
from experiments.config import make_space
from scene.attributes import SPACES
from scene.proposal import Proposal


def relaxed(config: Any, bins: np.ndarray) -> list[Proposal]:
    """Proposals f32[attributes] of bins i[n, attributes]."""
    found = jax.device_get(sdr_jax.relax(make_space(config), bins, config.search.relaxation))
    return [Proposal(*pair) for pair in zip(*found, strict=True)]


def random_bins(config: Any, count: int) -> list[Proposal]:
    """Proposals f32[attributes] with random bins for all attributes; more of them begin with the same."""
    rng = np.random.default_rng(config.seed)
    size = (count, len(SPACES[config.space]))
    return relaxed(config, rng.integers(0, config.search.bins, size))
