"""What every experiment on a named target can be told, and where its defaults come from."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, TypeVar

import sdr_jax
from experiments import config as run_config
from experiments.config import Config, camvid_config, cityscapes_config
from experiments.errors import UserError
from experiments.search import make_method, make_space
from scene.formats.files import read_json
from scene.proposal import parse_proposal


@dataclass(frozen=True, kw_only=True)
class TargetConfig(Config):
    """One run on a target that a flag names."""

    target: Literal["twin", "camvid", "cityscapes"] = "twin"
    """What the nets must be good on."""


@dataclass(frozen=True, kw_only=True)
class StudyConfig(TargetConfig):
    """One study of what learnt attributes are worth."""

    learnt: Path | None = None
    """attributes.json of an earlier run; by default the search runs here."""
    rederive: Path | None = None
    """Only write the table and the figure of this report (NAME.json) anew, into --out."""


AnyTarget = TypeVar("AnyTarget", bound=TargetConfig)


def defaults_on(kind: type[AnyTarget], target: str, preset: str) -> AnyTarget:
    """The defaults that an experiment inherits from the main job on the same target.

    Args:
        kind: class of the configuration; what it adds has defaults of its own.
        target: "twin", "camvid" or "cityscapes".
        preset: "smoke", "quick" or "paper".
    """
    base = (camvid_config if target == "camvid" else cityscapes_config)(preset)
    inherited = {field.name: getattr(base, field.name) for field in fields(base)}
    return kind(**{**inherited, "target": target})


def check_study(config: StudyConfig) -> None:
    """Raise UserError for what no study can work with, by name."""
    run_config.check(config)
    make_method(config.search, make_space(config))
    if config.unlabelled is not None:
        raise UserError(
            "--unlabelled: nets are trained on the real reward images, too; give labels"
        )
    if config.learnt is not None:
        read_learnt(config.learnt)


def read_learnt(path: Path) -> sdr_jax.Proposal:
    """The proposal in an ``attributes.json``, f32[23] each.

    Raises:
        UserError: no such file, or the file of something else.
    """
    try:
        found = parse_proposal(read_json(path))
    except OSError as error:
        raise UserError(f"--learnt {path}: {error.strerror}") from None
    except ValueError as error:
        where = "" if str(error).startswith(str(path)) else f"{path}: "
        raise UserError(f"--learnt {where}{error}") from None
    values: Any = found  # the engine's own kind of proposal, of arrays alike
    return sdr_jax.Proposal(*values)
