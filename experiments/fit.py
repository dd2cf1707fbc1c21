"""Fits a net to your labelled images, with renders beside them, and measures the gain by the renders.

    sdr-jax fit photographs --out runs/fit                       # photographs/target.yaml says what is where
    sdr-jax fit CamVid --target camvid --few 14 --holdout 0006R0 --out runs/fit14
    sdr-jax fit photographs --preset smoke --out runs/try        # under a minute

It saves the net in OUT/model (see `sdr-jax predict`) and a report in OUT/report.html on nets that are trained
on your labels alone, with renders beside them, and on renders alone, and tested on images that they have not
seen. If the data have no split, these are the folds of your images, by group, in turn. While the run goes on,
`sdr-jax report OUT --serve` shows the report so far. The same command continues a stopped run.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from experiments.config import FewConfig, Fidelity, Preset, parsers
from experiments.config.presets import defaults, in_space
from experiments.evaluation.cost import head_cost, street_cost
from experiments.evaluation.job import Job, Keeps, LabelledSubset, Source, StreetPool
from experiments.evaluation.predictions import file_of, load
from experiments.report import live, page
from experiments.report.fit import MODEL, STRIP, Row, derive, rows_of, text
from experiments.report.folder import NAME
from experiments.run.context import Run, Work
from experiments.run.learn import learn, work_of
from experiments.run.nets import paired_seeds
from experiments.study.form import Form, Report, about, nets
from experiments.study.skeleton import Study, attributes, do
from experiments.target.base import Target
from experiments.target.folder import (
    SMALLEST,
    UNIT,
    Parts,
    Read,
    all_labelled,
    common_size,
    fold_targets,
    parts_of,
    reader,
    suitable_size,
)
from scene.attributes import SpaceName
from scene.dataset.formats.png import encode
from scene.held import read_fixed
from scene.proposal import Streets, draw
from scene.workers import WorkerError
from seg.beside import TrainingSet
from seg.classes import class_table, colorize
from seg.data import LabelledImages
from seg.model import SEEN, Model, classes_of, load_model, refuse_others
from seg.recipes import with_net
from seg.settings import FILELESS_NETS, Trunk, TrunkName, check_settings
from seg.train import Params, outline
from seg.weights import check as check_weights
from shell.classes import NAMES
from shell.command import exit_code, given
from shell.errors import UserError, flagged
from shell.files import digest, file_digest, write
from shell.interrupt import PROGRAM
from shell.listing import list_all
from shell.target_file import Fit, find_target

SHOWN = 4
"""Number of images in the strip."""
SPACE: SpaceName = "extended"
"""The space of the streets' attributes."""
RENDERED = "mixed"
"""The rendered streets, half random and half hand-set: ahead of random ones on real images, and level with
them on targets far from the hand-set street (`docs/findings.md`)."""
FEW = 20
"""Fewer labels than these fill a quarter of a batch beside renders; more fill half (`docs/findings.md`)."""
STREETS = "streets"
"""The word in plans for streets that are only rendered."""


@dataclass(frozen=True, kw_only=True)
class FitConfig(FewConfig):
    """One job; the command line has a few of these fields."""

    file: str | None = None
    """The target's file, or its name; by default target.yaml beside the images."""
    shape: Fit | None = None
    """How images of another shape are treated; by default as the target's file says."""
    learnt: bool = False
    """Whether streets are learnt, too."""
    init: Path | None = None
    """Folder of a model from which the net starts."""


class Prepared(NamedTuple):
    """The data that are read before the folder of the job is made."""

    parts: Parts
    whole: Read  # all images
    folds: list[Target]
    init: Params | None


