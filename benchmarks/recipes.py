"""What is the gain of a change of the training recipe, from the same images, and what does it cost?

    python -m benchmarks.recipes --target camvid --data DIR --holdout 0006R0 --few 14 --seeds 5 \\
        --recipes lite0-frozen lite0-heads lite0-heads:jaccard=0 lite0-heads:last_share=None
    python -m benchmarks.recipes --data DIR --few 14 --on labels labels+renders renders all

A recipe is one of `seg.recipes`, with changes of its fields after a colon. Networks of a seed share the
features of the same images: ``--few`` labelled images of the target, and ``--streets`` rendered ones, half
random and half default. They are tested on development images, without those few, and on reported images: a
split, or the group of ``--holdout``. Gains over the first recipe are paired by seed; ``one head`` is the mean
over the single heads of a network.

``--out`` stores renders and finished networks: the same command resumes, also with more recipes or seeds.
"""

from __future__ import annotations

import argparse
import ast
import sys
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.networks import (
    DEVELOPMENT,
    NETWORKS,
    REPORTED,
    Real,
    Recipe,
    finished,
    prepare,
    real_images,
    renders,
    run_benchmark,
    store,
)
from benchmarks.report import Row, gain_text, table, target_parser, write
from common.errors import UserError
from experiments.app.doctor.outlines import RenderedLabels
from experiments.targets.few import share_of
from seg.check import check_settings
from seg.classes import table_of
from seg.data import LabelledImages
from seg.inference import predict_heads
from seg.metrics import confusion_matrix, mean_iou
from seg.pyramid import prediction_features, training_features
from seg.recipes import RECIPES
from seg.settings import TrainSettings
from seg.train import train
from seg.views import LOOKS

ON = ("labels", "labels+renders", "renders", "all")
"""Training sets; networks of all labelled images are tested on reported images only."""


def settings_of(recipe: str) -> TrainSettings:
    """Read the settings of a recipe such as ``lite0-heads:heads=5,steps=500``.

    Raises:
        UserError: an unknown recipe or field, or settings that do not allow a frozen backbone.
    """
    name, _, changes = recipe.partition(":")
    if name not in RECIPES:
        raise UserError(f"--recipes {recipe}: no such recipe; choose from {', '.join(RECIPES)}")
    values = {}
    for change in filter(None, changes.split(",")):
        key, _, text = change.partition("=")
        try:
            values[key] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            values[key] = text
        if key not in {field.name for field in fields(TrainSettings)}:
            raise UserError(f"--recipes {recipe}: recipes have no field {key}")
    settings = replace(RECIPES[name], **values)
    try:
        check_settings(settings)
    except ValueError as error:
        raise UserError(f"--recipes {recipe}: {error}") from None
    if not settings.frozen:
        raise UserError(f"--recipes {recipe}: features are shared, so the backbone must be frozen")
    return settings


def key(recipe: Recipe, settings: TrainSettings, on: str, seed: int, tested: int) -> dict[str, Any]:
    """Everything that a network depends on."""
    defaults = TrainSettings()
    values = {
        field.name: getattr(settings, field.name)
        for field in fields(settings)
        if getattr(settings, field.name) != getattr(defaults, field.name)
    }
    of_network = {"settings": values, "on": on, "seed": seed, "tested": tested}
    return {**recipe.rendered, **recipe.real, **of_network}


@lru_cache(maxsize=2)
def _real(recipe: Recipe, tested: int) -> Real:
    """Read the labelled images; those for tests have features of images and mirror images."""
    real = real_images(recipe, False)

    def with_features(images: LabelledImages | None) -> LabelledImages | None:
        if images is None:
            return None
        count = len(images.images)
        chosen = np.unique(np.linspace(0, count - 1, min(tested, count)).round().astype(int))
        subset = images.take(chosen)
        settings = RECIPES["lite0-heads"]
        return subset._replace(features=prediction_features(subset.images, settings))

    development = with_features(real.development)
    assert development is not None
    return Real(real.few, development, with_features(real.reported))


