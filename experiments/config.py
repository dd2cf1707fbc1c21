"""What a job can be told: frozen dataclasses of plain values, each field a flag; defaults: `presets`."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro
from tyro.constructors import PrimitiveConstructorSpec

import sdr_jax
from scene.assets.catalogue import AssetPool, check_pool
from scene.attributes import SpaceName, default_unit, names
from scene.proposal import (
    RELAXATION,
    Mixture,
    Proposal,
    Streets,
    moments,
    named,
    slide,
    space_in,
    streets_in,
)
from scene.render import RenderSettings, check_settings
from scene.workers import ExecutorName
from sdr_jax.registry import MethodName
from seg.beside import drawn
from seg.nets.lite0 import SMALLEST
from seg.settings import TrainSettings
from seg.settings import check_settings as check_train_settings
from seg.weights import check as check_weights
from shell.errors import UserError, refuse_repeats

Preset = Literal["smoke", "quick", "paper"]
TargetName = Literal["twin", "camvid", "cityscapes", "labelmefacade"]
TwinName = Literal["near", "far"]
Candidate = Literal["argmax", "seen", "broad", "last", "previous", "mixed", "random", "default"]
OF_POOL: tuple[Candidate, ...] = ("last", "previous", "mixed")
OF_OTHERS: tuple[Candidate, ...] = ("argmax", "seen", "broad")
"""Candidates that only the method `pool` has, and those that only the others have."""
RewardKind = Literal["miou", "mmd"]

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
WIDE = 0.5
"""Width of the intervals around the hand-set street that half of a pool's first streets are drawn from."""
Unused = (tyro.conf.Fixed, tyro.conf.Suppress)
"""Marks of a field that is no flag of a command, though others have it."""

SEED_END = 2**31
"""Seeds lie below: what is derived from them must fit into 32 bits."""


@dataclass(frozen=True)
class Fidelity:
    """How large an evaluation is: the dataset that is rendered, and the net that is trained on it."""

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
    """The net and how it is trained."""

    @property
    def images(self) -> int:
        """Images per dataset."""
        return self.streets * self.shots

    @property
    def size(self) -> str:
        """Width and height in one word."""
        return f"{self.width}x{self.height}"

    def render_settings(self) -> RenderSettings:
        """The engine's settings at this size."""
        return RenderSettings(self.width, self.height, self.samples)


@dataclass(frozen=True)
class Bins:
    """How attributes are cut."""

    bins: int = 10
    """Values that each attribute is cut into (the paper's K)."""
    relaxation: float | None = None
    """Width of a relaxed bin, as a share of the range; by default 1 / bins, so that bins tile it."""


@dataclass(frozen=True)
class PoolOptions:
    """How the method ``pool`` searches: what a reward is one of, how many there are, how far a step goes."""

    streets: int = 1200
    """Streets of one shot that each round draws and renders."""
    subset: int = 200
    """Streets of a round that one reward's net is trained on."""
    rewards: int = 120
    """Rewards of each round."""
    rounds: int = 4
    """Rounds; each ends with a step of the policy."""
    bound: float = 0.04
    """Nats that a step may take at most, for each attribute."""


@dataclass(frozen=True)
class SearchOptions(Bins):
    """How any method searches. Under every preset ``sdr`` estimates its gradient as the paper does."""

    datasets_per_update: int = 4
    """Datasets that each update renders, trains on and scores."""
    learning_rate: float = 1e-2
    """Of Adam (sdr)."""
    baseline: Literal["ema", "ema_current", "leave_one_out"] = "ema"
    """What a reward is compared with (sdr): earlier rewards (paper), those and itself (the authors' code),
    or the update's other rewards."""
    normalise: bool = False
    """Divide advantages by their size (sdr; not in the paper)."""
    squared_reward: bool = False
    """(100 mIoU)^2, as in the authors' code, instead of mIoU (sdr)."""
    common_random_numbers: bool = False
    """Datasets of one update share their seed, and their streets' places within the intervals."""
    start: Annotated[str, tyro.conf.arg(aliases=["--start"])] = "default"
    """Where the search begins (intervals, pool): default (the hand-set street), random, or an
    attributes.json. Half of a pool's first streets are random in any case."""
    pool: PoolOptions = field(default_factory=PoolOptions)
    """Of the method pool."""
    unoptimised: Literal["random", "half"] = "random"
    """What groups not optimised yet are (sdr): random (paper), or 0.5 (the authors' code)."""


