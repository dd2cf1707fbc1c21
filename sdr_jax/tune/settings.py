"""The settings of a run from a TOML file, checked as a whole before anything runs."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from common.errors import UserError, hint
from common.files import read_bytes
from common.memory import refuse_larger
from sdr_jax.registry import METHODS, options_of
from sdr_jax.space import Space
from sdr_jax.space import space as make_space
from sdr_jax.tune.units import Attribute

TYPES = {
    bool: "true or false", int: "a whole number", float: "a number", str: "a string", list: "a list"
}  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """One run; every field but the attributes has a default."""

    attributes: tuple[Attribute, ...]
    groups: tuple[tuple[str, ...], ...] | None = None  # of names, in order; None: one group of all
    method: str = "surrogate"
    method_options: dict[str, Any] = field(default_factory=dict)
    evaluations: int = 200  # in total, a multiple of `datasets_per_update`
    datasets_per_update: int = 8  # evaluated between two updates; no more of them run at once
    relaxation: float | None = None  # width of the relaxed bins, in [0, 1]; None: width of the bins
    seed: int = 0  # of the whole run
    repeats: int = 1  # runs per evaluation, each with its own seed; the score is their mean
    minimize: bool = False  # whether lower scores are better
    timeout_seconds: float = 600.0  # of one run
    retries: int = 1  # further attempts at a failed run
    workers: int = 1  # simulators at once

    def space(self) -> Space:
        """The attributes as a `Space`; raises ValueError as `sdr_jax.space` does."""
        names = [attribute.name for attribute in self.attributes]
        bins = [attribute.bins for attribute in self.attributes]
        unordered = [attribute.name for attribute in self.attributes if attribute.values]
        return make_space(names, bins, self.groups, unordered)


LEAST = {
    "evaluations": 1, "datasets_per_update": 1, "seed": 0, "repeats": 1, "retries": 0, "workers": 1
}  # fmt: skip
MEMORY = {
    "evaluations": 1000, "datasets_per_update": 1000, "repeats": 1000, "retries": 1000,
    "workers": 10_000_000,
}  # fmt: skip
"""The least number of bytes of one record or process."""
MOST_BYTES, MOST_BINS = 1_000_000, 1000
"""The most bytes of a file, and the most bins of an attribute."""
LARGEST_SEED = 2**32 - 1
FLAGS = {"timeout_seconds": "--timeout"}
"""Fields whose flags have other names."""


class _Reader:
    """Returns values of the right type, or raises an error that names their place."""

    def __init__(self, path: Path, flags: Mapping[str, Any]) -> None:
        self._path, self._flags = path, flags

    def at(self, name: str) -> str:
        """The place that sets a field: the file or a flag."""
        return FLAGS.get(name, f"--{name}") if name in self._flags else f"{self._path}: {name}"

    def fail(self, what: str) -> UserError:
        return UserError(f"{self._path}: {what}")

    def refuse(self, name: str, value: object, must: str) -> UserError:
        return UserError(f"{self.at(name)} is {value}, but must {must}")

    def typed(self, value: Any, kind: type, where: str) -> Any:
        """The value as `kind`; a whole number may stand for a number, but true not for 1."""
        fits = type(value) is kind or (kind is float and type(value) is int)
        if not fits or (kind is float and not abs(value) <= sys.float_info.max):
            raise UserError(f"{where} is {value!r}, but must be {TYPES[kind]}")
        return kind(value)

    def refuse_unknown(self, table: Mapping[str, Any], names: list[str], where: str) -> None:
        unknown = [key for key in table if key not in names]
        if unknown:
            choices = ", ".join(names) or "none"
            raise self.fail(f"{where} {unknown[0]!r} is unknown; known: {choices}")


def read(path: Path, flags: Mapping[str, Any]) -> Settings:
    """Read the TOML file.

    Args:
        path: the file.
        flags: fields that the command line sets instead, by name.

    Returns:
        The checked settings; `sdr` gets as many updates per group as its evaluations allow.

    Raises:
        UserError: the first error, with its file or flag.
    """
    reader = _Reader(path, flags)
    table = {**_load(path), **flags}
    names = [f.name for f in fields(Settings)]
    reader.refuse_unknown(table, names, "key")
    values: dict[str, Any] = {
        "attributes": _attributes(reader, table),
        "groups": _groups(reader, table.get("groups")),
    }
    for entry in fields(Settings):
        name = entry.name
        if name in values or name not in table or name == "method_options":
            continue
        kind = float if name in ("relaxation", "timeout_seconds") else type(entry.default)
        value = reader.typed(table[name], kind, reader.at(name))
        if name in LEAST and value < LEAST[name]:
            raise reader.refuse(name, value, f"be at least {LEAST[name]}")
        if name in MEMORY:
            refuse_larger(reader.at(name), value, lambda n: n * MEMORY[name], "as many records")  # noqa: B023
        values[name] = value
    settings = Settings(**values)
    _check(reader, settings)
    return _with_options(reader, settings, table.get("method_options", {}))


def _load(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_bytes(path, MOST_BYTES).decode("utf-8-sig"))
    except OSError as error:
        why = error.strerror or error
        raise UserError(f"{path}: {why}; expected a TOML file with attributes") from None
    except UserError:
        raise
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not TOML: {error}") from None


def _attributes(reader: _Reader, table: Mapping[str, Any]) -> tuple[Attribute, ...]:
    entries = table.get("attributes", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise reader.fail("attributes must be tables [[attributes]]")
    if not entries:
        raise reader.fail("there are no attributes; add one table [[attributes]] for each")
    return tuple(_attribute(reader, entry, number) for number, entry in enumerate(entries, 1))


def _attribute(reader: _Reader, entry: dict[str, Any], number: int) -> Attribute:
    kinds = {"name": str, "bins": int, "low": float, "high": float, "log": bool, "values": list}
    where = f"attribute {number}"
    if "name" not in entry:
        raise reader.fail(f"{where} has no name")
    name = reader.typed(entry["name"], str, reader.at(f"name of {where}"))
    where = f"attribute {name!r}"
    if not name.strip():
        raise reader.fail(f"attribute {number} has an empty name")
    reader.refuse_unknown(entry, list(kinds), f"{where}: key")
    values = {
        key: reader.typed(value, kinds[key], reader.at(f"{where}: {key}"))
        for key, value in entry.items()
    }
    if "values" in values:
        return _of_values(reader, name, values)
    if ("low" in values) != ("high" in values):
        present, missing = ("low", "high") if "low" in values else ("high", "low")
        raise reader.fail(f"{where} has {present}, but not {missing}; set both or neither")
    attribute = Attribute(**values)
    if not 2 <= attribute.bins <= MOST_BINS:
        raise reader.fail(f"{where}: bins is {attribute.bins}, but must lie in 2..{MOST_BINS}")
    if attribute.low >= attribute.high:
        raise reader.fail(
            f"{where}: low is {attribute.low:g} and high is {attribute.high:g}, "
            "but low must be below high"
        )
    if not math.isfinite(attribute.high - attribute.low):
        raise reader.fail(f"{where}: the range from low to high is too large")
    if attribute.log and attribute.low <= 0:
        raise reader.fail(
            f"{where}: low is {attribute.low:g}, but must be above 0 where log = true"
        )
    return attribute


def _of_values(reader: _Reader, name: str, entry: dict[str, Any]) -> Attribute:
    """Read an attribute with named values that have no order."""
    where, values = f"attribute {name!r}", entry["values"]
    extra = [key for key in entry if key not in ("name", "values")]
    if extra:
        raise reader.fail(f"{where} has values, which have no order, so {extra[0]} has no meaning")
    if not all(isinstance(value, str) for value in values) or len(values) < 2:
        raise reader.fail(f"{where}: values is {values!r}, but must be two or more strings")
    if len(values) > MOST_BINS:
        raise reader.fail(f"{where} has {len(values)} values, but at most {MOST_BINS} are possible")
    if len(set(values)) < len(values):
        raise reader.fail(f"{where}: values has a string twice")
    return Attribute(name, len(values), values=tuple(values))


def _groups(reader: _Reader, groups: Any) -> tuple[tuple[str, ...], ...] | None:
    if groups is None:
        return None
    if not isinstance(groups, list) or not all(
        isinstance(group, list) and all(isinstance(name, str) for name in group) for group in groups
    ):
        raise reader.fail('groups must be lists of names, such as [["a", "b"], ["c"]]')
    return tuple(tuple(group) for group in groups)


def _check(reader: _Reader, settings: Settings) -> None:
    try:
        settings.space()
    except ValueError as error:
        raise reader.fail(f"{error}") from None
    if settings.seed > LARGEST_SEED:
        raise reader.refuse("seed", settings.seed, "be below 2^32")
    if settings.relaxation is not None and not 0 <= settings.relaxation <= 1:
        raise reader.refuse("relaxation", f"{settings.relaxation:g}", "lie in [0, 1]")
    if settings.timeout_seconds <= 0:
        raise reader.refuse("timeout_seconds", f"{settings.timeout_seconds:g}", "be above 0")
    if settings.method not in METHODS:
        raise UserError(
            f"{reader.at('method')} {settings.method!r} is unknown; {hint(settings.method, METHODS)}"
        )
    n, total = settings.datasets_per_update, settings.evaluations
    if total % n:
        suggestion = f"{n}" if total < n else f"{total - total % n} or {total - total % n + n}"
        must = f"be a multiple of datasets_per_update = {n}, such as {suggestion}"
        raise reader.refuse("evaluations", total, must)


def _with_options(reader: _Reader, settings: Settings, options: Any) -> Settings:
    if not isinstance(options, dict):
        raise reader.fail("method_options must be a table [method_options]")
    # The start of `intervals` is two arrays, which the file has no key for.
    defaults = {k: v for k, v in options_of(settings.method).items() if k != "start"}
    reader.refuse_unknown(options, list(defaults), f"method_options: option of {settings.method}")
    checked = {}
    for name, value in options.items():
        default = defaults[name]
        kind = int if default is None else type(default)
        checked[name] = reader.typed(value, kind, reader.at(f"method_options: {name}"))
    updates = settings.evaluations // settings.datasets_per_update
    if settings.method == "sdr":
        count = len(settings.space().groups)
        per_group = checked.setdefault("updates_per_group", math.ceil(updates / count))
        if updates > per_group * count:
            raise UserError(
                f"{reader.at('evaluations')} is {settings.evaluations}, but sdr with "
                f"updates_per_group = {per_group} takes {count} groups x {per_group} updates x "
                f"{settings.datasets_per_update} = {count * per_group * settings.datasets_per_update}"
            )
        if updates <= per_group * (count - 1):
            whole = count * settings.datasets_per_update
            low = settings.evaluations // whole * whole
            suggestion = " or ".join(str(total) for total in (low, low + whole) if total)
            if "updates_per_group" in options:
                reach = per_group * (count - 1) * settings.datasets_per_update
                suggestion = f"more than {reach}, or a smaller updates_per_group"
            raise UserError(
                f"{reader.at('evaluations')} is {settings.evaluations}, with which sdr never reaches the "
                f"last of {count} groups; use {suggestion}"
            )
    return replace(settings, method_options=checked)
