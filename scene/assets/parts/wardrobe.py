"""Clothes by style: colours and combinations as seen in streets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from common.errors import hint
from scene.assets.parts.draw import (
    SameAs,
    between,
    keep,
    maybe,
    near,
    one_of,
    perhaps,
    sample_fields,
)
from scene.assets.parts.human import Outfit
from scene.assets.parts.palette import BLACK, OFF_WHITE, REFLECTING, WHITE_SOLE, pick
from scene.mesh.asset import Color

SKINS: tuple[Color, ...] = (
    (0.62, 0.40, 0.30), (0.56, 0.35, 0.25), (0.47, 0.28, 0.19), (0.36, 0.20, 0.125),
    (0.20, 0.105, 0.062), (0.095, 0.049, 0.031),
)  # fmt: skip
HAIRS: tuple[Color, ...] = (
    (0.008, 0.007, 0.006), (0.019, 0.011, 0.007), (0.049, 0.026, 0.013), (0.111, 0.049, 0.016),
    (0.208, 0.137, 0.058), (0.221, 0.215, 0.208),
)  # fmt: skip
CLOTHES: tuple[Color, ...] = (
    (0.022, 0.022, 0.023), (0.022, 0.025, 0.043), (0.045, 0.046, 0.048), (0.026, 0.038, 0.075),
    (0.072, 0.052, 0.033), (0.033, 0.039, 0.023), (0.049, 0.016, 0.019), (0.104, 0.104, 0.104),
    (0.293, 0.286, 0.273), (0.195, 0.156, 0.107), (0.028, 0.026, 0.026), (0.018, 0.036, 0.033),
)  # fmt: skip
"""Muted colours, the most common ones."""
BRIGHT: tuple[Color, ...] = (
    (0.380, 0.020, 0.025), (0.030, 0.120, 0.400), (0.050, 0.230, 0.110), (0.480, 0.280, 0.020),
    (0.400, 0.100, 0.170), (0.560, 0.550, 0.530), (0.130, 0.280, 0.430), (0.200, 0.060, 0.230),
    (0.450, 0.150, 0.030),
)  # fmt: skip
PALE: tuple[Color, ...] = (
    (0.700, 0.690, 0.660), (0.560, 0.490, 0.370), (0.480, 0.560, 0.650), (0.640, 0.520, 0.490),
    (0.430, 0.430, 0.430), (0.660, 0.620, 0.480),
)  # fmt: skip
"""Light colours, of summer clothes and raincoats."""
TROUSERS: tuple[Color, ...] = (
    (0.022, 0.022, 0.023), (0.022, 0.028, 0.050), (0.036, 0.058, 0.105), (0.040, 0.040, 0.042),
    (0.150, 0.117, 0.078), (0.072, 0.098, 0.137), (0.046, 0.036, 0.026), (0.104, 0.104, 0.104),
)  # fmt: skip
SHOES: tuple[Color, ...] = ((0.022, 0.021, 0.020), (0.039, 0.023, 0.013), (0.325, 0.325, 0.319),
                            (0.039, 0.046, 0.065), (0.130, 0.072, 0.033))  # fmt: skip
DARK_SHARE = 0.6
"""Share of adults in black, navy or charcoal over dark trousers, as in photos of streets."""
PALE_SHARE, PALE_TROUSERS = 0.5, 0.25
"""Shares of the other people with a light top, and with light trousers."""
VEST_SHARE = 0.03
"""Share of the people in these styles with a reflecting vest over them."""
VESTS = ("jacket", "puffer", "short coat", "hoodie")
_WOMENS_HAIR = ("bob", "long", "long", "ponytail", "bun", "curly", "short")
_MENS_HAIR = ("short", "short", "short", "thick", "bald", "curly")
HI_VIS: tuple[Color, ...] = ((0.52, 0.66, 0.04), (0.75, 0.20, 0.02))


class Choices(NamedTuple):
    """Colours and hair that are drawn for every style in the same way."""

    top: Color
    second_top: Color
    coat: Color
    dress: Color
    legs: Color  # below a skirt
    tied_hair: str  # of those who run


_STYLES: dict[str, Callable[[Choices], dict[str, Any]]] = {
    "jacket": lambda d: dict(
        hem=between(0.06, 0.22), padding=0.008, shirt=perhaps(0.6, d.second_top),
        accent=perhaps(0.2, d.coat),
    ),
    "jumper": lambda d: dict(
        hem=between(0.04, 0.14), padding=0.005, accent=perhaps(0.35, d.second_top), stripes=maybe(0.6)
    ),
    "hoodie": lambda d: dict(hem=between(0.06, 0.18), padding=0.008, collar=d.top),
    "hood": lambda d: dict(
        hem=between(0.08, 0.24), padding=0.010, hat="hood", hat_color=d.top, collar=d.top
    ),
    "t-shirt": lambda d: dict(
        hem=between(0.05, 0.16), top=d.second_top, sleeves=0.42, collar=None, stripes=maybe(0.2),
        accent=perhaps(0.3, d.coat),
    ),
    "t-shirt and shorts": lambda d: dict(
        hem=between(0.05, 0.16), top=d.second_top, sleeves=0.42, trousers=between(0.35, 0.5), width=1.3,
        collar=None, legs=near(0.3, *TROUSERS, *BRIGHT[:3]), shoes=near(0.15, *SHOES[2:]),
        sole=WHITE_SOLE,
    ),
    "puffer": lambda d: dict(hem=between(0.06, 0.26), padding=0.022, quilted=True, collar=d.top),
    "suit": lambda d: dict(
        hem=between(0.12, 0.18), top=near(0.3, *CLOTHES[:3], (0.10, 0.10, 0.105)), legs=SameAs("top"),
        shirt=(0.55, 0.56, 0.58), padding=0.006, shoes=SHOES[0], sole=BLACK, hat="", collar=None,
    ),
    "short coat": lambda d: dict(
        hem=between(0.22, 0.38), padding=0.011, flare=1.1, shirt=perhaps(0.25, d.second_top)
    ),
    "long coat": lambda d: dict(
        hem=between(0.5, 0.72), padding=0.012, top=d.coat, flare=between(1.1, 1.5)
    ),
    "skirt": lambda d: dict(
        hem=between(0.35, 0.8), legs=d.legs, trousers=1.0, width=0.88, hem_color=d.dress,
        flare=between(1.1, 1.8),
    ),
    "dress": lambda d: dict(
        hem=between(0.4, 0.85), top=d.dress, legs=d.legs, width=0.88, collar=None, hat="",
        sleeves=one_of(0.3, 0.42, 1.0), hem_color=d.dress, flare=between(1.2, 1.9),
    ),
    "sports": lambda d: dict(
        hem=between(0.03, 0.1), top=near(0.15, *BRIGHT), sleeves=0.4, collar=None, hat="",
        width=0.95, trousers=one_of(0.4, 0.8, 1.0), legs=near(0.15, *TROUSERS[:4]),
        shoes=near(0.15, *BRIGHT), sole=WHITE_SOLE, hairdo=d.tied_hair,
    ),
    "work": lambda d: dict(
        hem=between(0.06, 0.2), top=one_of(*HI_VIS), legs=perhaps(0.4, SameAs("top"), keep),
        bands=REFLECTING, padding=0.010, collar=None, width=1.25, hat="hard hat",
        hat_color=near(0.15, OFF_WHITE, (0.6, 0.42, 0.03), (0.05, 0.15, 0.4)),
        shoes=SHOES[0],
    ),
    "robe": lambda d: dict(
        hem=between(0.93, 0.93), top=d.coat, hem_color=d.coat, flare=1.25, padding=0.008,
        hat="headscarf", collar=None, hat_color=perhaps(0.4, d.coat, d.second_top),
    ),
}  # fmt: skip
"""Values and rules of each style that change an outfit.

