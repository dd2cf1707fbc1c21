"""Fallen leaves on road and sidewalk, mostly along the kerb, and puddles."""

from __future__ import annotations

import numpy as np

from scene.ground.extent import KERB_WIDTH, PAINT_LIFT
from scene.ground.ground import Ground
from scene.mesh.quads import Quads, discs, flat, strokes

FROM, TO = -4.0, 70.0
"""Range along the road in metres; farther away they are smaller than a pixel."""
LEAVES = ((0.10, 0.06, 0.02), (0.17, 0.11, 0.03), (0.06, 0.04, 0.02), (0.20, 0.15, 0.05))
"""Linear colours."""
GATHERED = 0.55
"""Metres from the kerb within which most leaves lie."""
WATER = (0.03, 0.032, 0.034)


def leaves(ground: Ground, rng: np.random.Generator, road: bool) -> list[Quads]:
    """Leaves on the road, or on the paving of the sidewalks."""
    count = ground.leaves
    if not count:
        return []
    x, side = rng.uniform(FROM, TO, count), rng.choice((-1.0, 1.0), count)
    away = 0.1 + rng.exponential(GATHERED, count)
    turn, size = rng.uniform(0, np.pi, count), rng.uniform(0.05, 0.13, count)
    color = np.array(LEAVES)[rng.integers(len(LEAVES), size=count)] * rng.uniform(0.7, 1.2)
    inner = ground.half_width + KERB_WIDTH + 0.5  # beyond the ramp of dropped kerbs
    y = ground.half_width - away if road else inner + away
    low, high = np.array([ground.side(s).verge for s in (-1.0, 1.0)])[(side > 0).astype(int)].T
    on_paving = (
        (y > 0.2) if road else (y < ground.outer - 0.1) & ((y < low - 0.1) | (y > high + 0.1))
    )
    middle = np.stack([x, side * y], axis=1)[on_paving]
    reach = (size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))[on_paving]
    outlines = strokes(middle - reach / 2, middle + reach / 2, 0.06)
    height = PAINT_LIFT + 0.002 if road else ground.kerb_height + PAINT_LIFT
    return [flat(outlines, height, color[on_paving], "plain")]


def puddles(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Puddles in the hollows of the road, most of them along the kerbs."""
    count, sides = ground.puddles, 16
    if not count:
        return []
    long, wide = rng.uniform(0.5, 2.2, count), rng.uniform(0.25, 0.7, count)
    x, side = rng.uniform(FROM + 6, TO, count), rng.choice((-1.0, 1.0), count)
    y = side * np.maximum(ground.half_width - wide - rng.exponential(0.5, count), 0.0)
    outlines = discs(np.zeros((count, 2)), 1.0, sides).reshape(count, sides // 2, 4, 2)
    angle = np.arctan2(outlines[..., 1], outlines[..., 0])
    waves = rng.uniform(0, 2 * np.pi, (2, count, 1, 1))
    outlines *= (1 + 0.16 * np.sin(2 * angle + waves[0]) + 0.1 * np.sin(3 * angle + waves[1]))[
        ..., None
    ]
    size, place = np.stack([long, 0.75 * wide], axis=1), np.stack([x, y], axis=1)
    outlines = outlines * size[:, None, None] + place[:, None, None]
    return [flat(outlines.reshape(-1, 4, 2), PAINT_LIFT + 0.001, np.array(WATER), "water")]