def config_of(
    data: Path,
    out: Path,
    *,
    target: str | None = None,
    few: int | None = None,
    holdout: str | None = None,
    search: bool = False,
    preset: Preset = "quick",
    size: tuple[int, int] | None = None,
    shape: Fit | None = None,
    seeds: int = 3,
    workers: int | None = None,
    init: Path | None = None,
    store: Path | None = None,
    net: TrunkName = "lite0",
    trunk: Trunk = "frozen",
    weights: Path | None = None,
    fix: Sequence[str] = (),
) -> FitConfig:
    """Make the configuration of a command line.

    Args:
        data: folder of the images.
        out: folder of the run.
        target: the target's file, or the name of one that comes with the package.
        few: number of labels to use.
        holdout: the group to test on.
        search: whether to learn streets, too.
        preset: quick or smoke.
        size: width and height of the images for nets; by default a suitable size.
        shape: how images of another shape are treated.
        seeds: nets of each row and fold.
        workers: number of processes.
        init: folder of a model to start from.
        store: file of evaluations that runs share.
        net: the net, named by its trunk.
        trunk: whether the trunk is frozen or tuned; for a search's rewards it is always frozen.
        weights: file of the trunk's weights, for dinov2.
        fix: attributes to hold at a value in all streets, such as field_of_view=90.

    Raises:
        UserError: there is no such target or folder, none of its classes is rendered, an image cannot be
            read, weights are of another net, or an attribute cannot be held.
    """
    read_fixed(fix, SPACE)
    found = find_target(target, data)
    if not any(found.rendered):
        raise UserError(
            f"{found.source}: no class has 'renders', so renders would show none of them; name what the "
            f"engine has of each: {', '.join(NAMES)}"
        )
    parts = parts_of(found, data, holdout, few)
    if size is None:
        every = [entry for split in list_all(found, data).values() for entry in split]
        size = suitable_size(*common_size(every), preset)
    if min(size) < SMALLEST or any(side % UNIT for side in size):
        raise UserError(
            f"--size must be two multiples of {UNIT}, {SMALLEST} or more, not {size[0]}x{size[1]}"
        )
    if weights is not None and net in FILELESS_NETS:
        raise UserError(
            f"--weights {weights} is for --net dinov2; those of {net} come with a package"
        )
    file = None if weights is None else str(weights.absolute())
    base = configured(size, preset, net, trunk, file)
    with flagged("--net"):
        check_settings(base.final.train)
    check_weights(base.final.train, 1)
    return replace(
        base,
        data=data,
        out=out,
        few_share=0.25 if len(parts.entries) < FEW else 0.5,
        file=target,
        shape=shape,
        few=few,
        holdout=holdout,
        learnt=search,
        seeds=seeds,
        init=init,
        store=store,
        fix=tuple(fix),
        workers=base.workers if workers is None else workers,
    )


def configured(
    size: tuple[int, int],
    preset: Preset = "quick",
    net: TrunkName = "lite0",
    trunk: Trunk = "frozen",
    weights: str | None = None,
) -> FitConfig:
    """The configuration of a preset for a net at a size (width, height) of images."""
    base = in_space(defaults(FitConfig, "camvid", preset), SPACE)

    def fidelity(own: Fidelity, trunk: Trunk) -> Fidelity:
        train = with_net(own.train, net=net, trunk=trunk, weights=weights)
        return replace(own, width=size[0], height=size[1], train=train)

    return replace(
        base,
        reward=fidelity(base.reward, "frozen"),
        final=replace(fidelity(base.final, trunk), shots=1),
        reward_images=None,
        test_images=None,
    )


def prepared(config: FitConfig) -> Prepared:
    """Sort the images into parts, and load the model of ``--init``.

    Raises:
        UserError: as `parts_of`, or the model does not fit.
    """
    assert config.data is not None
    refuse_others(config.out / MODEL)
    few = None if config.few is None else int(config.few)
    parts = parts_of(find_target(config.file, config.data), config.data, config.holdout, few)
    whole = reader(parts, config.shape)
    folds = fold_targets(parts, config.data, whole)
    init = None if config.init is None else _start(config, folds[0])
    return Prepared(parts, whole, folds, init)


