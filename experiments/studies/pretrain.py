"""Measure how many real images pre-training on SceneX saves, by fine-tuning on growing shares of them.

    sdr-jax study pretrain --target camvid --data DIR --holdout 0006R0
    sdr-jax study pretrain --target camvid --data DIR --fractions 0.05 1.0 --seeds 8
    sdr-jax study pretrain --target twin --preset smoke                  # a minute or two
    sdr-jax study pretrain --rederive runs/a/pretrain.json --out runs/b  # no training

Networks from scratch (or from ImageNet weights, with --final.train.weights) and networks pre-trained on
random and on optimised streets are fine-tuned in the same way on 5, 10, 25 and 100 % of the real images and
tested on the test images; Welch's t-test over seeds says which differences are significant. The search runs
first, unless --learnt names the streets of an earlier run. The same command resumes a killed run.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from common.errors import UserError
from experiments.attribute_search.loop import learn
from experiments.config import Fidelity
from experiments.config.cli import command
from experiments.config.jobs import PretrainConfig
from experiments.evaluation.job import Job, LabelledSubset, Recipe, Result, Start
from experiments.session.session import Session, Work
from experiments.studies.figure import curves
from experiments.tables.form import (
    Column,
    Form,
    Report,
    about,
    class_means,
    estimate,
    failures,
    introduction,
    miou,
    nets,
    number,
    table,
    target_of,
)
from experiments.tables.nets import paired_seeds
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.skeleton import Study, learnt_attributes, learnt_from, learnt_work
from experiments.tables.stats import holm, stars, statistics, welch
from experiments.targets.base import Target, with_reward
from scene.proposal import Streets
from seg.data import subset

SUBSET_STREAM = 3
"""Second word of the seed that chooses images; the networks' streams have others."""
RENDERED = ("random", "learnt")
"""Rows that are pre-trained on rendered images."""
COMPARED = (
    ("learnt", "scratch"),
    ("random", "scratch"),
    ("learnt", "random"),
    ("learnt", "longer"),
    ("random", "longer"),
)
"""Pairs of rows for the tests."""