@dataclass(frozen=True)
class MethodOptions(SearchOptions):
    """Which method searches, and how."""

    method: Annotated[MethodName, tyro.conf.arg(aliases=["--method"])] = "surrogate"
    """The search method; ``sdr`` is the paper's."""


@dataclass(frozen=True)
class Search(MethodOptions):
    """The whole search."""

    updates_per_group: int = 8
    """Policy updates for each group; methods without an order of groups take as many in all."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """What every job on a target can be told."""

    reward: Fidelity
    """The cheap fidelity that gives the rewards."""
    target: TargetName = "twin"
    """What the nets must be good on."""
    preset: Preset = "quick"
    """Where the defaults of all other flags come from."""
    space: SpaceName = "scenex"
    """The attributes of streets: the paper's 23, or those with the added of camera and road. By default
    extended with --twin far, else scenex."""
    data: Path | None = None
    """Folder of real images. By default the variable CAMVID_DIR for camvid, LABELMEFACADE_DIR for
    labelmefacade."""
    out: Path = Path("runs/run")
    """The run folder. The same command continues a run that was stopped."""
    seed: int = 0
    """Decides everything left to chance, but for the twin and for the choice of real images."""
    renderer: Literal["embree", "opengl"] = "embree"
    """What renders."""
    workers: int = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    """Processes that render and train, one core each; 0 starts one, too."""
    executor: ExecutorName = "processes"
    """Who works: processes of this machine, or a Dask cluster (see docs/cluster.md)."""
    scheduler: str | None = None
    """Address of the cluster's scheduler, such as tcp://10.0.0.1:8786; its workers stand in for --workers."""
    reward_images: int | None = None
    """At most so many real images for the reward, a random choice that is the same for every --seed; by
    default all."""
    test_images: int | None = None
    """At most so many real images for the reported figures, chosen alike; by default all."""
    test_split: str | None = None
    """The split that is reported on; by default the data's own."""
    holdout: str | None = None
    """Report on this sequence (CamVid), city (Cityscapes) or album (LabelMeFacade), taken out of the training
    images."""
    twin_seed: int = 0
    """Decides the hidden attributes of the twin, when there is no data."""
    twin: TwinName = "near"
    """Where the twin's hidden attributes lie: around the hand-set street (near), or anywhere in the extended
    space (far)."""
    store: Path | None = None
    """File of evaluations that runs share: none is made twice. See ``experiments.store``."""
    assets: Path | None = None
    """Folder of own assets, by class (see ``scene.library``)."""
    asset_use: Literal["both", "own", "built-in"] = "both"
    """Which assets streets draw from. With ``own``, classes without own assets are left out."""
    asset_fraction: float = 1.0
    """Share of the assets that is used."""
    asset_count: int | None = None
    """Built-in assets of each family that streets may draw from; by default the full catalogue."""

    @property
    def target_name(self) -> str:
        """What results and records call the target."""
        return "far twin" if self.twin == "far" else self.target

    @property
    def pool(self) -> AssetPool:
        """The assets that the search may use; the twin's begin elsewhere."""
        own = "" if self.assets is None else str(self.assets)
        return AssetPool(0, self.asset_count, self.asset_fraction, own, self.asset_use)


@dataclass(frozen=True, kw_only=True)
class NetsConfig(Config):
    """What a job that reports final nets can be told, too."""

    final: Fidelity
    """The full fidelity that gives the reported figures."""
    seeds: int = 5
    """Nets per row of the result; paired: the k-th of every row shares its seed."""


@dataclass(frozen=True, kw_only=True)
class GroupsConfig(NetsConfig):
    """What a job that searches can be told, too."""

    search: SearchOptions
    groups: tuple[Group, ...]
    """Attributes optimised together, one word per group, in this order; each of the space in one group."""