def _start(config: FitConfig, target: Target) -> Params:
    """The variables of the model of ``--init``.

    Raises:
        UserError: there is no model, or it has another net or other classes.
    """
    assert config.init is not None
    model, train = load_model(config.init), config.final.train
    classes = class_table(target.table).classes
    if model.names != tuple(classes):
        raise UserError(
            f"--init {config.init}: a model of other classes, {', '.join(model.names)}; the target has "
            f"{', '.join(classes)}"
        )
    ours, theirs = ((own.net, own.trunk, outline(own, 1)) for own in (train, model.settings))
    if ours != theirs:
        raise UserError(
            f"--init {config.init}: a model of the net {theirs[0]}, {theirs[1]}; --net and --trunk say "
            f"{ours[0]}, {ours[1]}"
        )
    return model.variables


def plan(config: FitConfig, own: Prepared) -> list[Work]:
    """Plan streets, searches, and the nets of every row and fold."""
    return planned(config, len(own.folds))


def planned(config: FitConfig, folds: int) -> list[Work]:
    """Plan the same for a number of folds."""
    final = config.final
    kinds = 1 + config.learnt * folds
    searches = [work._replace(nets=work.nets * folds) for work in work_of(config)]
    count = len(rows_of(config.learnt)) * folds * config.seeds
    return [
        Work(STREETS, kinds * config.seeds * final.streets, final, street_cost(final)),
        *(searches if config.learnt else []),
        Work("nets, each of which is tested", count, final, head_cost(final)),
        Work("the net that is left", 1, final, head_cost(final)),
    ]


def scores(run: Run[FitConfig], known: Prepared) -> Report:
    """Do the whole job, or the rest of it."""
    config, seeds = run.config, paired_seeds(run)
    recipe = run.recipe(config.final)
    folds = [replace(run, target=target) for target in known.folds]
    target = known.parts.target
    facts = {
        **about(run, config.final),
        "command": given(),
        "colors": class_table(run.target.table).colors.tolist(),
        "labels": len(known.parts.entries),
        "folds": len(folds),
        "where": known.parts.where,
        "notes": list(known.parts.notes),
        "tested": sum(len(fold.test_names) for fold in known.folds),
        "not_rendered": [name for name, own in target.classes.items() if not own.renders],
        "rendered_images": config.final.images,
        "streets": RENDERED,
        "few_share": config.few_share,
        "net": config.final.train.net,
    }
    live.watch(run, facts)
    mixed = attributes(run, {}, RENDERED)
    renders = {seed: rendered(run, mixed, seed) for seed in seeds}
    learnt: list[dict[int, StreetPool]] = []
    for number, fold in enumerate(folds, 1):
        if config.learnt:
            streets = learn(fold, name=f"fold-{number}").streets
            learnt.append({seed: rendered(run, streets, seed) for seed in seeds})
    found: dict[Row, list[Any]] = {row: [] for row in rows_of(config.learnt)}
    for number, fold in enumerate(folds):
        labels = fold.images(config.final, "labelled")
        own: list[Job] = []
        for seed in seeds:
            sources: dict[Row, Source] = {
                "labels": labels,
                "labels+renders": _beside(config, renders[seed], labels),
                "renders": renders[seed],
            }
            if config.learnt:
                sources["labels+learnt"] = _beside(config, learnt[number][seed], labels)
            for row, source in sources.items():
                notes = {"nets": f"fold {number + 1}", "row": row, "seed": seed}
                keeps: Keeps | None = "predictions" if number == 0 and seed == seeds[0] else None
                own.append(Job(recipe, source, seed, notes, keeps=keeps))
        results = fold.runner.test(own)
        for row, values in found.items():
            chosen = [r for job, r in zip(own, results, strict=True) if job.notes["row"] == row]
            values.append(nets(chosen))
        if number == 0:
            _show(run, fold, [job for job in own if job.keeps])
    seconds = {"total": round(run.progress.elapsed, 1)}
    report = {**facts, "seconds": seconds, "nets": found}
    beside: dict[Row, Source] = {"labels+renders": renders[seeds[0]]}
    if config.learnt:
        beside["labels+learnt"] = learnt[0][seeds[0]]
    _leave(run, known, beside, derive(report))
    for made in (renders, *learnt):
        for pool in made.values():
            run.runner.cache.forget(pool.name, recipe)
    return report


