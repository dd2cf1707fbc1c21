"""The space, start and method of a configuration's search."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import sdr_jax
from common.errors import UserError, flagged, suggestion
from experiments.config.config import BinsConfig, GroupsConfig
from experiments.config.options import RivalName
from scene.attributes import SpaceName, names
from scene.held import hold
from scene.proposal import NAMES, Mixture, Proposal, Streets, moments, space_in, streets_in
from sdr_jax.registry import make


def make_space(config: BinsConfig) -> sdr_jax.Space:
    """Make the space of the attributes that are not held, with the configuration's bins and groups.

    Raises:
        UserError: the groups are no partition of the space's attributes, or all attributes are held.
    """
    groups, free = None, config.varied
    if not free:
        raise UserError("--fix holds every attribute, which leaves none to search")
    with flagged("--groups"):
        if isinstance(config, GroupsConfig):
            sdr_jax.space(names(config.space), config.search.bins, config.groups)
            free_parts = [[name for name in group if name in free] for group in config.groups]
            groups = [part for part in free_parts if part]
        return sdr_jax.space(free, config.search.bins, groups)


def start_of(config: GroupsConfig) -> Proposal:
    """Return the start of the search, f32[attributes of the space] each; for a histogram its moments.

    Raises:
        UserError: the file holds a mixture, or other attributes.
    """
    start = config.search.start
    if start in NAMES:
        streets = config.streets(start)
    else:
        expected = f"default, random, or an attributes.json{suggestion(start, NAMES)}"
        read = read_attributes("--search.start", Path(start), config.space, expected)
        streets = hold(read, config.held)
    if isinstance(streets, Mixture):
        raise UserError(
            f"--search.start {start} holds {len(streets.shares)} components; a search starts from one"
        )
    return moments(streets)


def read_attributes(
    flag: str, path: Path, space: SpaceName, expected: str = "the attributes.json of a run"
) -> Streets:
    """Read the streets of an ``attributes.json``.

    Raises:
        UserError: there is no such file, or it is of another kind or space; the message names the flag.
    """
    try:
        streets = streets_in(path)
    except OSError as error:
        raise UserError(f"{flag} {path}: {error.strerror}; expected {expected}") from None
    except ValueError as error:
        raise UserError(f"{flag} {error}") from None
    file_space = space_in(streets)
    if file_space != space:
        raise UserError(f"{flag} {path} holds attributes of --space {file_space}, not {space}")
    return streets


def make_method(
    config: GroupsConfig, name: str, space: sdr_jax.Space, updates_per_group: int
) -> sdr_jax.Method:
    """Make the configuration's search method for some of its attributes.

    Raises:
        UserError: an option is out of range, a start cannot be read, or the library or checkout of a rival
            method is missing.
    """
    method_options: dict[str, Any] = {}
    options = config.search
    if name in get_args(RivalName):
        with flagged("--methods"):
            return _rival(name)(space, width=options.relaxation)
    if name == "sdr":
        method_options = {
            "learning_rate": options.learning_rate,
            "baseline": options.baseline,
            "normalise": options.normalise,
            "squared_reward": options.squared_reward,
            "unoptimised": options.unoptimised,
            "updates_per_group": updates_per_group,
        }
    if name == "intervals":
        start = start_of(config)
        indices = [names(config.space).index(attribute) for attribute in space.names]
        method_options["start"] = tuple(tuple(part[indices].tolist()) for part in start)
    with flagged("--search"):
        return make(name, space, options.relaxation, **method_options)


def _rival(name: str) -> Callable[..., sdr_jax.Method]:
    """Return the constructor of a method of another library."""
    try:
        from benchmarks.rivals import RIVALS
    except ModuleNotFoundError as error:
        if error.name not in ("benchmarks", "benchmarks.rivals"):
            raise
        raise ValueError(f"{name} needs a checkout: benchmarks/rivals is not installed") from None
    return RIVALS[name]