@dataclass(frozen=True, kw_only=True)
class SearchConfig(GroupsConfig):
    """What a job that learns attributes can be told, too."""

    search: Search
    candidates: tuple[Candidate, ...] = get_args(Candidate)
    """What may be the answer: argmax (the best found), seen (the dataset with the best reward), broad (as
    wide as the search is unsure, at least half of each range), in place of these three with the method pool
    last (its last policy), previous (the one before) and mixed (half the last, half the first); random (all
    attributes random) or default (the hand-set street: the others must be significantly better)."""
    candidate_seeds: int = 10
    """Nets of each candidate on each rung, scored on the reward images; with 1 the hand-set street stays."""
    parts: int | None = None
    """Parts of the reward images that candidates are also scored on, for the report; by default one for each
    sequence, city or album, 2 to 4."""
    ladder: bool = False
    """Compare candidates on a ladder of sizes up to the final one, the better half going on to the next."""
    default_width: float = RELAXATION
    """Relaxation of the street set by eye, as a share of each range."""
    reward_kind: RewardKind = "miou"
    """miou of a net trained on the dataset; or mmd, for reward images without labels: minus the distance
    of rendered and real images in the features of one net, in units of its own."""


@dataclass(frozen=True, kw_only=True)
class ShareConfig:
    """How a few labelled images join rendered ones."""

    few_share: float = 0.5
    """What part of all batches the few labelled images are, however few they are."""


@dataclass(frozen=True, kw_only=True)
class FewConfig(ShareConfig):
    """A few labelled images beside every training set."""

    few: int | float | None = None
    """So many labelled images (or, below 1, this share of them) join every training set; then only the others
    give the reward. A random choice, spread over sequences and time, that is the same for every --seed."""


@dataclass(frozen=True, kw_only=True)
class MainConfig(SearchConfig, FewConfig):
    """One run of the main job. Every field is a flag."""

    target: Annotated[TargetName, *Unused] = "twin"
    unlabelled: Path | None = None
    """Folder of images that give the reward in place of the labelled training images; only with
    --reward-kind mmd. The reported figures still come from --data."""


@dataclass(frozen=True, kw_only=True)
class Rederived:
    """What every study can be told."""

    rederive: Path | None = None
    """Only write the table and the figure of this report (NAME.json) anew, into --out."""


@dataclass(frozen=True, kw_only=True)
class LearntConfig(SearchConfig, Rederived):
    """What a study of learnt attributes can be told, too."""

    learnt: Path | None = None
    """attributes.json of an earlier run; by default the search runs here."""


@dataclass(frozen=True, kw_only=True)
class SearchesConfig(GroupsConfig, Rederived):
    """What a study of many searches can be told, too."""

    evaluations: int
    """Rewards that each search may ask for."""


def check(config: Config) -> None:
    """Refuse what no job can work with, by flag; files are looked at only where weights are named.

    Raises:
        UserError: a field out of range.
    """
    for name in ("seeds", "candidate_seeds", "parts", "reward_images", "test_images"):
        _at_least(f"--{name}", getattr(config, name, None), 1)
    for name in ("workers", "seed", "twin_seed"):
        _at_least(f"--{name}", getattr(config, name), 0)
    if config.twin == "far" and config.target != "twin":
        raise UserError(f"--twin far needs --target twin, not {config.target}")
    if config.seed >= SEED_END:
        raise UserError(f"--seed must be less than {SEED_END}, not {config.seed}")
    with flagged("--assets", "--asset"):
        check_pool(config.pool, "--asset-")
    for name, fidelity in fidelities(config).items():
        _check_fidelity(f"--{name}", fidelity)
    search = getattr(config, "search", None)
    if search is not None:
        _check_search(search)
    if hasattr(config, "reward_kind"):
        _check_rewards(config)
    if isinstance(config, SearchConfig):
        _check_answer(config)
    if isinstance(config, ShareConfig):
        _check_few(config)


def fidelities(config: Config) -> dict[str, Fidelity]:
    """The fidelities of a configuration, by field."""
    return {name: own for name, own in vars(config).items() if isinstance(own, Fidelity)}


def _at_least(flag: str, value: float | None, least: int) -> None:
    if value is not None and value < least:
        raise UserError(f"{flag.replace('_', '-')} must be {least} or more, not {value}")


def refuse_shares(flag: str, shares: Sequence[float]) -> None:
    """Raise UserError unless each of one or more shares lies in (0, 1], none of them twice."""
    if not shares:
        raise UserError(f"{flag} needs at least one value")
    refuse_repeats(flag, shares)
    for share in shares:
        if not 0 < share <= 1:
            raise UserError(f"{flag} must lie in (0, 1], not {share:g}")


