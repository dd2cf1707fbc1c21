"""Measures what networks cost on a GPU, and in PyTorch if it is installed, in at most eight minutes.

    python -m benchmarks.gpu --out gpu.jsonl        # resumes an existing file
    python -m benchmarks.gpu --tiny                 # everything tiny, a minute on a CPU: does it run?

It measures the head of one reward alone and 32 at once, features of 96 images in batches of 8 and in one
batch, and steps of fcn8s and of a tuned lite0. Each row has the seconds of the first call, most of which XLA
compiles, and the milliseconds of a later one. A row is written as soon as it is measured; rows that the file
has of this device are not measured again.
"""

from __future__ import annotations

import gc
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.noise import CLASSES, noise
from benchmarks.report import Row, count, machine, parser, table, timed, write
from common.lines import JsonLines
from seg import step
from seg.data import LabelledImages
from seg.many import train_many
from seg.nets.backbones import BACKBONES, Backbone, backbone_of
from seg.nets.lite import STRIDES, Block, Lite, channels_of
from seg.nets.ops.depthwise import ON_ACCELERATORS
from seg.prepare import first_variables
from seg.pyramid import features
from seg.recipes import RECIPES
from seg.settings import TrainSettings
from seg.step import Data, functions, plan
from seg.train import train

REPEATS = 5
SECONDS = 480
"""No row is begun after these, so that one call of ten minutes is enough."""
NARROW = (Block(3, 1, 1, 8), *(Block(3, 2, 2, 8) for _ in range(4)))
"""The blocks of a Lite for `--tiny`, which a CPU compiles in seconds."""


class Sizes(NamedTuple):
    """How large everything is."""

    frozen: TrainSettings  # of the reward's head
    reward: tuple[int, int] = (176, 240)  # height and width
    images: int = 96  # of a reward
    networks: int = 32  # trained at once
    whole: TrainSettings = replace(RECIPES["paper"], net="fcn8s")
    whole_size: tuple[int, int] = (320, 640)
    tuned: TrainSettings = replace(RECIPES["lite0-tuned"], batch=16)
    tuned_size: tuple[int, int] = (360, 480)
    chunk: int = 50  # steps of a call


FULL = Sizes(replace(RECIPES["lite0-frozen"], steps=150))
TINY = Sizes(
    replace(RECIPES["lite0-frozen"], net="narrow", steps=2, warmup=0),
    reward=(32, 32),
    images=4,
    networks=2,
    whole=replace(RECIPES["compact"], batch=2),
    whole_size=(16, 24),
    tuned=replace(RECIPES["lite0-tuned"], net="narrow", batch=2),
    tuned_size=(32, 32),
    chunk=2,
)


class Figure(NamedTuple):
    """One row to measure."""

    name: str
    prepare: Callable[[], Callable[[], Any]]  # gives a call that is measured
    share: int = 1  # what a call makes, such as networks or steps, which `ms` is divided by


def narrow() -> None:
    """Add the narrow Lite, with random weights, to the known backbones."""
    module = Lite(NARROW)
    params = jax.jit(module.init)(jax.random.key(0), jnp.zeros((1, 32, 32, 3)))["params"]
    BACKBONES["narrow"] = lambda _: Backbone(
        module, STRIDES, channels_of(NARROW), lambda: params, {}
    )