def networks(
    recipe: Recipe, seed: int, work: Sequence[tuple[str, str]], tested: int, folder: Path
) -> list[dict[str, Any]]:
    """Train and test a network per recipe and training set of a seed; runs in a worker.

    Each line is written at once.
    """
    real, rendered = _real(recipe, tested), renders(recipe, seed, folder)
    classes = len(table_of(recipe.file).classes)
    whole = real_images(recipe, False)
    labels = RenderedLabels(rendered.labels, rendered.depths).classes(
        recipe.file, recipe.file.engine_outlines
    )
    sets = {
        "labels": whole.few,
        "renders": LabelledImages(rendered.images, labels),
        "all": _joined(whole),
    }
    views: dict[Any, LabelledImages] = {}

    def images_of(name: str, settings: TrainSettings) -> LabelledImages:
        looks = (name, *(getattr(settings, look) for look in LOOKS))
        if looks not in views:
            images = sets[name]
            assert images is not None
            maps = training_features(images.images, settings)
            views[looks] = images._replace(features=maps)
        return views[looks]

    @cache
    def trained(on: str, settings: TrainSettings) -> tuple[Any, float]:
        images = images_of("renders" if on == "labels+renders" else on, settings)
        few = images_of("labels", settings) if on == "labels+renders" else None
        started = time.process_time()
        params = train(
            seed,
            images.images,
            images.labels,
            settings,
            classes,
            features=images.features,
            extra=few,
            share=share_of(recipe.few),
        )
        return params, time.process_time() - started

    lines = []
    for on, name in work:
        settings = settings_of(name)
        # Only tests average mirror images, so recipes with and without share a network.
        params, seconds = trained(on, replace(settings, average_mirror=False))
        confusions, of_heads = {}, {}
        for side, tested_on in ((DEVELOPMENT, real.development), (REPORTED, real.reported)):
            if tested_on is None or (on == "all" and side == DEVELOPMENT):
                continue
            maps, count = tested_on.features, len(tested_on.images)
            if maps is not None and not settings.average_mirror:
                maps = tuple(part[:count] for part in maps)
            predicted = predict_heads(params, tested_on.images, settings, classes, features=maps)
            together, *alone = (
                confusion_matrix(tested_on.labels, classes_of, classes)
                for classes_of in predicted.swapaxes(0, 1)
            )
            confusions[side] = together.tolist()
            of_heads[side] = [mean_iou(confusion) for confusion in alone or [together]]
        line = {
            "key": key(recipe, settings, on, seed, tested),
            "seconds": round(seconds, 2),
            "scores": confusions,
            "heads": of_heads,
        }
        store(folder / NETWORKS, line)
        lines.append(line)
    return lines


def _joined(real: Real) -> LabelledImages:
    """Join all images that are not reported on."""
    parts = [part for part in (real.few, real.development) if part is not None]
    return LabelledImages(
        np.concatenate([part.images for part in parts]),
        np.concatenate([part.labels for part in parts]),
    )


def gain_rows(
    lines: dict[tuple[str, str, int], dict[str, Any]],
    on: str,
    recipes: Sequence[str],
    seeds: Sequence[int],
    side: str,
) -> list[Row]:
    """Tabulate the mIoU of recipes in percent, paired gains over the first, and CPU seconds per network."""
    rows: list[Row] = []
    scores = {
        name: [100 * mean_iou(np.array(lines[on, name, seed]["scores"][side])) for seed in seeds]
        for name in recipes
    }
    for name in recipes:
        recipe_lines = [lines[on, name, seed] for seed in seeds]
        gain = "" if name == recipes[0] else gain_text(scores[name], scores[recipes[0]])
        rows.append(
            {
                "recipe": name,
                "mIoU": f"{np.mean(scores[name]):.1f}",
                "one head": f"{100 * np.mean([np.mean(line['heads'][side]) for line in recipe_lines]):.1f}",
                "gain": gain,
                "by seed": " ".join(f"{value:.1f}" for value in scores[name]),
                "CPU s": f"{np.median([line['seconds'] for line in recipe_lines]):.0f}",
            }
        )
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_benchmark(_run, _options(arguments))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    defaults = {**Recipe._field_defaults, "few": 14, "tested": 120}
    defaults |= {"width": 480, "height": 360, "streets": 400}
    counts = [
        ("few", 1, "labelled images in training sets"),
        ("tested", 1, "the most images of each test"),
    ]
    command = target_parser(
        __doc__, "recipes", defaults, holdout="reported on", seeds=3, counts=counts
    )
    add = command.add_argument
    both = ["lite0-frozen", "lite0-heads"]
    add("--recipes", nargs="+", default=both, help="recipes; gains are over the first")
    add("--on", nargs="+", choices=ON, default=["labels+renders"], help="training sets")
    return command.parse_args(arguments)


def _run(options: argparse.Namespace) -> None:
    values = vars(options)
    values = {name: values[name] for name in Recipe._fields if name in values}
    recipe = Recipe(**{**values, "attributes": "mixed", "steps": 1})
    names = list(dict.fromkeys(options.recipes))
    for name in names:
        settings_of(name)
    prepare(recipe, options.out)
    seeds, pairs = range(options.seeds), [(on, name) for on in options.on for name in names]

    def key_of(pair: tuple[str, str], seed: int) -> dict[str, Any]:
        on, name = pair
        return key(recipe, settings_of(name), on, seed, options.tested)

    done = finished(networks, recipe, pairs, key_of, options, options.tested)
    lines = {(*pair, seed): line for (pair, seed), line in done.items()}
    tables = {}
    for on in options.on:
        for side in (DEVELOPMENT, REPORTED):
            if side in lines[on, names[0], 0]["scores"]:
                title = f"trained on {on}, tested on {side} images"
                tables[title] = gain_rows(lines, on, names, seeds, side)
    for title, rows in tables.items():
        print(f"\n{title}\n{table(rows)}")
    write(options.json, recipe=recipe._asdict(), seeds=options.seeds, **tables)


if __name__ == "__main__":
    sys.exit(main())