class flagged:
    """Errors of libraries name the flag that is to blame.

    Args:
        flag: of the value.
        unless: how messages begin that name their flag already.
    """

    def __init__(self, flag: str, unless: str = "--") -> None:
        self._flag, self._unless = flag, unless

    def __enter__(self) -> None:
        """Nothing to do."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ValueError | ImportError):
            said = str(error)
            named = said if said.startswith(self._unless) else f"{self._flag}: {said}"
            raise UserError(named) from None


def _check_fidelity(flag: str, fidelity: Fidelity) -> None:
    for name in ("streets", "shots"):
        _at_least(f"{flag}.{name}", getattr(fidelity, name), 1)
    if fidelity.width % 8 or fidelity.height % 8:
        raise UserError(
            f"{flag}.width and {flag}.height must be multiples of 8, not {fidelity.size}"
        )
    with flagged(flag):
        check_settings(fidelity.render_settings())
    train = fidelity.train
    for name in ("steps", "batch", "predict_batch"):
        _at_least(f"{flag}.train.{name}", getattr(train, name), 1)
    for name in ("warmup", "power", "momentum", "weight_decay"):
        if not 0 <= getattr(train, name) < math.inf:
            raise UserError(f"{flag}.train.{name.replace('_', '-')} must be 0 or more")
    if train.warmup >= SEED_END:
        raise UserError(f"{flag}.train.warmup must be less than {SEED_END}, not {train.warmup}")
    if not 0 < train.lr < math.inf:
        raise UserError(f"{flag}.train.lr must be positive, not {train.lr}")
    check_net(flag, f"{flag}.train", fidelity)


def check_net(flag: str, train_flag: str, fidelity: Fidelity) -> None:
    """Raise UserError for a size, settings or weights that do not fit the net, by flag."""
    train = fidelity.train
    if train.net == "lite0" and min(fidelity.width, fidelity.height) < SMALLEST:
        raise UserError(
            f"{flag}: images of {fidelity.size} are too small for lite0, which needs "
            f"{SMALLEST} pixels in width and height"
        )
    with flagged(train_flag):
        check_train_settings(train)
    check_weights(train, 1)  # of any number of classes: the last layer is not among them


def _check_search(search: Bins) -> None:
    for name, least in (("bins", 2), ("updates_per_group", 1), ("datasets_per_update", 1)):
        _at_least(f"--search.{name}", getattr(search, name, None), least)
    width = search.relaxation
    if width is not None and not 0 <= width <= 1:
        raise UserError(f"--search.relaxation must lie in [0, 1], not {width}")
    if isinstance(search, SearchOptions):
        pool = search.pool
        for name, least in (("streets", 1), ("subset", 1), ("rewards", 2), ("rounds", 1)):
            _at_least(f"--search.pool.{name}", getattr(pool, name), least)
        if pool.subset > pool.streets:
            raise UserError(
                f"--search.pool.subset {pool.subset} is more than the {pool.streets} streets of "
                "--search.pool.streets that it is taken from"
            )
        if not 0 < pool.bound < math.inf:
            raise UserError(f"--search.pool.bound must be positive, not {pool.bound}")
        if not 0 < search.learning_rate < math.inf:
            raise UserError(f"--search.learning-rate must be positive, not {search.learning_rate}")
        if search.baseline == "leave_one_out" and search.datasets_per_update < 2:
            raise UserError(
                "--search.baseline leave_one_out needs --search.datasets-per-update 2 or more"
            )


def _check_rewards(config: Any) -> None:
    if not 0 <= config.default_width <= 1:
        raise UserError(f"--default-width must lie in [0, 1], not {config.default_width}")
    if config.reward_kind == "mmd" and min(config.reward.images, config.final.images) < 2:
        raise UserError("--reward-kind mmd needs fidelities of at least 2 images")


def _check_few(config: Any) -> None:
    few: int | float | None = getattr(config, "few", None)
    if few is not None:
        if isinstance(few, int):
            _at_least("--few", few, 1)
        elif not 0 < few <= 1:
            raise UserError(f"--few must be a number of images or a share in (0, 1), not {few}")
        if getattr(config, "unlabelled", None) is not None or config.reward_kind == "mmd":
            raise UserError("--few needs rewards of labelled images: --reward-kind miou")
    if not 0 < config.few_share < 1:
        raise UserError(f"--few-share must lie in (0, 1), not {config.few_share}")
    for name, fidelity in fidelities(config).items():
        train = fidelity.train
        images = train.steps * train.batch
        if drawn(config.few_share, images) in (0, images):
            what = "none" if config.few_share < 0.5 else "all"
            raise UserError(
                f"--few-share {config.few_share} makes {what} of the {images} images of "
                f"--{name}.train.steps {train.steps} x --{name}.train.batch {train.batch} few ones"
            )


def _check_answer(config: SearchConfig) -> None:
    if not config.candidates:
        raise UserError("--candidates needs at least one way to relax the answer")
    refuse_repeats("--candidates", config.candidates)
    if getattr(config, "unlabelled", None) is not None and config.reward_kind != "mmd":
        raise UserError("--unlabelled needs --reward-kind mmd: mIoU needs labels")
    if not offered(config):
        own = OF_POOL if config.search.method == "pool" else OF_OTHERS
        raise UserError(
            f"--candidates {' '.join(config.candidates)}: --method {config.search.method} has "
            f"{', '.join(own)}, random and default"
        )
    if config.search.method == "pool":
        _check_pool(config)
    if config.reward_kind == "mmd" and config.search.squared_reward:
        raise UserError("--search.squared-reward needs --reward-kind miou: squares have no sign")
    make_method(config, config.search.method, make_space(config), 1)


def offered(config: SearchConfig) -> tuple[Candidate, ...]:
    """Those of the configuration's candidates that its method has."""
    absent = OF_OTHERS if config.search.method == "pool" else OF_POOL
    return tuple(name for name in config.candidates if name not in absent)


