"""Pages of what streets can have in addition to their lines: one theme per row and renderer."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from common.errors import hint
from scene.attributes import BY_NAME, street_params
from scene.dataset.render import street_seed
from scene.preview.layout import Studio, captioned, grid, stack
from scene.proposal import default_proposal, draw
from scene.street.extras import MIX
from scene.street.street import sample_street

SHOWN = 2 / 3
"""Size on the page, as a share of the rendered size."""
VIEW = {
    "field_of_view": 65.0,
    "camera_position_y": 2.2,
    "overcast_share": 0.0,
    "bicycle_interval": 40.0,
    "car_interval": 50.0,
    "tree_interval": 30.0,
}
"""Attributes of all themes: a wide view in fair weather, with little of the lines in its way."""


class Theme(NamedTuple):
    """What default streets get more of."""

    title: str
    attributes: dict[str, float]  # physical values
    mix: dict[str, float]  # shares of ingredients without an attribute, see ``extras.Mix``


THEMES = {
    "islands": Theme("islands and crossings", {}, {"islands": 1.0, "crossing": 1.0}),
    "bends": Theme("bends and slopes", {"bend": 22.0, "gradient": 6.0, "junction_share": 0.0}, {}),
    "parked": Theme("rows of parked cars", {"parked_share": 1.0}, {}),
    "open": Theme("open sides", {"open_share": 1.0}, {}),
    "junctions": Theme("junctions", {"junction_share": 1.0, "queue_share": 0.5}, {}),
}


def themed(theme: Theme, seed: int, streets: int) -> np.ndarray:
    """Unit attributes f32[streets, attributes] of default streets with a theme."""
    rows = draw(default_proposal(space="extended"), seed, streets)
    for name, value in {**VIEW, **theme.attributes}.items():
        rows[:, list(BY_NAME).index(name)] = BY_NAME[name].to_unit(value)
    return rows


def theme_page(name: str, streets: int, seed: int, studios: list[Studio]) -> np.ndarray:
    """Streets of one theme side by side, the same in a row of each studio, u8[h, w, 3] RGB.

    Raises:
        ValueError: unknown theme.
    """
    if name not in THEMES:
        raise ValueError(f"unknown theme {name!r}; {hint(name, THEMES)}")
    theme, rows = THEMES[name], []
    seed += list(THEMES).index(name)  # different streets for each theme
    mix = MIX._replace(**theme.mix)
    for studio in studios:
        images = []
        for k, unit in enumerate(themed(theme, seed, streets)):
            street = sample_street(street_params(unit), street_seed(seed, k), 1, studio.pool, mix)
            small = cv2.resize(
                studio.shoot(street), None, fx=SHOWN, fy=SHOWN, interpolation=cv2.INTER_AREA
            )
            images.append(captioned(small, f"{theme.title}, {studio.renderer}" if k == 0 else ""))
        rows.append(grid(images, streets))
    return stack(rows)


def all_themes(streets: int, seed: int, studios: list[Studio]) -> np.ndarray:
    """A page with the rows of every theme."""
    return stack([theme_page(name, streets, seed, studios) for name in THEMES])
