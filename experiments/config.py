"""Every number of a run, as frozen dataclasses of plain values; the presets of both experiments."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import jax
import numpy as np
import tyro
from tyro.constructors import PrimitiveConstructorSpec

from experiments.errors import UserError
from experiments.twin import FIRST_ASSET
from scene.attributes import NAMES
from scene.catalogue import AssetPool, check_pool
from scene.library import LibraryError
from scene.render import RENDERERS, RenderSettings, check_settings
from seg.nets import net
from seg.recipes import RECIPES
from seg.settings import TrainSettings
from seg.settings import check_settings as check_train_settings
from seg.weights import load

PRESETS = ("smoke", "quick", "paper")
CANDIDATES = ("argmax", "spread", "broad")
KNOWN_CANDIDATES = (*CANDIDATES, "random")

POSITIONS = tuple(
    f"{n}_position" for n in ("building", "fence", "tree", "pole", "bicycle", "person", "car")
)
DENSITIES = (
    "building_probability",
    *(f"{n}_interval" for n in ("building", "fence", "tree", "bicycle", "person", "pole", "car")),
)
ENVIRONMENT = NAMES[:8]

CITYSCAPES_GROUPS: tuple[tuple[str, ...], ...] = (
    POSITIONS,
    *(DENSITIES[i : i + 2] for i in range(0, 8, 2)),
    ENVIRONMENT,
)
"""The paper's six groups for Cityscapes: positions, densities in four pairs, environment."""

CAMVID_GROUPS: tuple[tuple[str, ...], ...] = (
    *(POSITIONS[i : i + 2] for i in range(0, 7, 2)),
    DENSITIES,
    ENVIRONMENT,
)
"""The paper's six groups for CamVid: positions in four, densities, environment."""


Group = Annotated[
    tuple[str, ...],
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="NAME,NAME,...",
        instance_from_str=lambda words: tuple(words[0].split(",")),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda group: [",".join(group)],
    ),
]
"""Names of attributes; on the command line one word, with commas."""

MethodName = Literal[
    "actor_critic",
    "sdr",
    "random_attributes",
    "random_search",
    "attribute_descent",
    "gaussian",
    "pbil",
    "linear",
    "cma_es",
    "tpe",
]
"""Every search method, by the name of its function in ``sdr_jax``."""

SEED_END = 2**31
"""Seeds lie below: what is derived from them must fit into 32 bits."""


@dataclass(frozen=True)
class Stage:
    """One size of the same job: render a dataset, train a net on it, score the net."""

    width: int
    """Pixels across, of rendered and real images alike."""
    height: int
    """Pixels down."""
    streets: int
    """Streets per dataset."""
    shots: int
    """Images per street."""
    samples: int = 2
    """Rays per pixel along each axis."""
    train: TrainSettings = field(default_factory=TrainSettings)
    """The net and how it is trained; its class table follows the target."""

    @property
    def images(self) -> int:
        """Images per dataset."""
        return self.streets * self.shots

    def render_settings(self) -> RenderSettings:
        """The engine's settings at this size."""
        return RenderSettings(self.width, self.height, self.samples)


