"""Proposals from bins, as ``--search.bins`` and ``--search.relaxation`` define them."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

import sdr_jax
from scene.attributes import SPACES, names
from scene.held import hold
from scene.proposal import Proposal


def relaxed(config: Any, bins: np.ndarray) -> list[Proposal]:
    """Make proposals f32[attributes] of bins i[n, attributes]."""
    space = sdr_jax.space(names(config.space), config.search.bins)
    intervals = jax.device_get(sdr_jax.relax(space, bins, config.search.relaxation))
    return [Proposal(*pair) for pair in zip(*intervals, strict=True)]


def random_bins(config: Any, count: int) -> list[Proposal]:
    """Draw proposals f32[attributes] with random bins for all attributes that are not held.

    A larger count starts with the same proposals.
    """
    rng = np.random.default_rng(config.seed)
    size = (count, len(SPACES[config.space]))
    proposals = relaxed(config, rng.integers(0, config.search.bins, size))
    return [hold(proposal, config.held) for proposal in proposals]
