"""Time inference and training of our networks against PyTorch, and the parts of one reward.

    python -m benchmarks.train --json train.json
    python -m benchmarks.train --nets compact --sizes 128x96 --repeats 3 --no-reward
    taskset -c 0 python -m benchmarks.train --nets lite0 --threads 1    # one core each, as a worker has
    python -m benchmarks.train --learn camvid --data DIR --holdout 0006R0 --nets lite0 lite1 lite2

Each row is one net at one size: `forward` is bytes to logits at full resolution, `step` a whole update (loss,
gradient, SGD or Adam), with a learning rate of 0 so that random images do no harm. A Lite also has
`features`, bytes to the features of the frozen backbone, and `head`, an update from these features; its
`step` tunes the backbone, in PyTorch with one learning rate. Times are medians; PyTorch has the better of
its two memory layouts. Without PyTorch its columns stay empty.

With --learn each row instead has the mIoU of a network trained on the labelled images of a target: in percent
on the test images, mean and 95 % interval over seeds; and the core seconds of the features of all views and
of one training, without compilation.
"""

from __future__ import annotations

import argparse
import gc
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.noise import CLASSES, noise
from benchmarks.report import Row, count, parser, table, timed, write
from common.command import size
from common.errors import UserError
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.in_worker import rendered_set, tested, trained
from experiments.evaluation.job import Recipe
from experiments.tables.stats import mean_ci95
from experiments.targets.base import Sides
from experiments.targets.real import REPORTED, real_target
from scene.proposal import random_proposal
from seg.classes import class_table
from seg.data import LabelledImages
from seg.inference import score
from seg.metrics import mean_iou
from seg.nets import FeatureMaps, net_of
from seg.nets.ops.normalise import MEAN, STD
from seg.pyramid import features, prediction_features
from seg.recipes import RECIPES, with_net, with_steps
from seg.settings import VGG_NETS, BackboneTraining, NetName, TrainSettings
from seg.step import Data, Functions, TrainState, functions, plan
from seg.train import train
from seg.views import view_images

BATCHES: dict[NetName, int] = {"compact": 8, "deeplabv2": 4, "fcn8s": 4}
BATCHES |= dict.fromkeys(("lite0", "lite1", "lite2"), 8)
SIZES = ("128x96", "240x176", "480x360", "640x320")
LARGE = 100_000  # pixels from which VGG nets take seconds per image, so that one image is enough
REWARDS = (None, 184)  # images of the split rewards: the preset's number, and more
REAL = 367  # images of CamVid's training split, on which the net of a quick reward is tested
BUDGET = 12.0  # seconds after which no further repeat begins, except for the second


class Job(NamedTuple):
    """One network at one size."""

    net: NetName
    width: int
    height: int
    batch: int

    @property
    def settings(self) -> TrainSettings:
        """The recipe of the network without augmentation, and with the loss of all pixels, as in PyTorch."""
        tuned = RECIPES["lite0-tuned"]
        whole = RECIPES["paper"] if self.net in VGG_NETS else TrainSettings()
        recipe = tuned if replace(tuned, net=self.net).has_backbone else whole
        return replace(
            recipe,
            net=self.net,
            batch=self.batch,
            steps=1,
            warmup=0,
            lr=0.0,
            lr_multipliers="none",
            mirror=False,
            colour=False,
            blur=False,
            noise=False,
            scale=False,
            mix=False,
            loss_stride=1,
        )

    def data(self) -> LabelledImages:
        """Make random images and labels."""
        return noise(self.batch, (self.height, self.width))


Runs = Iterator[tuple[str, Callable[[], Any]]]
"""Name of a pass, and a function that runs it once and waits for it."""


def jax_runs(job: Job) -> Runs:
    """The passes of ``seg.train``."""
    settings = job.settings
    images, labels = job.data()[:2]
    compiled = functions(settings, CLASSES)
    module = net_of(settings.net_spec, CLASSES)
    ones, seed = np.ones(CLASSES, np.float32), np.uint32(0)
    data = jax.device_put(Data(images, labels, ones, seed))
    state = compiled.init(seed, data.images)

    @jax.jit
    def forward(variables: Any, images: jax.Array) -> jax.Array:
        return module.apply(variables, images.astype(jnp.float32) / 255)

    yield "forward", lambda: forward(state.trained, data.images).block_until_ready()
    row = plan(0, job.batch, settings).rows(0)

    def stepping(compiled: Functions, state: TrainState, data: Data) -> Callable[[], None]:
        def step() -> None:
            nonlocal state
            state, loss = compiled.step(state, data, row)
            jax.block_until_ready((state, loss))

        return step

    if settings.has_backbone:
        yield "features", lambda: features(images, settings)
        frozen = functions(replace(settings, backbone="frozen"), CLASSES)
        maps = FeatureMaps(features(images, settings), (job.height, job.width))
        kept = jax.device_put(Data(maps, labels, ones, seed))
        yield "head", stepping(frozen, frozen.init(seed, kept.images), kept)
    yield "step", stepping(compiled, state, data)


