"""Configurations: frozen dataclasses of plain values, each field a flag; `presets` has their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

from common.bounds import Bound, at_least, at_most, must, within
from common.flags import REPEATED, UNUSED, Option, Word
from common.memory import refuse_larger
from common.workers.pool import ExecutorName, cores, refuse_many_workers
from experiments.config.options import Bins, Fidelity, Search, SearchOptions
from scene.attributes import SpaceName, names
from scene.held import hold, read_fixed
from scene.proposal import Streets, streets_named

if TYPE_CHECKING:
    from scene.assets.catalogue import AssetPool

Preset = Literal["smoke", "quick", "paper"]
FitPreset = Literal["smoke", "quick", "full"]
"""The presets of `sdr-jax fit`."""
TargetName = Literal["twin", "camvid", "cityscapes", "labelmefacade"]
TwinName = Literal["near", "far"]

Group = Annotated[
    tuple[str, ...], Word("NAME,NAME,...", lambda word: tuple(word.split(",")), ",".join)
]
"""Names of attributes; on the command line one word with commas."""

SEED_END = 2**31
"""All seeds are smaller, since numbers derived from them must fit into 32 bits."""
RECORD = 1000
"""Bytes of the record of a network."""
NETS = Bound(
    lambda flag, count: refuse_larger(flag, count, lambda n: RECORD * n, "records of networks")
)
"""Counts of networks whose records fit into memory."""
_FEW = must(
    "be a number of images, 1 or more, or a share in (0, 1]",
    lambda few: few >= 1 if isinstance(few, int) else 0 < few <= 1,
)


@dataclass(frozen=True, kw_only=True)
class Config:
    """Fields of every job on a target."""

    reward: Fidelity
    """Size of the cheap evaluations that score streets during the search."""
    target: TargetName = "twin"
    """The images on which networks are tested."""
    preset: Preset = "quick"
    """The set of defaults of all other flags."""
    space: SpaceName = "scenex"
    """The attributes of streets: the paper's 23 (scenex), or these plus ours of camera and road (extended).
    By default extended with --twin far, otherwise scenex."""
    fix: Annotated[tuple[str, ...], REPEATED] = ()
    """Hold an attribute at a value in all streets, in its unit, such as field_of_view=90; may be repeated."""
    data: Path | None = None
    """Folder of real images. By default camvid takes $CAMVID_DIR, labelmefacade $LABELMEFACADE_DIR, and
    cityscapes the twin."""
    out: Path = Path("runs/run")
    """The run folder. The same command resumes a stopped run."""
    weights: Path | None = None
    """ImageNet weights from which VGG networks start (see `sdr-jax weights`), or the weights of dinov2."""
    from_scratch: bool = False
    """Let --preset paper train VGG networks without --weights, though they hardly learn then."""
    seed: Annotated[int, at_least(0), at_most(SEED_END - 1)] = 0
    """Seed of all random choices except the twin and the choice of real images."""
    renderer: Literal["embree", "opengl"] = "embree"
    """The renderer."""
    workers: Annotated[int, at_least(0), Bound(refuse_many_workers)] = cores()
    """Processes that render and train, one core each; 0 means 1. With --trainers they only render."""
    trainers: Annotated[int | None, at_least(1)] = None
    """Separate processes that train networks; by default one for each NVIDIA GPU, and none without a GPU."""
    executor: ExecutorName = "processes"
    """The workers: processes of this machine, or a Dask cluster (see docs/cluster.md)."""
    scheduler: str | None = None
    """Address of the cluster's scheduler, such as tcp://10.0.0.1:8786; its workers replace --workers."""
    reward_images: Annotated[int | None, at_least(1)] = None
    """The most validation images of the search, a random choice that does not depend on --seed. By default
    all."""
    test_images: Annotated[int | None, at_least(1)] = None
    """The most real images to test on, chosen in the same way. By default all."""
    test_split: str | None = None
    """The split to test on; by default the data's own."""
    holdout: str | None = None
    """Test on this sequence (CamVid), city (Cityscapes) or group of photos (LabelMeFacade), and leave it out
    of the training images."""
    twin_seed: Annotated[int, at_least(0)] = 0
    """Seed of the twin's hidden attributes."""
    twin: TwinName = "near"
    """Where the twin's hidden attributes lie: around the default street (near), or anywhere in the extended
    space (far)."""
    store: Path | None = None
    """File of evaluations that runs share, so that none is repeated. See `sdr-jax store`."""
    assets: Path | None = None
    """Folder of your own assets by class (see docs/howto/assets.md)."""
    asset_use: Literal["both", "own", "built-in"] = "both"
    """The assets that streets draw from. With ``own``, classes without own assets are left out."""
    overlap: Literal["allow", "avoid"] | None = None
    """Whether objects may overlap. By default they may with --space scenex, as in the paper, and may not with
    --space extended."""
    asset_fraction: float = 1.0
    """Share of the assets to use."""
    asset_count: int | None = None
    """Built-in assets of each family that streets may draw from; by default the full catalogue."""

    @property
    def target_name(self) -> str:
        """The target's name in results and records."""
        return "far twin" if self.twin == "far" else self.target

    @property
    def held(self) -> dict[str, float]:
        """Unit values of the attributes that ``--fix`` holds. Raises UserError as `read_fixed`."""
        return read_fixed(self.fix, self.space)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the other attributes, in the order of the space."""
        held = self.held
        return tuple(name for name in names(self.space) if name not in held)

    @property
    def nets_trained(self) -> tuple[str, ...]:
        """Names of the networks that the job may train."""
        by_name = fidelities(self)
        return tuple(by_name[name].train.net for name in ("reward", "final") if name in by_name)

    def streets(self, name: str) -> Streets:
        """Make the streets ``random``, ``default`` or ``mixed`` with the fixed attributes."""
        return hold(streets_named(name, self.space), self.held)

    @property
    def pool(self) -> AssetPool:
        """The assets of the search; the twin has others."""
        from scene.assets.catalogue import AssetPool  # the help needs no assets

        return AssetPool(
            size=self.asset_count,
            fraction=self.asset_fraction,
            own="" if self.assets is None else str(self.assets),
            use=self.asset_use,
            overlap=self.overlap or "",
        )


@dataclass(frozen=True, kw_only=True)
class FinalConfig(Config):
    """More fields of a job that trains networks at full size."""

    final: Fidelity
    """Size of the full evaluations that are reported."""


@dataclass(frozen=True, kw_only=True)
class NetsConfig(FinalConfig):
    """More fields of a job that reports final networks."""

    seeds: Annotated[int, at_least(1), NETS] = 5
    """Networks per row of the result. They are paired: the k-th networks of all rows share a seed."""


@dataclass(frozen=True, kw_only=True)
class BinsConfig(Config):
    """More fields of a job that cuts attributes into bins."""

    search: Bins


@dataclass(frozen=True, kw_only=True)
class GroupsConfig(NetsConfig, BinsConfig):
    """More fields of a job that searches."""

    search: SearchOptions
    groups: tuple[Group, ...]
    """Groups of attributes to optimise one after the other, one word each. Each attribute is in one group."""


@dataclass(frozen=True, kw_only=True)
class SearchConfig(GroupsConfig):
    """More fields of a job that optimises attributes."""

    search: Search


@dataclass(frozen=True, kw_only=True)
class FewConfig(SearchConfig):
    """More fields of a job with a labelled subset in every training set."""

    few_share: Annotated[float, within(0, 1, "()"), Option(needs=("--few",))] = 0.5
    """Share of the labelled subset in all batches, whatever its size."""
    few: Annotated[int | float | None, _FEW] = None
    """Number of labelled images (or, below 1, their share) to mix with every training set; the search then
    validates on the others. The random choice is spread over sequences and time, and does not depend on
    --seed."""


@dataclass(frozen=True, kw_only=True)
class MainConfig(FewConfig):
    """One run of the main job."""

    target: Annotated[TargetName, UNUSED] = "twin"


@dataclass(frozen=True, kw_only=True)
class Rederived(Config):
    """A field of every study."""

    rederive: Path | None = None
    """Only write the table and plot of this earlier report (NAME.json) into --out."""


@dataclass(frozen=True, kw_only=True)
class LearntConfig(SearchConfig, Rederived):
    """More fields of a study of optimised streets."""

    learnt: Path | None = None
    """Optimised streets of an earlier run (attributes.json); where they are needed without it, a search
    runs first."""


AnyConfig = TypeVar("AnyConfig", bound=Config)


def fidelities(config: Config) -> dict[str, Fidelity]:
    """The fidelities of a configuration by field."""
    return {name: value for name, value in vars(config).items() if isinstance(value, Fidelity)}