@dataclass(frozen=True)
class Search:
    """How the attributes are searched for. The paper's values are those of the ``paper`` preset."""

    method: Annotated[MethodName, tyro.conf.arg(aliases=["--method"])] = "actor_critic"
    """The search method; ``sdr`` is the paper's."""
    bins: int = 10
    """Values that each attribute is cut into (the paper's K)."""
    updates_per_group: int = 8
    """Policy updates for each group; other methods than SDR take as many in all, without an order."""
    datasets_per_update: int = 4
    """Datasets that each update renders, trains on and scores."""
    learning_rate: float = 1e-2
    """Of Adam."""
    baseline: Literal["ema", "ema_current", "leave_one_out"] = "leave_one_out"
    """What a reward is compared with: earlier rewards (paper), those and itself (the authors' code),
    or the update's other rewards."""
    normalise: bool = True
    """Divide advantages by their size."""
    squared_reward: bool = False
    """(100 mIoU)^2, as in the authors' code, instead of mIoU."""
    relaxation: float | None = None
    """Width of a relaxed bin, as a share of the range; by default 1 / bins, so that bins tile it."""
    common_random_numbers: bool = False
    """Datasets of one update share their seed, and their streets' places within the intervals."""
    unoptimised: Literal["random", "half"] = "random"
    """What groups not optimised yet are: random (paper), or 0.5 (the authors' code)."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """One run. Every field is a flag."""

    search: Search
    reward: Stage
    """The cheap stage that gives the rewards."""
    final: Stage
    """The full stage that gives the reported figures."""
    preset: Literal["smoke", "quick", "paper"] = "quick"
    """Where the defaults of all other flags come from."""
    data: Path | None = None
    """Folder of real images. By default the variable CAMVID_DIR (camvid), or the twin (cityscapes)."""
    out: Path = Path("runs/run")
    """The run folder. The same command continues a run that was stopped."""
    seed: int = 0
    """Decides everything left to chance, but for the twin."""
    renderer: str = "embree"
    """embree or opengl."""
    workers: int = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    """Processes, one core each; 0 works in the main process."""
    reward_images: int | None = None
    """At most so many real images for the reward (a seeded choice); by default all."""
    test_images: int | None = None
    """At most so many real images for the reported figures; by default all."""
    test_split: str | None = None
    """The split that is reported on; by default the data's own."""
    holdout: str | None = None
    """Report on this sequence (CamVid) or city (Cityscapes), taken out of the training images."""
    twin_seed: int = 0
    """Decides the hidden attributes of the twin, when there is no data."""
    candidates: tuple[str, ...] = CANDIDATES
    """Ways to relax the learnt answer: argmax (best bins), spread (as wide as the policy is unsure),
    broad (the same, at least half of each range); random (all attributes random) may stand beside them."""
    candidate_seeds: int = 2
    """Nets that each candidate is scored with, at the final size, on the reward images."""
    ladder: bool = False
    """Score candidates on a ladder of stages up to the final size, the worse half leaving at each rung."""
    default_width: float = 0.15
    """Relaxation of the street set by eye, as a share of each range."""
    seeds: int = 5
    """Nets per row of the result; paired: the k-th of every row shares its seed."""
    store: Path | None = None
    """File of evaluations that runs share: none is made twice. See ``experiments.store``."""
    assets: Path | None = None
    """Folder of own assets, by class (see ``scene.library``)."""
    asset_use: Literal["both", "own", "built-in"] = "both"
    """Which assets streets draw from. With ``own``, classes without own assets are left out."""
    asset_fraction: float = 1.0
    """Share of the assets that is used (the half-asset study)."""
    asset_count: int | None = None
    """Built-in assets of each family that streets may draw from; by default the full catalogue."""
    reward_kind: Literal["miou", "mmd"] = "miou"
    """miou of a net trained on the dataset; or mmd, for reward images without labels: minus the distance
    of rendered and real images in the features of one net, in units of its own."""
    unlabelled: Path | None = None
    """Folder of images that give the reward in place of the labelled training images; only with
    --reward-kind mmd. The reported figures still come from --data."""
    groups: tuple[Group, ...]
    """Attributes optimised together, one word per group, in this order; each of the 23 in one group."""

    @property
    def pool(self) -> AssetPool:
        """The assets that the search may use; the twin's begin elsewhere."""
        own = "" if self.assets is None else str(self.assets)
        return AssetPool(0, self.asset_count, self.asset_fraction, own, self.asset_use)