def torch_runs(job: Job, channels_last: bool, threads: int) -> Runs:
    """The same passes in PyTorch."""
    import torch

    from benchmarks.torch_nets import NETS, images_of

    torch.set_num_threads(threads)
    torch.manual_seed(0)
    layout = torch.channels_last if channels_last else torch.contiguous_format
    settings = job.settings
    module = NETS[job.net](CLASSES).to(memory_format=layout)
    images, labels = job.data()[:2]
    bytes_ = images_of(images)
    target = torch.from_numpy(labels).long()
    weights = torch.ones(CLASSES)
    mean, deviation = (torch.tensor(v)[None, :, None, None] for v in (MEAN, STD))

    def logits() -> Any:
        x = (bytes_.float() / 255 - mean) / deviation
        return module(x.contiguous(memory_format=layout))

    def forward() -> None:
        with torch.no_grad():
            logits()

    module.eval()
    yield "forward", forward
    module.train()

    def stepping(trained: Any, logits: Callable[[], Any]) -> Callable[[], None]:
        if settings.optimizer == "sgd":
            optimizer: Any = torch.optim.SGD(
                trained.parameters(), 0.0, settings.momentum, weight_decay=settings.weight_decay
            )
        else:
            optimizer = torch.optim.Adam(trained.parameters(), 0.0)

        def step() -> None:
            optimizer.zero_grad(set_to_none=True)
            loss = torch.nn.functional.cross_entropy(logits(), target, weights, ignore_index=255)
            loss.backward()
            optimizer.step()

        return step

    if settings.has_backbone:

        def maps() -> list[Any]:
            with torch.no_grad():
                return module.backbone((bytes_.float() / 255).contiguous(memory_format=layout))

        yield "features", maps
        kept, whole = maps(), (job.height, job.width)
        yield "head", stepping(module.head, lambda: module.head(kept, whole))
    yield "step", stepping(module, logits)


def medians(runs: Runs, repeats: int) -> dict[str, float]:
    """Measure the median milliseconds of each pass, after a first run that does not count."""
    ms_of = {}
    for name, run in runs:
        run()
        times: list[float] = []
        while len(times) < repeats and (len(times) < 2 or sum(times) < BUDGET):
            times.append(timed(run)[0])
        ms_of[name] = 1000 * statistics.median(times)
    gc.collect()
    return ms_of


def net_rows(job: Job, repeats: int, threads: int, compare: bool) -> list[Row]:
    """Measure the passes of one network at one size."""
    jax_ms = medians(jax_runs(job), repeats)
    layouts = {"contiguous": False, "channels_last": True} if compare else {}
    torch_ms_of = {
        k: medians(torch_runs(job, last, threads), repeats) for k, last in layouts.items()
    }
    rows: list[Row] = []
    for name, ms in jax_ms.items():
        best = min(torch_ms_of, key=lambda layout: torch_ms_of[layout][name], default=None)
        torch_ms = torch_ms_of[best][name] if best else None
        rows.append(
            {
                "net": job.net,
                "size": f"{job.width}x{job.height}",
                "batch": job.batch,
                "pass": name,
                "ms": ms,
                "passes_per_s": 1000 / ms,
                "images_per_s": 1000 * job.batch / ms,
                "torch_ms": torch_ms,
                "torch_layout": best,
                "ratio_to_torch": torch_ms / ms if torch_ms else None,
            }
        )
    return rows