def with_features(images: LabelledImages, settings: TrainSettings, views: int) -> LabelledImages:
    """Add features of noise, since their values do not matter for time."""
    rng, backbone = np.random.default_rng(0), backbone_of(settings)
    rows, h, w = views * len(images.images), *images.images.shape[1:3]
    maps = tuple(
        rng.random((rows, -(-h // stride), -(-w // stride), c), np.float32).astype(np.float16)
        for stride, c in zip(backbone.strides, backbone.channels, strict=True)
    )
    return images._replace(features=maps)


def figures(sizes: Sizes) -> Iterator[Figure]:
    """All rows, those first that are measured fast."""
    settings = sizes.frozen
    reward = partial(noise, sizes.images, sizes.reward)

    def head() -> Callable[[], Any]:
        images = with_features(reward(), settings, settings.views)
        return lambda: train(0, *images[:2], settings, CLASSES, features=images.features)

    def heads(tested: bool) -> Callable[[], Any]:
        images = with_features(reward(), settings, settings.views)
        test = with_features(reward(), settings, 1) if tested else None
        many = sizes.networks
        return lambda: train_many(range(many), [images] * many, settings, CLASSES, test=test)

    def extracted(batch: int) -> Callable[[], Any]:
        return partial(features, reward().images, settings, batch)

    backbone = settings.net
    yield Figure(f"head of a reward on {backbone}, alone", head)
    for tested in (False, True):
        name = f"head of a reward on {backbone}, {sizes.networks} at once"
        with_test = f", tested on {sizes.images} images" if tested else ""
        yield Figure(name + with_test, partial(heads, tested), sizes.networks)
    for batch in (8, sizes.images):
        name = f"features of {sizes.images} images by {backbone}, batches of {batch}"
        yield Figure(name, partial(extracted, batch))
    for dtype in ("float32", "bfloat16"):
        whole = replace(sizes.whole, dtype=dtype)
        yield from steps(whole, sizes.whole_size, sizes.chunk)
    tuned = replace(sizes.tuned, dtype="bfloat16")
    for way in ("shifts", "grouped"):
        yield from steps(tuned, sizes.tuned_size, sizes.chunk, way)


def steps(
    settings: TrainSettings, size: tuple[int, int], chunk: int, depthwise: str | None = None
) -> Iterator[Figure]:
    """Steps of a whole network by JAX, and by PyTorch where it is installed."""
    name = f"step of {settings.net}, {size[1]}x{size[0]}, batch {settings.batch}, {settings.dtype}"
    images = noise(settings.batch, size)

    def ours() -> Callable[[], Any]:
        ON_ACCELERATORS.set("shifts" if depthwise == "shifts" else "grouped")
        step._compiled.cache_clear()  # otherwise the way that was traced first is kept
        compiled = functions(settings, CLASSES)
        state = None
        data = jax.device_put(
            Data(images.images, images.labels, np.ones(CLASSES, np.float32), np.uint32(0))
        )
        rows = plan(0, settings.batch, replace(settings, steps=chunk, warmup=0)).rows(slice(None))

        def call() -> Any:
            nonlocal state
            if state is None:
                params = compiled.init(np.uint32(0), data.images).params
                width = sum(backbone_of(settings).channels) if settings.has_backbone else 0
                identity = (np.zeros(width, np.float32), np.ones(width, np.float32))
                start = first_variables(params, settings, identity)
                state = compiled.resume(jax.tree.map(jnp.array, start))
            state, losses = compiled.steps(state, data, rows)
            return losses

        return call

    yield Figure(name + (f", {depthwise} depthwise" if depthwise else ""), ours, chunk)
    if find_spec("torch") and depthwise != "shifts" and settings.net != "narrow":
        yield Figure(f"{name}, PyTorch", partial(torch_steps, settings, images, chunk), chunk)


def torch_steps(settings: TrainSettings, images: LabelledImages, chunk: int) -> Callable[[], Any]:
    """The same steps in PyTorch, but without augmentation and with the loss of all pixels.

    Channels are last, precision is automatic.
    """
    import torch

    from benchmarks.torch_nets import NETS, images_of
    from seg.nets.ops.normalise import MEAN, STD

    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.backends.cudnn.benchmark = True
    module = NETS[settings.net](CLASSES).to(device, memory_format=torch.channels_last).train()
    pixels = images_of(images.images).to(device)
    target = torch.from_numpy(images.labels).long().to(device)
    mean, deviation = (torch.tensor(v, device=device)[None, :, None, None] for v in (MEAN, STD))
    optimizer: Any = torch.optim.SGD(module.parameters(), 0.0, momentum=0.9)
    if settings.optimizer == "adam":
        optimizer = torch.optim.Adam(module.parameters(), 0.0)
    half = settings.dtype == "bfloat16"

    def call() -> None:
        for _ in range(chunk):
            optimizer.zero_grad(set_to_none=True)
            x = ((pixels.float() / 255 - mean) / deviation).contiguous(
                memory_format=torch.channels_last
            )
            with torch.autocast(device, torch.bfloat16, enabled=half):
                logits = module(x)
            torch.nn.functional.cross_entropy(logits.float(), target).backward()
            optimizer.step()
        if device == "cuda":
            torch.cuda.synchronize()

    return call


def measured(figure: Figure) -> Row:
    """Seconds of the first call, and milliseconds of a later one (the median) for each of what it makes."""
    call = figure.prepare()

    def run() -> None:
        result = call()
        jax.block_until_ready(getattr(result, "stacked", result))

    first, _ = timed(run)
    seconds = [timed(run)[0] for _ in range(REPEATS)]
    gc.collect()
    return {
        "what": figure.name,
        "first_s": first,
        "ms": 1000 * statistics.median(seconds) / figure.share,
    }


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    add = command.add_argument
    add("--out", type=Path, help="file of the rows, one line each; continued if it is there")
    add("--only", default="", help="measure rows whose name contains this")
    add("--tiny", action="store_true", help="everything tiny: does it run?")
    seconds = f"begin no row after so many seconds ({SECONDS})"
    add("--seconds", type=partial(count, 0), default=SECONDS, help=seconds)
    options = command.parse_args(arguments)
    if options.tiny:
        narrow()
    jax.config.update("jax_enable_compilation_cache", False)  # compilation is measured
    device = jax.devices()[0].device_kind
    key = {"device": device, "backend": jax.default_backend(), "jax": jax.__version__}
    lines = JsonLines(options.out)
    recorded = {row["what"] for row in lines.lines if key.items() <= row.items()}
    started, left = time.perf_counter(), 0
    for figure in figures(TINY if options.tiny else FULL):
        if options.only not in figure.name or figure.name in recorded:
            continue
        if time.perf_counter() - started > options.seconds:
            left += 1
            continue
        row = measured(figure) | key
        lines.append(row)
        print(f"{row['what']}: {row['ms']:.3g} ms, first {row['first_s']:.3g} s", flush=True)
    rows = [row for row in lines.lines if key.items() <= row.items()]
    if rows:
        print(
            f"\n{device}\n{table([{k: row[k] for k in ('what', 'first_s', 'ms')} for row in rows])}"
        )
    if left:
        print(f"\n{left} rows are left: run it again with the same --out", flush=True)
    write(options.json, rows=rows, cores=machine()["cores"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
