"""Full and half assets at several numbers of images: the datasets, and the nets trained on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from experiments import presets
from experiments.assets.report import FORM
from experiments.config import Fidelity, LearntConfig, Preset, TargetName, Unused, refuse_shares
from experiments.run.context import Run, Work
from experiments.run.nets import Nets, paired_seeds, score_lists
from experiments.study.form import Report, about, nets
from experiments.study.skeleton import Study, attributes, learnt_from, learnt_work
from shell.errors import UserError, refuse_repeats

IMAGES = (90, 180, 450, 900, 1350)


@dataclass(frozen=True, kw_only=True)
class AssetsConfig(LearntConfig):
    """One study. Every field is a flag.

    --fractions stand in the place of --asset-fraction, and --images of --final.streets.
    """

    asset_fraction: Annotated[float, *Unused] = 1.0
    images: tuple[int, ...] = IMAGES
    """Images of a training set; multiples of --final.shots, images of a street."""
    fractions: tuple[float, ...] = (1.0, 0.5)
    """Shares of the assets."""
    attributes: Literal["random", "default", "learnt"] = "default"
    """From which streets are drawn: random, set by eye, or learnt (by --learnt, else searched for)."""


def defaults(target: TargetName, preset: Preset) -> AssetsConfig:
    """The defaults of ``python -m experiments.assets``."""
    own: dict[str, Any] = {"images": (2, 4)}
    if preset != "smoke":
        # Ten images of each street, as the paper's presets have it, divide all numbers of images.
        own = {"final": {"streets": 45, "shots": 10}}
    if preset == "quick":
        own["seeds"] = 3
    return presets.defaults(AssetsConfig, target, preset, **own)


def check(config: AssetsConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if not config.images:
        raise UserError("--images needs at least one value")
    refuse_repeats("--images", config.images)
    refuse_shares("--fractions", config.fractions)
    shots = config.final.shots
    for count in config.images:
        if count < 1 or count % shots:
            raise UserError(
                f"--images must be multiples of --final.shots {shots}, the images of a street, "
                f"not {count}"
            )
    if config.learnt is not None and config.attributes != "learnt":
        raise UserError(f"--learnt is of no use with --attributes {config.attributes}")


def fidelity_of(config: AssetsConfig, images: int) -> Fidelity:
    """The final fidelity with another number of images: more streets, not more images of each."""
    return replace(config.final, streets=images // config.final.shots)


def plan(config: AssetsConfig) -> list[Work]:
    """The nets of all datasets, after those of the search, if there is one."""
    what = f"nets, {len(config.fractions)} shares of the assets x {config.seeds} seeds"
    count = len(config.fractions) * config.seeds
    work = [Work.at(what, count, fidelity_of(config, images)) for images in config.images]
    return [*(learnt_work(config) if config.attributes == "learnt" else []), *work]


def scores(run: Run[AssetsConfig], _: None) -> Report:
    """Train the nets of the whole study, or what is left of them."""
    config, proposal = run.config, attributes(run, run.config.attributes)
    places, lists = [], []
    for images in config.images:
        fidelity = fidelity_of(config, images)
        for fraction in config.fractions:
            recipe = run.recipe(fidelity, fraction=fraction)
            what = f"{images} images, {100 * fraction:g} % of the assets"
            lists.append(Nets(what, {"nets": proposal}, recipe))
            places.append({"images": images, "streets": fidelity.streets, "fraction": fraction})
    found = score_lists(run, lists, paired_seeds(run))
    rows = [
        {**place, "nets": nets(outcomes["nets"])}
        for place, outcomes in zip(places, found, strict=True)
    ]
    return {
        **about(run, config.final),
        "learnt_from": learnt_from(config),
        "attributes": config.attributes,
        "steps": config.final.train.steps,
        "rows": rows,
    }


STUDY = Study(FORM, plan, scores, check)
"""What ``python -m experiments.assets`` does."""
