"""Clothes by style: the colours people really wear, and what goes with what."""

from __future__ import annotations

import numpy as np

from scene.assets.parts.human import Outfit
from scene.assets.parts.palette import BLACK, REFLECTING, WHITE_SOLE, pick
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
"""Muted ones, as most people wear."""
BRIGHT: tuple[Color, ...] = (
    (0.380, 0.020, 0.025), (0.030, 0.120, 0.400), (0.050, 0.230, 0.110), (0.480, 0.280, 0.020),
    (0.400, 0.100, 0.170), (0.560, 0.550, 0.530), (0.130, 0.280, 0.430), (0.200, 0.060, 0.230),
    (0.450, 0.150, 0.030),
)  # fmt: skip
PALE: tuple[Color, ...] = (
    (0.700, 0.690, 0.660), (0.560, 0.490, 0.370), (0.480, 0.560, 0.650), (0.640, 0.520, 0.490),
    (0.430, 0.430, 0.430), (0.660, 0.620, 0.480),
)  # fmt: skip
"""Light ones, of summer and of raincoats."""
TROUSERS: tuple[Color, ...] = (
    (0.022, 0.022, 0.023), (0.022, 0.028, 0.050), (0.036, 0.058, 0.105), (0.040, 0.040, 0.042),
    (0.150, 0.117, 0.078), (0.072, 0.098, 0.137), (0.046, 0.036, 0.026), (0.104, 0.104, 0.104),
)  # fmt: skip
SHOES: tuple[Color, ...] = ((0.022, 0.021, 0.020), (0.039, 0.023, 0.013), (0.325, 0.325, 0.319),
                            (0.039, 0.046, 0.065), (0.130, 0.072, 0.033))  # fmt: skip
DARK_SHARE = 0.6
"""How many adults wear black, navy or charcoal over dark trousers, seen in photos of streets."""
PALE_SHARE, PALE_TROUSERS = 0.5, 0.25
"""Of the others, how many wear a light top, and light trousers."""
VEST_SHARE = 0.03
"""How many of those in a jacket or coat wear a reflecting vest over it."""
VESTS = ("jacket", "puffer", "short coat", "hoodie")
_WOMENS_HAIR = ("bob", "long", "long", "ponytail", "bun", "curly", "short")
_MENS_HAIR = ("short", "short", "short", "thick", "bald", "curly")
HI_VIS: tuple[Color, ...] = ((0.52, 0.66, 0.04), (0.75, 0.20, 0.02))

# How far down the leg a top, coat or skirt hangs, as a share of the leg: least and most.
_HEMS: dict[str, tuple[float, float]] = {
    "jacket": (0.06, 0.22), "jumper": (0.04, 0.14), "hoodie": (0.06, 0.18), "hood": (0.08, 0.24),
    "t-shirt": (0.05, 0.16), "t-shirt and shorts": (0.05, 0.16), "puffer": (0.06, 0.26),
    "suit": (0.12, 0.18), "short coat": (0.22, 0.38), "long coat": (0.5, 0.72),
    "skirt": (0.35, 0.8), "dress": (0.4, 0.85), "sports": (0.03, 0.1), "work": (0.06, 0.2),
    "robe": (0.93, 0.93),
}  # fmt: skip
STYLES: tuple[str, ...] = tuple(_HEMS)
"""Names that ``sample_outfit`` knows."""


def sample_outfit(
    rng: np.random.Generator, style: str, curves: float, *, old: bool = False, child: bool = False
) -> tuple[Outfit, float]:
    """Draw clothes, hair and skin.

    Args:
        rng: generator, moved on.
        style: one of ``STYLES``.
        curves: 0 for a man's build to 1 for a woman's.
        old: grey hair.
        child: bright colours.

    Returns:
        The outfit, and ``curves``, which a skirt or a dress raises.

    Raises:
        ValueError: unknown style.
    """
    if style not in STYLES:
        raise ValueError(f"unknown style of clothes {style!r}; known: {', '.join(STYLES)}")
    if style in ("skirt", "dress", "robe"):
        curves = max(curves, 0.85)
    woman = curves > 0.5
    dark = not child and rng.random() < DARK_SHARE
    colors = CLOTHES[:4] if dark else CLOTHES + BRIGHT
    top, legs = pick(rng, colors, 0.35), pick(rng, TROUSERS[:4] if dark else TROUSERS, 0.3)
    light, lighter = rng.random(2) < (PALE_SHARE, PALE_TROUSERS)
    if light and not dark:
        top = pick(rng, PALE, 0.2)
    if lighter and not dark:
        legs = pick(rng, PALE, 0.2)
    pale = WHITE_SOLE if rng.random() < 0.45 else BLACK
    dos = _WOMENS_HAIR if woman else _MENS_HAIR
    outfit = Outfit(
        skin=pick(rng, SKINS, 0.1),
        hair=pick(rng, HAIRS[-1:] if old else HAIRS[:-1] if child else HAIRS, 0.2),
        top=top,
        legs=legs,
        shoes=pick(rng, SHOES),
        sole=pale,
        width=float(rng.choice([1.0, 1.15, 1.25] if woman else [1.12, 1.25, 1.4])),
        hairdo=str(rng.choice(dos)),
        beard=bool(not woman and not child and rng.random() < 0.25),
        collar=pick(rng, BRIGHT + CLOTHES, 0.2) if rng.random() < 0.2 and not child else None,
        hat=str(rng.choice(("", "", "", "", "beanie", "cap", "brim" if old else ""))),
        hat_color=pick(rng, CLOTHES + BRIGHT, 0.3),
    )
    outfit = _styled(rng, outfit, style, dark)
    if rng.random() < VEST_SHARE and style in VESTS:
        outfit = outfit._replace(top=HI_VIS[rng.integers(2)], bands=REFLECTING, shirt=None)
    return outfit, curves