``hem`` is the length of a top, coat or skirt down the leg, as a share of the leg.
"""
STYLES: tuple[str, ...] = tuple(_STYLES)
"""Names of the styles."""


def sample_outfit(
    rng: np.random.Generator, style: str, curves: float, *, old: bool = False, child: bool = False
) -> tuple[Outfit, float]:
    """Draw clothes, hair and skin.

    Args:
        rng: generator, advanced.
        style: one of ``STYLES``.
        curves: 0 for a man's build .. 1 for a woman's.
        old: with grey hair.
        child: in brighter colours.

    Returns:
        The outfit, and ``curves``, which is larger with a skirt or dress.

    Raises:
        ValueError: unknown style.
    """
    if style not in STYLES:
        raise ValueError(f"unknown style of clothes {style!r}; {hint(style, STYLES)}")
    if style in ("skirt", "dress", "robe"):
        curves = max(curves, 0.85)
    is_woman = curves > 0.5
    dark = not child and rng.random() < DARK_SHARE
    colors = CLOTHES[:4] if dark else CLOTHES + BRIGHT
    top, legs = pick(rng, colors, 0.35), pick(rng, TROUSERS[:4] if dark else TROUSERS, 0.3)
    has_light_top, has_light_legs = rng.random(2) < (PALE_SHARE, PALE_TROUSERS)
    if has_light_top and not dark:
        top = pick(rng, PALE, 0.2)
    if has_light_legs and not dark:
        legs = pick(rng, PALE, 0.2)
    sole = WHITE_SOLE if rng.random() < 0.45 else BLACK
    hairdos = _WOMENS_HAIR if is_woman else _MENS_HAIR
    outfit = Outfit(
        skin=pick(rng, SKINS, 0.1),
        hair=pick(rng, HAIRS[-1:] if old else HAIRS[:-1] if child else HAIRS, 0.2),
        top=top,
        legs=legs,
        shoes=pick(rng, SHOES),
        sole=sole,
        width=float(rng.choice([1.0, 1.15, 1.25] if is_woman else [1.12, 1.25, 1.4])),
        hairdo=str(rng.choice(hairdos)),
        beard=bool(not is_woman and not child and rng.random() < 0.25),
        collar=pick(rng, BRIGHT + CLOTHES, 0.2) if rng.random() < 0.2 and not child else None,
        hat=str(rng.choice(("", "", "", "", "beanie", "cap", "brim" if old else ""))),
        hat_color=pick(rng, CLOTHES + BRIGHT, 0.3),
    )
    outfit = sample_fields(rng, outfit, **_STYLES[style](_sample_choices(rng, outfit, dark=dark)))
    if rng.random() < VEST_SHARE and style in VESTS:
        outfit = outfit._replace(top=HI_VIS[rng.integers(2)], bands=REFLECTING, shirt=None)
    return outfit, curves


def _sample_choices(rng: np.random.Generator, base: Outfit, *, dark: bool) -> Choices:
    """Draw colours and hair that match the outfit ``base``."""
    second_top = pick(rng, BRIGHT + CLOTHES + PALE, 0.25)
    coat = pick(rng, CLOTHES[:4] if dark else CLOTHES + BRIGHT[:2], 0.3)
    legs = base.skin if rng.random() < 0.5 else CLOTHES[0]
    tied = "ponytail" if base.hairdo in _WOMENS_HAIR[:4] else "short"
    tied_hair = base.hairdo if base.hairdo in ("bald", "bun") else tied
    return Choices(base.top, second_top, coat, coat if dark else second_top, legs, tied_hair)
