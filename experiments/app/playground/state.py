"""The state of a page: intervals of attributes, and which image of which street. All here is pure."""

from __future__ import annotations

import shlex
from typing import NamedTuple

import numpy as np

from common.command import PROGRAM
from scene.assets.catalogue import AssetPool, check_pool
from scene.attributes import BY_NAME, SPACES, SpaceName, space_of
from scene.proposal import (
    Histogram,
    Proposal,
    Streets,
    components,
    draw,
    mixture,
    moments,
    named,
    slide,
)
from scene.render import RenderSettings, check_settings

GROUPS: dict[str, tuple[str, ...]] = {
    "Light and weather": (
        "illumination_intensity",
        "illumination_angle_x",
        "illumination_angle_y",
        "overcast_share",
    ),
    "Camera": (
        "camera_position_probability",
        "camera_position_x",
        "camera_position_y",
        "camera_rotation_x",
        "camera_rotation_y",
        "field_of_view",
        "camera_roll",
        "exposure",
        "white_balance",
    ),
    "Distance from the centre line": tuple(
        name for name in BY_NAME if name.endswith("_position") and name != "camera_position"
    ),
    "Spacing": (
        "building_probability",
        *(name for name in BY_NAME if name.endswith("_interval")),
    ),
    "Road": ("road_width", "sidewalk_width", "bend", "gradient", "junction_share"),
    "Roadside": ("parked_share", "queue_share", "open_share", "bare_tree_share"),
    "Ground": ("asphalt_sidewalk_share", "green_verge_share", "road_wear"),
}
"""Every attribute once, by group; a group shows those of the space in use."""
MOST_STREETS, MOST_SHOTS, MOST_PIXELS = 1000, 60, 2_100_000
SEEDS = 2**32
FILE = "street.json"
"""The file from which a copied command reads attributes that are neither default nor random."""
LOSS = (
    "the file has probabilities, which sliders cannot show; they show, and save, intervals of the same mean "
    "and variance"
)
"""The message for streets with probabilities."""


class View(NamedTuple):
    """One image of one street of the dataset with a seed."""

    seed: int = 0
    street: int = 0
    shot: int = 0
    shots: int = 6  # of every street
    width: int = 480
    height: int = 270
    samples: int = 2  # rays per pixel along each axis
    pool: AssetPool = AssetPool()

    @property
    def settings(self) -> RenderSettings:
        """The size and quality of images and datasets."""
        return RenderSettings(self.width, self.height, self.samples)


class State(NamedTuple):
    """The components of a mixture, one of which is shown and changed."""

    shares: tuple[float, ...]
    proposals: tuple[Proposal, ...]  # f32[attributes] each
    component: int = 0
    view: View = View()

    @property
    def proposal(self) -> Proposal:
        """The component that is shown."""
        return self.proposals[self.component]

    @property
    def space(self) -> SpaceName:
        """The space of all components."""
        return space_of(len(self.proposal.centre))

    @property
    def streets(self) -> Streets:
        """The streets to save and to render datasets from."""
        return mixture(self.shares, self.proposals)

    @property
    def unit(self) -> np.ndarray:
        """The attributes f32[attributes] of the street in view, sampled from the component that is shown."""
        return draw(self.proposal, self.view.seed, 1, self.view.street)[0]


def opened(streets: Streets, view: View) -> State:
    """The state that shows the first component of ``streets``; moments replace a histogram."""
    shares, proposals = zip(*components(streets), strict=True)
    return State(shares, tuple(map(moments, proposals)), 0, view)


def has_probabilities(streets: Streets) -> bool:
    """Whether ``streets`` has histograms, which sliders cannot show."""
    return any(isinstance(component, Histogram) for _, component in components(streets))


def interval(state: State, name: str) -> tuple[float, float]:
    """The ends of an attribute's interval, in unit values."""
    where = list(BY_NAME).index(name)
    centre, width = (float(part[where]) for part in state.proposal)
    return max(centre - width / 2, 0.0), min(centre + width / 2, 1.0)


def moved(state: State, name: str, low: float, high: float) -> State:
    """The state with one attribute between two unit values; the others keep every bit."""
    where = list(BY_NAME).index(name)
    centre, width = (part.copy() for part in state.proposal)
    centre[where], width[where] = (low + high) / 2, high - low
    return replaced(state, slide(centre, width))


def replaced(state: State, proposal: Proposal) -> State:
    """The state with another proposal in place of the component that is shown."""
    proposals = list(state.proposals)
    proposals[state.component] = proposal
    return state._replace(proposals=tuple(proposals))


