"""Check that labels and depth show the same outlines, without tuned thresholds.

Where depth jumps, one object usually ends and another begins, so id edges coincide with depth jumps. If
labels were shifted against depth by a few pixels, they would coincide no more often than by chance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

JUMP = float(np.log(1.25))
"""A jump in depth: one of two neighbouring pixels is a quarter farther away (log ratio)."""
SHIFT = 4
"""Pixels by which labels are shifted to count coincidences by chance."""


class Overlap(NamedTuple):
    """Depth jumps that lie on id edges, counted over images."""

    aligned: float = 0.0  # with the labels as they are
    shifted: float = 0.0  # mean over labels moved by ``SHIFT`` each way, along rows and columns

    def plus(self, other: Overlap) -> Overlap:
        """The sum of both counts."""
        return Overlap(self.aligned + other.aligned, self.shifted + other.shifted)

    @property
    def lift(self) -> float:
        """The ratio of depth jumps on id edges to their number by chance."""
        return self.aligned / max(self.shifted, 1.0)


def overlap(ids: np.ndarray, depth: np.ndarray) -> Overlap:
    """Count one image.

    Args:
        ids: i32[h, w] segment ids.
        depth: [h, w] in any unit, 0 for the sky, whose outline is not counted.
    """
    aligned = shifted = 0.0
    for i, d in ((ids, depth), (ids.T, depth.T)):
        visible = (d[:, 1:] > 0) & (d[:, :-1] > 0)
        log = np.log(np.maximum(d, 1).astype(np.float32))
        jumps = visible & (np.abs(np.diff(log)) > JUMP)
        edges = np.diff(i) != 0
        if edges.shape[1] <= SHIFT:
            continue
        aligned += np.count_nonzero(jumps & edges)
        left = np.count_nonzero(jumps[:, SHIFT:] & edges[:, :-SHIFT])
        right = np.count_nonzero(jumps[:, :-SHIFT] & edges[:, SHIFT:])
        shifted += (left + right) / 2
    return Overlap(aligned, shifted)