def rendered(run: Run[FitConfig], streets: Streets, seed: int) -> StreetPool:
    """Render streets of one shot with their features, which all nets of a seed share."""
    config, recipe = run.config, run.recipe(run.config.final)
    units = draw(streets, seed, config.final.streets)
    name = digest([digest(units.tolist()), seed, config.final.size])
    cost = street_cost(config.final)

    def done(count: int) -> None:
        run.progress.advance(count * cost)
        run.progress.update(f"streets of seed {seed}")

    return StreetPool(name, run.runner.cache.streets(name, recipe, units, seed, done))


def _beside(
    config: FitConfig, renders: Source, labels: LabelledImages | LabelledSubset
) -> TrainingSet:
    return TrainingSet((renders, labels), (1 - config.few_share, config.few_share))


def _leave(
    run: Run[FitConfig], known: Prepared, beside: Mapping[Row, Source], report: Report
) -> None:
    """Train the net on all labels in the way of the best row with labels, and save it.

    The learnt streets are those of the first fold, whose search has seen most of the labels.
    """
    config, parts = run.config, known.parts
    assert config.data is not None
    target = all_labelled(parts, known.folds[0], config.data, known.whole)
    whole = replace(run, target=target)
    labels = whole.images(config.final, "labelled")
    best = report["recipe"]
    source = labels if best == "labels" else _beside(config, beside[best], labels)
    seed, recipe = config.seed, run.recipe(config.final)
    variables = whole.runner.train(Job(recipe, source, seed, {}), known.init)
    Model(
        config.final.train,
        variables,
        (config.final.height, config.final.width),
        classes_of(parts.target),
        "colours" if parts.target.kind == "colours" else "ids",
        {
            "target": parts.target.name,
            "labelled_images": len(labels.images),
            SEEN: sorted(file_digest(entry.image_path) for entry in parts.seen),
            "trained_on": report["recipe"],
            "verdict": report["verdict"],
            "miou": report["rows"][report["recipe"]]["mean"],
            "reported_on": report["where"],
        },
    ).save(config.out / MODEL)
    run.progress.advance(head_cost(config.final))


def _show(run: Run[FitConfig], fold: Run[FitConfig], jobs: Sequence[Job]) -> None:
    """Write images that nets have not seen, their labels, and the first net's predictions of each row."""
    colors = class_table(fold.target.table).colors
    images = fold.images(run.config.final, "test")
    kept = [load(file_of(run.config.out, fold.runner.key(job))) for job in jobs]
    found = [own for own in kept if own is not None and own.picked is not None]
    if len(found) < len(jobs):
        return  # some came from the store, which has no predictions
    picked = cast(np.ndarray, found[0].picked)
    lines = []
    for place in np.unique(np.linspace(0, len(picked) - 1, SHOWN).round().astype(int)):
        index = picked[place]
        seen = [colorize(cast(np.ndarray, own.predictions)[place], colors) for own in found]
        lines.append(
            np.hstack([images.images[index], colorize(images.labels[index], colors), *seen])
        )
    write(run.config.out / STRIP, encode(np.vstack(lines)))


FORM = Form("summary", derive, text, {}, {NAME: page.html})


def fit(config: FitConfig) -> Report:
    """Do a whole job, or the rest of it; `config_of` makes its configuration.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    own = prepared(config)
    study: Study[FitConfig] = Study(
        FORM, plan, scores, prepare=lambda *_: own, target=lambda *_: own.folds[0]
    )
    return do(study, config)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.fit().parse_args(arguments)

    def work() -> None:
        given = {name: value for name, value in vars(options).items() if name != "debug"}
        config = config_of(given.pop("data"), given.pop("out"), **given)
        fit(config)
        command = shlex.join([PROGRAM, "predict", str(config.out / MODEL)])
        print(f"Use the net: {command} IMAGES --out DIR")
        print(f"Look at {config.out / NAME}")

    from scene.render import RendererError  # the help needs no engine

    return exit_code(work, (WorkerError,), users=(UserError, RendererError), debug=options.debug)


if __name__ == "__main__":
    sys.exit(main())