def check(config: Config) -> Config:
    """The configuration itself.

    Raises:
        UserError: a field out of range, by name.
    """
    if config.renderer not in RENDERERS:
        raise UserError(f"--renderer {config.renderer!r} is unknown; known: {', '.join(RENDERERS)}")
    for name in ("seeds", "candidate_seeds", "reward_images", "test_images"):
        value = getattr(config, name)
        if value is not None and value < 1:
            raise UserError(f"--{name.replace('_', '-')} must be 1 or more, not {value}")
    if config.asset_count is not None and config.asset_count >= FIRST_ASSET:
        raise UserError(
            f"--asset-count must be less than {FIRST_ASSET}, where the twin's begin, "
            f"not {config.asset_count}"
        )
    try:
        check_pool(config.pool, "--asset-")
    except LibraryError as error:
        raise UserError(f"--assets: {error}") from None
    except ValueError as error:
        raise UserError(str(error)) from None
    for name in ("workers", "seed", "twin_seed"):
        if getattr(config, name) < 0:
            raise UserError(f"--{name.replace('_', '-')} must be 0 or more")
    if config.seed >= SEED_END:
        raise UserError(f"--seed must be less than {SEED_END}, not {config.seed}")
    if not config.candidates or set(config.candidates) - set(KNOWN_CANDIDATES):
        raise UserError(
            f"--candidates must be some of {', '.join(KNOWN_CANDIDATES)}; "
            f"not {' '.join(config.candidates) or 'none'}"
        )
    refuse_repeats("--candidates", config.candidates)
    if not 0 <= config.default_width <= 1:
        raise UserError(f"--default-width must lie in [0, 1], not {config.default_width}")
    for stage_name in ("reward", "final"):
        stage: Stage = getattr(config, stage_name)
        for name in ("streets", "shots"):
            if getattr(stage, name) < 1:
                raise UserError(f"--{stage_name}.{name} must be 1 or more")
        if stage.width % 8 or stage.height % 8:
            raise UserError(
                f"--{stage_name}.width and --{stage_name}.height must be multiples of 8, "
                f"not {stage.width}x{stage.height}"
            )
        try:
            check_settings(stage.render_settings())
        except ValueError as error:
            raise UserError(f"--{stage_name}: {error}") from None
        _check_training(f"--{stage_name}.train", stage.train)
    for name in ("bins", "updates_per_group", "datasets_per_update"):
        least = 2 if name == "bins" else 1
        if getattr(config.search, name) < least:
            raise UserError(f"--search.{name.replace('_', '-')} must be {least} or more")
    if not 0 < config.search.learning_rate < math.inf:
        raise UserError(
            f"--search.learning-rate must be positive, not {config.search.learning_rate}"
        )
    if config.search.baseline == "leave_one_out" and config.search.datasets_per_update < 2:
        raise UserError(
            "--search.baseline leave_one_out needs --search.datasets-per-update 2 or more"
        )
    if config.unlabelled is not None and config.reward_kind != "mmd":
        raise UserError("--unlabelled needs --reward-kind mmd: mIoU needs labels")
    if config.reward_kind == "mmd":
        if config.search.squared_reward:
            raise UserError(
                "--search.squared-reward needs --reward-kind miou: squares have no sign"
            )
        if min(config.reward.images, config.final.images) < 2:
            raise UserError("--reward-kind mmd needs stages of at least 2 images")
    return config


def refuse_repeats(flag: str, values: Sequence[object]) -> None:
    """Raise UserError if a flag names one value twice."""
    if len(set(values)) < len(values):
        raise UserError(f"{flag} {' '.join(map(str, values))} names one of them twice")


def _check_training(flag: str, train: TrainSettings) -> None:
    """Refuse settings that no net can be trained with; ``flag`` is their prefix.

    Raises:
        UserError: a field out of range, by name.
        WeightsError: weights that do not fit the net.
    """
    for name in ("steps", "batch", "predict_batch"):
        if getattr(train, name) < 1:
            raise UserError(f"{flag}.{name.replace('_', '-')} must be 1 or more")
    for name in ("warmup", "power", "momentum", "weight_decay"):
        if not 0 <= getattr(train, name) < math.inf:
            raise UserError(f"{flag}.{name.replace('_', '-')} must be 0 or more")
    if not 0 < train.lr < math.inf:
        raise UserError(f"{flag}.lr must be positive, not {train.lr}")
    try:
        check_train_settings(train)
    except ValueError as error:
        raise UserError(f"{flag}: {error}") from None
    check_weights(train)


