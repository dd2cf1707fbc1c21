"""How light or dark each class is beside the others.

The colours of assets are drawn one by one and look right one by one; streets need more. On photographs people
and cyclists are dark against the road, crowns are lighter than facades because the sky comes through them,
poles are lighter than what is behind. The factors bring the median tone of each class, beside the road's,
near that of CamVid's sequences 0016E5 and 0001TP (``python -m benchmarks.transfer --only tones``).
"""

from __future__ import annotations

TONES: dict[str, float] = {
    "building": 0.66,
    "train": 0.7,
    "fence": 0.85,
    "wall": 0.66,
    "tree": 2.1,
    "bush": 1.8,
    "bicycle": 0.4,
    "motorcycle": 0.4,
    "person": 0.42,
    "rider": 0.42,
    "lamp": 2.1,
    "signpost": 2.1,
    "traffic sign": 1.7,
    "traffic light": 1.4,
    "car": 0.52,
    "bus": 0.55,
    "truck": 0.55,
}
"""Factor on the albedo of every asset of a family; a user's own assets are left as they are."""
ROAD_TONE, SIDEWALK_TONE = 0.78, 0.66
"""The same for the road's surface and the sidewalks'."""