def fine_fidelity(config: PretrainConfig) -> Fidelity:
    """Return the final fidelity with the settings of the fine-tuning."""
    train = config.final.train
    steps = max(train.steps // 3, 1) if config.finetune_steps is None else config.finetune_steps
    lr = train.lr / 3 if config.finetune_lr is None else config.finetune_lr
    fine = replace(train, steps=steps, lr=lr, warmup=min(train.warmup, steps // 2))
    return replace(config.final, train=fine)


def check(config: PretrainConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if config.learn_on == "share" and config.learnt is not None:
        raise UserError(
            "--learnt has no effect with --learn-on share, which searches on each share"
        )
    if config.learnt is not None and "learnt" not in config.rows:
        raise UserError(f"--learnt has no effect with --rows {' '.join(config.rows)}")


def refuse_empty(config: PretrainConfig, target: Target) -> None:
    """Raise UserError for a fraction that selects no image."""
    images = len(target.reward_names)
    for fraction in config.fractions:
        if chosen_images(images, fraction) == 0:
            raise UserError(
                f"--fractions {fraction:g} selects none of the {images} real images; "
                f"{1 / images:.2g} or more selects one"
            )


def plan(config: PretrainConfig, _: None) -> list[Work]:
    """Plan the search, then the networks of every row."""
    fine, fractions, seeds = fine_fidelity(config), len(config.fractions), config.seeds
    work = learnt_work(config) if "learnt" in config.rows else []
    if config.learn_on == "share":
        work = [
            stage._replace(what=f"{stage.what}, {100 * fraction:g} %")
            for fraction in config.fractions
            for stage in work
        ]
    rendered = sum(row in RENDERED for row in config.rows)
    if rendered:
        # With a search for each share, each share also has its own pre-training.
        more = (fractions - 1) * (config.learn_on == "share" and "learnt" in config.rows)
        what = f"pre-training, {rendered} rows x {seeds} seeds"
        work.append(Work.at(what, (rendered + more) * seeds, config.final))
    if "longer" in config.rows:
        what = f"longer, {fractions} fractions x {seeds} seeds"
        work.append(Work.on_images(what, fractions * seeds, config.final))
    what = f"fine-tuning, {len(config.rows)} rows x {fractions} fractions x {seeds} seeds"
    count = len(config.rows) * fractions * seeds
    return [*work, Work.on_images(what, count, fine)]


def scores(run: Session[PretrainConfig], _: None) -> Report:
    """Train every network, or the rest of them."""
    config, images = run.config, len(run.target.reward_names)
    proposals: dict[str, Streets] = {"random": config.streets("random")}
    optimised, by_share = "learnt" in config.rows, config.learn_on == "share"
    before, fine = run.recipe(config.final), run.recipe(fine_fidelity(config))
    image_seed = config.seed if by_share else None
    if optimised and not by_share:
        proposals["learnt"] = learnt_attributes(
            replace(run, target=_search_images(config, run.target))
        )
    starts = {
        str(row): Start(before, proposals.get(row), row == "longer", len(config.fractions))
        for row in config.rows
        if row != "learnt" or not by_share
    }
    results = fine_tune(run, starts, fine, config.fractions, image_seed)
    for fraction in config.fractions if optimised and by_share else ():
        part = replace(run, target=_share(config, run.target, fraction))
        # All digits: another fraction has another search.
        name = f"learnt-{fraction!r}".removesuffix(".0")
        start = Start(before, learn(part, name=name).solution)
        results |= fine_tune(run, {"learnt": start}, fine, [fraction], image_seed)
    train = fine.fidelity.train
    rows = []
    for row in config.rows:
        for fraction in config.fractions:
            place = {"row": row, "fraction": fraction, "images": chosen_images(images, fraction)}
            rows.append({**place, "nets": nets(results[row, fraction])})
    return {
        **about(run, config.final),
        "learnt_from": learnt_from(config) if optimised else None,
        "learn_on": config.learn_on,
        "net": train.net,
        "weights": train.weights,
        "search_images": config.search_images,
        "pretraining": {"images": config.final.images, "steps": config.final.train.steps},
        "finetuning": {"steps": train.steps, "lr": train.lr},
        "rows": rows,
    }


def fine_tune(
    run: Session[Any],
    starts: Mapping[str, Start],
    fine: Recipe,
    fractions: Sequence[float],
    image_seed: int | None = None,
) -> dict[tuple[str, float], list[Result]]:
    """Fine-tune ``--seeds`` networks of every row and fraction; results by these, in the order of the seeds.

    Args:
        run: the job.
        starts: starts of the rows by name.
        fine: how all networks are fine-tuned.
        fractions: shares of the real images.
        image_seed: the seed that chooses the images of all networks; by default each network's own.

    Raises:
        UserError: more than a tenth of the networks failed.
    """
    real = run.images(fine.fidelity, "reward")
    jobs = []
    for seed in paired_seeds(run):
        chosen = subsets(len(real.images), fractions, seed if image_seed is None else image_seed)
        parts = [LabelledSubset(real, tuple(indices.tolist())) for indices in chosen]
        for row, start in starts.items():
            for fraction, part in zip(fractions, parts, strict=True):
                notes = {"nets": "pretrain", "row": row, "fraction": fraction, "seed": seed}
                jobs.append(Job(fine, part, seed, notes, start=start))
    results: dict[tuple[str, float], list[Result]] = {}
    for job, result in zip(jobs, run.runner.test(jobs), strict=True):
        results.setdefault((job.notes["row"], job.notes["fraction"]), []).append(result)
    return results


def subsets(images: int, fractions: Sequence[float], seed: int) -> list[np.ndarray]:
    """Choose the images of each fraction, as ascending indices; larger subsets contain smaller ones.

    Args:
        images: the number of images.
        fractions: shares of them in (0, 1].
        seed: seed of the choice.
    """
    order = np.random.default_rng([seed, SUBSET_STREAM]).permutation(images)
    return [np.sort(order[: chosen_images(images, fraction)]) for fraction in fractions]


def chosen_images(images: int, fraction: float) -> int:
    """Return the number of images of a fraction, rounded."""
    return math.floor(images * fraction + 0.5)


def _search_images(config: PretrainConfig, target: Target) -> Target:
    """Keep only the images of the search, those that ``--reward-images`` chooses in other jobs."""
    images = range(len(target.reward_names))
    chosen = subset(images, config.search_images)
    return target if len(chosen) == len(images) else with_reward(target, np.array(chosen))


def _share(config: PretrainConfig, target: Target, fraction: float) -> Target:
    """Keep only the images of a fraction, the same for all seeds."""
    (chosen,) = subsets(len(target.reward_names), [fraction], config.seed)
    return _search_images(config, with_reward(target, chosen))


def derive(report: Report) -> Report:
    """Add means, intervals and tests of the networks' mIoU to the report."""
    rows = [
        {
            **row,
            **statistics(miou(row["nets"])),
            "class_iou": class_means(row["nets"], report["classes"]),
        }
        for row in report["rows"]
    ]
    values = {
        (row["row"], row["fraction"]): [v for v in miou(row["nets"]) if v is not None]
        for row in report["rows"]
    }
    tests = []
    for fraction, (ours, theirs) in product(dict.fromkeys(r["fraction"] for r in rows), COMPARED):
        if (ours, fraction) in values and (theirs, fraction) in values:
            result = welch(values[ours, fraction], values[theirs, fraction])
            test = {"fraction": fraction, "row": ours, "against": theirs}
            tests.append({**test, "stars": ""} if result is None else {**test, **result._asdict()})
    done = [test for test in tests if "p_value" in test]
    for test, p_value in zip(done, holm([test["p_value"] for test in done]), strict=True):
        test |= {"p_corrected": p_value, "stars": stars(p_value)}
    return {**report, "rows": rows, "tests": tests}


def start_names(report: Report) -> dict[str, str]:
    """Describe how each row's networks start."""
    scratch = "ImageNet weights" if report["weights"] else "scratch"
    return {
        "scratch": scratch,
        "longer": f"{scratch}, as many steps",
        **{row: f"SceneX, {TRAINED_ON[row]}" for row in RENDERED},
    }


def text(report: Report) -> str:
    """Write the tables in Markdown."""
    names, before, after = start_names(report), report["pretraining"], report["finetuning"]
    sharing = "all rows of a seed"
    if report.get("learn_on") == "share":
        sharing = "all rows and seeds; each share has a search of its own, with its labels alone"
    images = report.get("search_images")
    limit = "" if images is None else f" The search used at most {images} of these images."
    start: Column = ("start", lambda row: names[row["row"]])

    def share(row: Report) -> str:
        return f"{100 * row['fraction']:g} %"

    columns: list[Column] = [
        start,
        ("share of the images", share),
        ("images", lambda row: str(row["images"])),
        *estimate("mIoU"),
    ]
    lines = [
        introduction(report),
        "",
        f"Networks ({report['net']}) are pre-trained for {before['steps']} steps on {before['images']} "
        f"rendered images, then fine-tuned for {after['steps']} steps (learning rate {after['lr']:.3g}) on "
        f"a share of the {report['reward_images']} real images, the same for {sharing}. "
        f"Rows from {names['scratch']} are only fine-tuned." + limit,
        "",
        *table(columns, report["rows"]),
    ]
    if report["tests"]:
        tests: list[Column] = [
            start,
            ("against", lambda test: names[test["against"]]),
            ("share", share),
            ("difference", lambda test: number(test.get("difference"), "+.1f")),
            ("t", lambda test: number(test.get("t"), ".2f")),
            ("degrees", lambda test: number(test.get("degrees"))),
            ("p", lambda test: number(test.get("p_value"), ".2g")),
            ("corrected p", lambda test: number(test.get("p_corrected"), ".2g")),
            ("", lambda test: test["stars"].replace("*", r"\*")),
        ]
        lines += [
            "",
            "Welch's t-test of the difference, two-sided; the last p has Holm's correction for the number of "
            "tests (* p < 0.05, ** p < 0.01):",
            "",
            *table(tests, report["tests"]),
        ]
    return "\n".join([*lines, *failures(report["rows"])])


def picture(report: Report) -> bytes:
    """Plot mIoU against the share of the real images, with intervals, as PNG."""
    names = start_names(report)
    shares = sorted({(row["fraction"], row["images"]) for row in report["rows"]})
    groups = {
        names[name]: [row for row in report["rows"] if row["row"] == name]
        for name in dict.fromkeys(row["row"] for row in report["rows"])
    }
    ticks = {
        k: f"{100 * fraction:g} %\n{images} images" for k, (fraction, images) in enumerate(shares)
    }
    title = f"{target_of(report)}, {report['net']}, {report['seeds']} networks each"

    def place(row: Report) -> float:
        return shares.index((row["fraction"], row["images"]))

    return curves(groups, place, ticks, "real images for the fine-tuning", title)


FORM = Form("pretrain", derive, text, {"pretrain.png": picture})
STUDY = Study(FORM, plan, scores, check, refuse_empty)

if __name__ == "__main__":
    sys.exit(command("pretrain"))