def _check_pool(config: SearchConfig) -> None:
    """Raise UserError for what the method pool cannot do."""
    if config.reward_kind != "miou":
        raise UserError("--method pool needs --reward-kind miou")
    if not config.reward.train.frozen:
        train = config.reward.train
        kind = "a tuned trunk" if train.net == "lite0" else f"the net {train.net}"
        raise UserError(
            f"--method pool keeps the features of a frozen trunk, and --reward.train has {kind}; use "
            "--reward.train.net lite0 --reward.train.trunk frozen, or another --method"
        )


def make_space(config: Any) -> sdr_jax.Space:
    """The space's attributes in the configuration's bins and groups; without groups, all in one.

    Raises:
        UserError: groups that are no partition of the attributes.
    """
    with flagged("--groups"):
        return sdr_jax.space(
            names(config.space), config.search.bins, getattr(config, "groups", None)
        )


def start_of(config: Any) -> Proposal:
    """Where the configuration's search begins, f32[attributes of the space] each; a histogram's moments.

    Raises:
        UserError: the file of a mixture, or none of this space's attributes.
    """
    start = config.search.start
    if start in ("random", "default"):
        return named(start, config.space, getattr(config, "default_width", RELAXATION))
    found = read_attributes("--search.start", Path(start), config.space)
    if isinstance(found, Mixture):
        raise UserError(
            f"--search.start {start} holds {len(found.shares)} components; a search starts from one"
        )
    return moments(found)


def read_attributes(flag: str, path: Path, space: SpaceName) -> Streets:
    """The streets in an ``attributes.json``.

    Raises:
        UserError: no such file, or the file of something else, such as of another space; names the flag.
    """
    try:
        found = streets_in(path)
    except OSError as error:
        raise UserError(f"{flag} {path}: {error.strerror}") from None
    except ValueError as error:
        raise UserError(f"{flag} {error}") from None
    theirs = space_in(found)
    if theirs != space:
        raise UserError(f"{flag} {path} holds attributes of --space {theirs}, not {space}")
    return found


def make_method(
    config: Any, name: MethodName, space: sdr_jax.Space, updates_per_group: int
) -> sdr_jax.Method:
    """A search method as the configuration has it, for some of its attributes.

    Raises:
        UserError: an option out of range, a start that cannot be read, or a library that is not installed.
    """
    own: dict[str, Any] = {}
    options: SearchOptions = config.search
    where = [names(config.space).index(attribute) for attribute in space.names]
    if name == "intervals":
        own["start"] = tuple(tuple(part[where].tolist()) for part in start_of(config))
    if name == "pool":
        own["bound"] = options.pool.bound
        if options.start != "random":
            start = start_of(config)
            if options.start == "default":
                start = slide(default_unit(config.space), WIDE)
            own["start"] = tuple(tuple(part[where].tolist()) for part in start)
    if name == "sdr":
        fields = ("learning_rate", "baseline", "normalise", "squared_reward", "unoptimised")
        own = {field: getattr(options, field) for field in fields}
        own["updates_per_group"] = updates_per_group
    with flagged("--search"):
        return sdr_jax.registry.make(name, space, options.relaxation, **own)