def _styled(rng: np.random.Generator, base: Outfit, style: str, dark: bool) -> Outfit:
    """The outfit with what its style fixes."""
    other = pick(rng, BRIGHT + CLOTHES + PALE, 0.25)
    warm = pick(rng, CLOTHES[:4] if dark else CLOTHES + BRIGHT[:2], 0.3)
    bare = rng.random() < 0.5
    dress = warm if dark else other
    base = base._replace(hem=float(rng.uniform(*_HEMS[style])))
    match style:
        case "jacket":
            return base._replace(padding=0.008, shirt=other if rng.random() < 0.6 else None,
                                 accent=warm if rng.random() < 0.2 else None)  # fmt: skip
        case "jumper":
            return base._replace(padding=0.005, accent=other if rng.random() < 0.35 else None,
                                 stripes=bool(rng.random() < 0.6))  # fmt: skip
        case "hoodie":
            return base._replace(padding=0.008, collar=base.top)
        case "hood":
            return base._replace(padding=0.010, hat="hood", hat_color=base.top, collar=base.top)
        case "t-shirt":
            return base._replace(top=other, sleeves=0.42, collar=None,
                                 stripes=bool(rng.random() < 0.2),
                                 accent=warm if rng.random() < 0.3 else None)  # fmt: skip
        case "t-shirt and shorts":
            return base._replace(top=other, sleeves=0.42, trousers=float(rng.uniform(0.35, 0.5)),
                                 width=1.3, collar=None, legs=pick(rng, TROUSERS + BRIGHT[:3], 0.3),
                                 shoes=pick(rng, SHOES[2:]), sole=WHITE_SOLE)  # fmt: skip
        case "puffer":
            return base._replace(padding=0.022, quilted=True, collar=base.top)
        case "suit":
            suit = pick(rng, (CLOTHES[0], CLOTHES[1], CLOTHES[2], (0.10, 0.10, 0.105)), 0.3)
            return base._replace(top=suit, legs=suit, shirt=(0.55, 0.56, 0.58), padding=0.006,
                                 shoes=SHOES[0], sole=BLACK, hat="",
                                 collar=None)  # fmt: skip
        case "short coat":
            return base._replace(padding=0.011, flare=1.1,
                                 shirt=other if rng.random() < 0.25 else None)  # fmt: skip
        case "long coat":
            return base._replace(padding=0.012, top=warm,
                                 flare=float(rng.uniform(1.1, 1.5)))  # fmt: skip
        case "skirt":
            legs = base.skin if bare else CLOTHES[0]
            return base._replace(legs=legs, trousers=1.0, width=0.88, hem_color=dress,
                                 flare=float(rng.uniform(1.1, 1.8)))  # fmt: skip
        case "dress":
            legs = base.skin if bare else CLOTHES[0]
            return base._replace(top=dress, legs=legs, width=0.88, collar=None, hat="",
                                 sleeves=float(rng.choice([0.3, 0.42, 1.0])), hem_color=dress,
                                 flare=float(rng.uniform(1.2, 1.9)))  # fmt: skip
        case "sports":
            return base._replace(top=pick(rng, BRIGHT), sleeves=0.4, collar=None, hat="", width=0.95,
                                 trousers=float(rng.choice([0.4, 0.8, 1.0])),
                                 legs=pick(rng, TROUSERS[:4]), shoes=pick(rng, BRIGHT),
                                 sole=WHITE_SOLE,
                                 hairdo=base.hairdo if base.hairdo in ("bald", "bun") else "ponytail"
                                 if base.hairdo in _WOMENS_HAIR[:4] else "short")  # fmt: skip
        case "work":
            vis = HI_VIS[rng.integers(2)]
            full = rng.random() < 0.4
            return base._replace(top=vis, bands=REFLECTING, padding=0.010, collar=None,
                                 legs=vis if full else base.legs, width=1.25, hat="hard hat",
                                 hat_color=pick(rng, ((0.6, 0.6, 0.58), (0.6, 0.42, 0.03),
                                                      (0.05, 0.15, 0.4))),
                                 shoes=SHOES[0])  # fmt: skip
        case _:  # robe
            return base._replace(top=warm, hem_color=warm, flare=1.25, padding=0.008,
                                 hat="headscarf", collar=None,
                                 hat_color=warm if rng.random() < 0.4 else other)  # fmt: skip
