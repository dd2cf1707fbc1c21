"""Full and half assets at several numbers of images: the datasets, the nets, the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import sdr_jax
from experiments import study_report
from experiments.assets_report import FORM
from experiments.config import Stage, refuse_repeats
from experiments.errors import UserError
from experiments.finals import default_proposal, random_proposal
from experiments.main import main_of_study
from experiments.progress import Progress
from experiments.study import Study, Work, learnt_attributes, opened, search_work
from experiments.study_config import StudyConfig, check_study, defaults_on
from experiments.study_nets import score_nets
from scene.command import duration

IMAGES = (90, 180, 450, 900, 1350)


@dataclass(frozen=True, kw_only=True)
class AssetsConfig(StudyConfig):
    """One study. Every field is a flag.

    --fractions stand in the place of --asset-fraction, and --images of --final.streets.
    """

    images: tuple[int, ...] = IMAGES
    """Images of a training set; multiples of --final.shots, images of a street."""
    fractions: tuple[float, ...] = (1.0, 0.5)
    """Shares of the assets."""
    attributes: Literal["random", "default", "learnt"] = "default"
    """From which streets are drawn: random, set by eye, or learnt (by --learnt, else searched for)."""


def assets_config(target: str, preset: str) -> AssetsConfig:
    """The defaults of ``python -m experiments.assets``."""
    config = defaults_on(AssetsConfig, target, preset)
    if preset == "smoke":
        return replace(config, images=(2, 4))
    # Ten images of each street, as the paper's presets have it, divide all these numbers.
    config = replace(config, final=replace(config.final, streets=45, shots=10))
    return config if preset == "paper" else replace(config, seeds=3)


def check(config: AssetsConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    check_study(config)
    if not config.images or not config.fractions:
        raise UserError("--images and --fractions need at least one value each")
    for name in ("images", "fractions"):
        refuse_repeats(f"--{name}", getattr(config, name))
    for fraction in config.fractions:
        if not 0 < fraction <= 1:
            raise UserError(f"--fractions must lie in (0, 1], not {fraction}")
    shots = config.final.shots
    for count in config.images:
        if count < 1 or count % shots:
            raise UserError(
                f"--images must be multiples of --final.shots {shots}, the images of a street, "
                f"not {count}"
            )
    if config.learnt is not None and config.attributes != "learnt":
        raise UserError(f"--learnt is of no use with --attributes {config.attributes}")


def stage_of(config: AssetsConfig, images: int) -> Stage:
    """The final stage with another number of images: more streets, not more images of each."""
    return replace(config.final, streets=images // config.final.shots)


def run(config: AssetsConfig) -> dict[str, Any]:
    """Do the whole study, or what is left of it, and return what ``assets.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    searching = search_work(config) if config.attributes == "learnt" else []
    nets = len(config.fractions) * config.seeds
    with opened(config) as study:
        progress = study.begin(
            [
                *searching,
                *(
                    Work.at(
                        f"nets, {len(config.fractions)} shares of the assets x {config.seeds} seeds",
                        nets,
                        stage_of(config, images),
                    )
                    for images in config.images
                ),
            ]
        )
        proposal = attributes(study, progress)
        rows = []
        for images in config.images:
            stage = stage_of(config, images)
            for fraction in config.fractions:
                own = study._replace(config=replace(config, asset_fraction=fraction))
                kind = f"{images} images, {100 * fraction:g} % of the assets"
                outcomes = score_nets(own, kind, {"nets": proposal}, stage, progress)
                rows.append(
                    {
                        "images": images,
                        "streets": stage.streets,
                        "fraction": fraction,
                        "nets": study_report.nets(outcomes["nets"]),
                    }
                )
        scores = {
            **study_report.about(study, config.final),
            "attributes": config.attributes,
            "steps": config.final.train.steps,
            "rows": rows,
        }
        report = study_report.write(FORM, scores, config.out)
        progress.say(FORM.text(report))
        progress.say(f"Done in {duration(progress.elapsed)}: {config.out / 'assets.md'}")
        return report


def attributes(study: Study[AssetsConfig], progress: Progress) -> sdr_jax.Proposal:
    """From which the streets of all datasets are drawn."""
    config = study.config
    if config.attributes == "learnt":
        return learnt_attributes(study, progress)
    if config.attributes == "random":
        return random_proposal()
    return default_proposal(config.default_width)


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_of_study(FORM, assets_config, run, description, arguments)