def reward_row(number: int = REAL, steps: int | None = None, images: int | None = None) -> Row:
    """Measure the seconds of each part of one quick reward of `sdr-jax camvid` in this process.

    Features of the real images are computed once per run, so they do not count.
    ``compile_s`` is the extra time of the first training and prediction of a process over the second: a
    search pays it once per worker, and with JAX's cache on disk only the first search does.

    Args:
        number: number of real images.
        steps: training steps of the net; by default the preset's.
        images: number of training images, in whole streets; by default the preset's.
    """
    config = defaults(MainConfig, "camvid", "quick")
    stage = config.reward
    settings = with_steps(stage.train, steps or stage.train.steps)
    stage = replace(stage, streets=(images or stage.images) // stage.shots, train=settings)
    recipe = Recipe(stage, "camvid", config.renderer, config.pool)
    truth = noise(number, (stage.height, stage.width))
    if settings.frozen:
        truth = truth._replace(features=prediction_features(truth.images, settings))
    brief = recipe._replace(fidelity=replace(stage, train=with_steps(settings, 1)))

    rendered_set(brief, random_proposal(), 0)  # builds and keeps assets, and loads the renderer
    render_s, training_set = timed(lambda: rendered_set(recipe, random_proposal(), 0))

    def short() -> None:
        tested(brief, trained(brief, training_set, 0), truth, 0.0, 0.0)

    cold, warm = timed(short)[0], timed(short)[0]
    train_s, params = timed(lambda: trained(recipe, training_set, 1))
    score_s, _ = timed(lambda: tested(recipe, params, truth, 0.0, 0.0))
    return {
        "size": stage.size,
        "images": len(training_set.images),
        "steps": settings.steps,
        "scored": number,
        "render_s": render_s,
        "compile_s": max(cold - warm, 0.0),
        "train_s": train_s,
        "score_s": score_s,
        "reward_s": render_s + train_s + score_s,
    }


def core_timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Measure the core seconds of some work of this process, and return its result."""
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


def learning_row(sides: Sides, settings: TrainSettings, classes: int, seeds: Sequence[int]) -> Row:
    """Measure the mIoU of a network trained on the labelled images of a target, and its cost."""
    labelled, truth = sides["labelled"], sides["test"]
    maps, tested, features_s = None, None, 0.0
    if settings.frozen:
        tested = prediction_features(truth.images, settings)  # compiles, too
        looks = view_images(labelled.images, settings)
        features_s, maps = core_timed(lambda: features(looks, settings))
    # Compiles.
    train(0, *labelled[:2], with_steps(settings, 1), classes, features=maps)
    mious, times = [], []
    for seed in seeds:
        fit = partial(train, seed, *labelled[:2], settings, classes, features=maps)
        seconds, params = core_timed(fit)
        times.append(seconds)
        mious.append(100 * mean_iou(score(params, *truth[:2], settings, classes, features=tested)))
    mean, ci95 = mean_ci95(mious)
    return {
        "net": settings.net,
        "backbone": settings.backbone,
        "steps": settings.steps,
        "batch": settings.batch,
        "miou": round(mean, 1),
        "ci95": None if ci95 is None else f"{ci95[0]:.1f} to {ci95[1]:.1f}",
        "features_s": features_s,
        "train_s": statistics.mean(times),
        "core_s": features_s + statistics.mean(times),
        "images": len(labelled.images),
        "tested": len(truth.images),
        "mious": " ".join(f"{miou:.2f}" for miou in mious),
    }


def learning_rows(options: argparse.Namespace) -> list[Row]:
    """Measure each network at each size on the target of ``--learn``."""
    base = defaults(MainConfig, options.learn, "quick")
    base = replace(base, holdout=options.holdout, reward_images=None, test_images=None)
    data = options.data or base.data
    if data is None:
        raise UserError(f"--learn {options.learn} needs --data, the folder of its images")
    target, rows = real_target(options.learn, base, data), []
    classes = len(class_table(target.table).classes)
    for name in options.nets:
        settings = with_net(RECIPES["lite0-frozen"], net=name, backbone=options.backbone)
        settings = with_steps(settings, options.steps or settings.steps)
        for width, height in options.sizes:
            sides = target.at(height, width)
            row = learning_row(sides, settings, classes, range(options.seeds))
            rows.append({"size": f"{width}x{height}", **row})
            print(f"{name} at {width}x{height}: {row['miou']}", file=sys.stderr, flush=True)
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    positive = partial(count, 1)
    command.add_argument("--nets", nargs="+", choices=list(BATCHES), default=list(BATCHES))
    command.add_argument("--sizes", nargs="+", type=size, default=[size(s) for s in SIZES])
    command.add_argument(
        "--repeats",
        type=positive,
        default=7,
        help="repeats; fewer, at least 2, if one takes seconds",
    )
    command.add_argument(
        "--batch",
        type=positive,
        help="by default 8 for compact and the Lites; 4 for the VGG nets, 1 at the large sizes",
    )
    command.add_argument(
        "--threads", type=positive, default=2, help="threads of PyTorch; JAX takes all cores"
    )
    command.add_argument(
        "--reward", action=argparse.BooleanOptionalAction, default=True, help="also split a reward"
    )
    command.add_argument(
        "--learn", choices=list(REPORTED), help="train nets on this target's labels instead"
    )
    command.add_argument("--data", type=Path, help="for --learn: the folder of its images")
    command.add_argument("--holdout", help="for --learn: the sequence to test on")
    command.add_argument(
        "--backbone", choices=get_args(BackboneTraining), default="frozen", help="of --learn"
    )
    command.add_argument("--steps", type=positive, help="for --learn; by default the recipe's")
    command.add_argument("--seeds", type=positive, default=3, help="for --learn: seeds (3)")
    options = command.parse_args(arguments)
    if options.learn:
        try:
            learning = learning_rows(options)
        except UserError as error:
            command.error(str(error))
        print(table(learning))
        write(options.json, rows=learning)
        return 0
    compare = find_spec("torch") is not None
    if not compare:
        print("PyTorch is not installed (pip install torch): its columns stay empty\n")
    rows: list[Row] = []
    for name in options.nets:
        for width, height in options.sizes:
            small = name not in VGG_NETS or width * height < LARGE
            batch = options.batch or (BATCHES[name] if small else 1)
            job = Job(name, width, height, batch)
            rows += net_rows(job, options.repeats, options.threads, compare)
            print(f"{name} at {width}x{height}: done", file=sys.stderr, flush=True)
    print(table(rows))
    reward: list[Row] = []
    if options.reward:
        reward = [reward_row(images=number) for number in REWARDS]
        print(f"\n{table(reward)}")
    write(options.json, rows=rows, reward=reward)
    return 0


if __name__ == "__main__":
    sys.exit(main())