def set_to(state: State, name: str) -> State:
    """The state with ``random`` or ``default`` as the component in view; see ``scene.proposal.named``."""
    return replaced(state, named(name, state.space))


def centred(state: State) -> State:
    """The state with every interval in the middle of its range, as wide as before."""
    return replaced(state, slide(np.full_like(state.proposal.centre, 0.5), state.proposal.width))


def restored(state: State, name: str, first: State) -> State:
    """The state with one attribute copied from another state of the same components."""
    where = list(BY_NAME).index(name)
    centre, width = (part.copy() for part in state.proposal)
    centre[where], width[where] = (part[where] for part in first.proposals[state.component])
    return replaced(state, Proposal(centre, width))


def as_before(state: State, name: str, first: State) -> bool:
    """Whether one attribute equals that of another state of the same components."""
    where = list(BY_NAME).index(name)
    now, before = state.proposal, first.proposals[state.component]
    return all(a[where] == b[where] for a, b in zip(now, before, strict=True))


def enlarged(view: View, width: int, height: int) -> View:
    """The view with a larger image of the same shape that fills a window, with at most `MOST_PIXELS`."""
    most = (MOST_PIXELS / (view.width * view.height)) ** 0.5
    scale = min(width / view.width, height / view.height, most)
    if scale <= 1:
        return view
    return view._replace(width=int(view.width * scale), height=int(view.height * scale))


def name_of(state: State) -> str | None:
    """The name of the component in view for `sdr-jax render`; None if it needs a file."""
    for name in ("default", "random"):
        if all(map(np.array_equal, named(name, state.space), state.proposal)):
            return name
    return None


def command(state: State) -> str:
    """The command whose last image is the one in view; other attributes than named ones are in `FILE`.

    It has no flags for families that are left out and for the first index.
    """
    view, name = state.view, name_of(state)
    flags: dict[str, object] = {"attributes": name or FILE}
    if name and state.space != "scenex":
        flags["space"] = state.space
    flags |= {"seed": view.seed, "shots": view.shots}
    flags |= {"images": view.street * view.shots + view.shot + 1}
    flags |= {"size": f"{view.width}x{view.height}", "samples": view.samples}
    usual, pool = AssetPool(), view.pool
    for flag, value, default in (
        ("assets", pool.own, usual.own),
        ("asset-use", pool.use, usual.use),
        ("asset-fraction", pool.fraction, usual.fraction),
        ("asset-count", pool.size, usual.size),
    ):
        if value != default:
            flags[flag] = value
    words = [PROGRAM, "render", *(w for k, v in flags.items() for w in (f"--{k}", str(v)))]
    return shlex.join([*words, "--out", "street"])


def shown(state: State, name: str, unit: np.ndarray) -> tuple[str, str]:
    """An attribute's interval, and its value in a street f32[attributes], as physical values."""
    row, (low, high) = BY_NAME[name], interval(state, name)
    ends = [f"{row.physical(end):.3g}" for end in (low, high)]
    measure = "" if row.unit in ("probability", "share") else f" {row.unit}"
    sampled = row.physical(float(unit[list(BY_NAME).index(name)]))
    return " – ".join(dict.fromkeys(ends)) + measure, f"{sampled:.3g}"


def rows(space: SpaceName) -> dict[str, tuple[str, ...]]:
    """The attributes of a space by group; groups without any are left out."""
    of_space = {row.name for row in SPACES[space]}
    groups = {title: tuple(n for n in names if n in of_space) for title, names in GROUPS.items()}
    return {title: names for title, names in groups.items() if names}


def restocked(pool: AssetPool, name: str, value: float | None) -> AssetPool:
    """Set a pool's ``first`` or ``size`` to the number in its box; None, of an empty box, is no first."""
    if value is None:
        return pool if name == "first" else pool._replace(size=None)
    return pool._replace(**{name: int(value)})  # type: ignore[arg-type]


def check_view(view: View) -> View:
    """Check a view, and return it.

    Raises:
        ValueError: a field is out of range; the message names it.
        LibraryError: own assets cannot be used; see ``scene.assets.library``.
    """
    limits = {
        "seed": (0, SEEDS - 1),
        "street": (0, MOST_STREETS - 1),
        "shots": (1, MOST_SHOTS),
        "shot": (0, view.shots - 1),
    }
    for name, (low, high) in limits.items():
        if not low <= getattr(view, name) <= high:
            raise ValueError(f"{name} must be {low} to {high}, not {getattr(view, name)}")
    check_settings(view.settings)
    if view.width * view.height > MOST_PIXELS:
        raise ValueError(
            f"size {view.width}x{view.height} is too large: at most {MOST_PIXELS:,} pixels"
        )
    check_pool(view.pool)
    return view
