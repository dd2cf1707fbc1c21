"""Weathers by name: clouds, light, visibility and wetness."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

Range = tuple[float, float]
Colour = tuple[float, float, float]


class Weather(NamedTuple):
    """One row of the table; colours are linear RGB under a nominal sun, 1 is a sunlit white wall."""

    name: str
    clouds: str  # kind of cloud map, see ``clouds.KINDS``
    cover: Range  # share of the sky in cloud
    scale: Range  # size of the cloud map overhead, in heights of the cloud base
    lift: float  # how upright clouds stand at the horizon: 0.1 a flat deck .. 0.5 towers
    crisp: Range  # sharpness of cloud edges; 2 melts, 40 cuts
    opacity: float  # of a cloud's thick parts, 0 a veil .. 1 hides the blue
    relief: float  # contrast of a cloud's bright and dark sides, 0 .. 1
    zenith: Colour
    horizon: Colour
    cloud: Colour
    sun: float  # share of the sunlight that comes through, 1 under a blue sky
    haze: Range  # metres
    wetness: Range
    below: float  # only under a sun lower than this, degrees
    weight: float = 1.0  # how often it is drawn, against the others
    snow: float = 0.0  # share of level ground that it covers
    lamps: float = 0.0  # how bright street lamps and windows are


# fmt: off
# ruff: noqa: E501
SKIES: tuple[Weather, ...] = (
    Weather("fair cumulus",     "heaps",   (.16, .34), (3.2, 4.6), .42, (14, 40), 1.0, .42, (.15, .27, .47), (.38, .52, .70), (1.09, 1.10, 1.12), .95, (1200, 4000), (0, 0), 90),
    Weather("bright overcast",  "sheet",   (.96, .99), (3.0, 5.0), .22, (2, 4),   1.0, .10, (1.10, 1.15, 1.20), (.75, .77, .78), (1.50, 1.52, 1.56), .10, (900, 3000), (0, .1), 90),
    Weather("clear",            "streaks", (.02, .08), (3.0, 5.0), .20, (2, 4),   .35, .05, (.14, .25, .47), (.39, .53, .70), (.98, 1.00, 1.03), 1.0, (1500, 5000), (0, 0), 90),
    Weather("dark stratocumulus", "fleece", (.80, .93), (3.0, 4.6), .20, (5, 9),  1.0, .55, (.22, .30, .38), (.31, .34, .33), (.34, .38, .42), .05, (1200, 4000), (0, .3), 90),
    Weather("veiled sun",       "streaks", (.75, .95), (3.0, 5.0), .22, (1, 2),   .75, .08, (.33, .45, .63), (.62, .70, .80), (.81, .83, .88), .55, (900, 3000), (0, 0), 90),
    Weather("rain",             "rags",    (.96, .99), (2.6, 4.0), .18, (3, 5),   1.0, .40, (.30, .33, .36), (.23, .24, .26), (.40, .43, .46), .02, (300, 900), (.7, 1), 90, 0.5),
    Weather("broken cloud",     "fleece",  (.42, .68), (2.6, 4.2), .30, (7, 16),  1.0, .45, (.15, .26, .45), (.42, .55, .69), (.90, .93, .98), .70, (900, 3500), (0, .2), 90),
    Weather("low gold",         "streaks", (.15, .45), (3.0, 5.0), .20, (2, 5),   .65, .15, (.18, .25, .39), (.78, .59, .43), (.88, .70, .56), .95, (800, 3000), (0, 0), 22),
    Weather("mist",             "sheet",   (.97, .99), (3.0, 5.0), .40, (1, 2),   1.0, .03, (.85, .88, .90), (.59, .60, .61), (.92, .95, .97), .06, (150, 450), (.2, .6), 90, 0.25),
    Weather("cirrus",           "streaks", (.25, .55), (2.6, 4.6), .20, (2, 5),   .70, .10, (.14, .26, .47), (.40, .53, .69), (1.05, 1.06, 1.09), .90, (1200, 4000), (0, 0), 90),
    Weather("dull overcast",    "sheet",   (.95, .99), (2.6, 4.2), .18, (3, 5),   1.0, .28, (.55, .60, .66), (.41, .43, .44), (.70, .74, .79), .04, (700, 2500), (0, .4), 90),
    Weather("towering cumulus", "heaps",   (.36, .54), (2.0, 2.8), .60, (20, 45), 1.0, .55, (.14, .24, .44), (.38, .51, .67), (1.05, 1.07, 1.11), .85, (1200, 4000), (0, .2), 90),
    Weather("dusk",             "fleece",  (.35, .80), (2.8, 4.6), .20, (4, 8),   .95, .40, (.10, .15, .27), (.52, .40, .34), (.20, .20, .25), .18, (800, 3000), (0, .4), 16),
    Weather("hazy",             "sheet",   (.10, .30), (3.0, 5.0), .25, (1, 2),   .40, .05, (.31, .43, .60), (.58, .65, .74), (.75, .78, .84), .80, (350, 900), (0, 0), 90, 0.7),
    Weather("mackerel",         "ripples", (.45, .70), (2.6, 3.8), .22, (4, 8),   .85, .25, (.15, .26, .45), (.41, .54, .69), (.98, 1.00, 1.03), .75, (900, 3000), (0, 0), 90),
    Weather("after rain",       "fleece",  (.55, .75), (2.4, 3.6), .34, (9, 18),  1.0, .60, (.12, .22, .41), (.37, .49, .64), (.64, .69, .77), .80, (1500, 5000), (.5, .9), 90, 0.4),
)
FOG = Weather("fog",            "sheet",   (.97, .99), (3.0, 5.0), .40, (1, 2),   1.0, .02, (.82, .84, .86), (.60, .61, .62), (.90, .92, .94), .03, (35, 130), (.1, .5), 90)
SNOW = Weather("snow",          "sheet",   (.96, .99), (3.0, 5.0), .25, (1, 2),   1.0, .06, (.86, .90, .95), (.62, .65, .68), (.95, .98, 1.02), .06, (150, 900), (0, 0), 90, snow=.9)
NIGHT = Weather("night",        "fleece",  (.30, .80), (2.6, 4.2), .25, (5, 12),  1.0, .30, (.003, .004, .007), (.012, .010, .009), (.010, .008, .007), .001, (800, 3000), (0, .4), 90, lamps=1.0)
# fmt: on
REQUESTED: dict[str, tuple[Weather, ...]] = {
    "clear": tuple(w for w in SKIES if w.name in ("clear", "fair cumulus", "cirrus")),
    "fog": (FOG,),
    "rain": tuple(w for w in SKIES if w.name == "rain"),
    "snow": (SNOW,),
    "night": (NIGHT,),
}
"""Weathers that can be requested by name; fog, snow and night occur in no other way."""


CLOSED = 0.1
"""Largest share of the sunlight that comes through a closed cloud cover."""


def sample_weather(
    rng: np.random.Generator,
    elevation: float,
    share: float = 1.0,
    closed: bool | None = None,
    weather_name: str = "",
) -> Weather:
    """Draw one of the first ``share`` of ``SKIES`` that suits a sun at ``elevation`` radians.

    ``closed`` restricts the choice to skies under closed cloud, or to the others, if there are any.
    ``weather_name`` restricts it to those of ``REQUESTED``. Both draw the same numbers, so that nothing else
    changes.

    A sky of the low sun is kept with a probability that falls from 1 at the horizon to 0 at its limit;
    otherwise another one replaces it.
    """
    choices = SKIES[: max(1, round(share * len(SKIES)))]
    if weather_name:
        choices, closed = REQUESTED[weather_name], None
    if closed is not None:
        choices = tuple(w for w in choices if (w.sun <= CLOSED) == closed) or choices
    weather = _weighted(choices, rng.random())
    chance, other = rng.random(), rng.random()
    height = math.degrees(elevation)
    if weather.below >= 90 or chance < 1 - height / weather.below:
        return weather
    usual = [w for w in choices if w.below >= 90] or choices
    return _weighted(usual, other)


def _weighted(weathers: Sequence[Weather], share: float) -> Weather:
    """Choose a weather by its weight and a number ``share`` in [0, 1)."""
    weights = list(accumulate(weather.weight for weather in weathers))
    return weathers[bisect_right(weights, share * weights[-1])]