def check_weights(train: TrainSettings) -> None:
    """Raise WeightsError now, and not after the search, if the weights do not fit the net."""
    if train.weights is not None:
        module = net(train.net, train.classes, train.dtype, train.norm)
        blank = jax.ShapeDtypeStruct((1, 64, 64, 3), np.float32)
        shapes = jax.eval_shape(module.init, jax.random.key(0), blank)["params"]
        load(train.weights, train.net, shapes)


def with_table(config: Config, name: str) -> Config:
    """The configuration with nets that tell apart the classes of a table."""

    def told(stage: Stage) -> Stage:
        return replace(stage, train=replace(stage.train, table=name))

    return replace(config, reward=told(config.reward), final=told(config.final))


def _smoke(groups: tuple[tuple[str, ...], ...], width: int, height: int) -> Config:
    tiny = TrainSettings(steps=12, batch=4, warmup=2)
    return Config(
        preset="smoke",
        groups=groups,
        search=Search(updates_per_group=1, datasets_per_update=2, bins=5),
        reward=Stage(width, height, streets=2, shots=2, samples=1, train=tiny),
        final=Stage(width, height, streets=3, shots=2, samples=1, train=replace(tiny, steps=20)),
        reward_images=8,
        test_images=8,
        candidate_seeds=1,
        candidates=("argmax", "spread"),
        seeds=2,
        asset_count=4,
    )


def _paper(groups: tuple[tuple[str, ...], ...], width: int, height: int) -> Config:
    net = RECIPES["paper"]
    return Config(
        preset="paper",
        groups=groups,
        search=Search(
            method="sdr",
            updates_per_group=50,
            datasets_per_update=1,
            baseline="ema",
            normalise=False,
        ),
        reward=Stage(width, height, 18, 10, samples=1, train=net),
        final=Stage(width, height, 45, 10, samples=1, train=replace(net, steps=20_000)),
        candidates=("argmax",),
        candidate_seeds=1,
    )


def cityscapes_config(preset: str) -> Config:
    """The defaults of ``python -m experiments.cityscapes``."""
    if preset == "smoke":
        return with_table(_smoke(CITYSCAPES_GROUPS, 64, 32), "cityscapes")
    if preset == "paper":
        paper = _paper(CITYSCAPES_GROUPS, 640, 320)
        return with_table(replace(paper, reward_images=500), "cityscapes")
    quick = Config(
        preset="quick",
        groups=CITYSCAPES_GROUPS,
        search=Search(updates_per_group=10, datasets_per_update=4, relaxation=0.3),
        reward=Stage(64, 32, streets=12, shots=6, train=TrainSettings(steps=120)),
        final=Stage(96, 48, streets=30, shots=6, train=TrainSettings(steps=300)),
        reward_images=500,
        seeds=8,
    )
    return with_table(quick, "cityscapes")


def camvid_config(preset: str) -> Config:
    """The defaults of ``python -m experiments.camvid``."""
    if preset == "smoke":
        return _smoke(CAMVID_GROUPS, 64, 48)
    if preset == "paper":
        return _paper(CAMVID_GROUPS, 480, 360)
    return Config(
        preset="quick",
        groups=CAMVID_GROUPS,
        search=Search(updates_per_group=6, datasets_per_update=8, relaxation=0.3),
        reward=Stage(64, 48, streets=12, shots=8, train=TrainSettings(steps=200)),
        final=Stage(128, 96, streets=50, shots=8, train=TrainSettings(steps=1000)),
        candidate_seeds=3,
    )
