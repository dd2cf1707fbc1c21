"""All jobs: their flags, presets and work; nothing here loads a network, a search or a renderer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from common.bounds import DISTINCT, POSITIVE, at_least, within
from common.flags import UNUSED, Option
from experiments.config import presets
from experiments.config.config import (
    NETS,
    BinsConfig,
    Config,
    FewConfig,
    FinalConfig,
    GroupsConfig,
    LearntConfig,
    MainConfig,
    Preset,
    Rederived,
    TargetName,
)
from experiments.config.options import Fidelity, MethodOptions, RivalName, Search
from experiments.config.presets import Table
from sdr_jax.names import MethodName
from seg.settings import NetName

Renders = Literal["random", "default", "mixed", "learnt"]
PretrainRow = Literal["scratch", "random", "learnt", "longer"]
Variant = Literal[
    "full",
    "no_relaxation",
    "no_groups",
    "shuffled_groups",
    "no_environment",
    "no_positions",
    "no_densities",
    "random",
]
VARIANTS: tuple[Variant, ...] = get_args(Variant)
LEAST = 8
"""The fewest rewards to which a model of sensitivities is fitted."""
MOST_REPEATS = 1_000_000
"""Number of seeds of a rung in the study of fidelity."""


@dataclass(frozen=True, kw_only=True)
class TableConfig(LearntConfig, FewConfig):
    """Flags of `sdr-jax study table`."""

    nets: Annotated[tuple[NetName, ...], DISTINCT] = ("compact",)
    """The networks to train."""
    compact: Fidelity
    """Size for the compact network, if it is not the network of --final."""
    vgg: Fidelity
    """Size for FCN8s and DeepLabv2, if neither is the network of --final."""
    gta5: Path | None = None
    """Folder of GTA5 to train on."""
    synthia: Path | None = None
    """Folder of SYNTHIA RAND-CITYSCAPES."""
    kitti: Path | None = None
    """Folder of KITTI semantics."""
    all_images: Annotated[bool, Option(needs=("--gta5", "--synthia", "--kitti"))] = False
    """Train on all images of these; by default on a random choice of as many as a rendered dataset has."""

    @property
    def nets_trained(self) -> tuple[str, ...]:
        """Names of the networks that the job may train."""
        return (*self.nets, *super().nets_trained)


@dataclass(frozen=True, kw_only=True)
class LabelsConfig(LearntConfig):
    """Flags of `sdr-jax study labels`."""

    few_share: Annotated[float | None, within(0, 1, "()")] = None
    """Share of the labelled images in all batches with renders; by default that of `fit`: a quarter with
    fewer than 20 of them, otherwise half."""
    counts: Annotated[tuple[int, ...] | None, at_least(0), DISTINCT] = None
    """Numbers of labelled training images; by default 0, 7, 14, and 10, 25, 50 and 100 % of all."""
    renders: Annotated[tuple[Renders, ...] | None, DISTINCT] = None
    """Sets of renders to mix with them: random streets, the default street, half of each (mixed), or
    optimised streets (learnt); by default learnt with --learnt, otherwise default."""

    @property
    def rendered(self) -> tuple[Renders, ...]:
        """The sets of renders."""
        if self.renders is not None:
            return self.renders
        return ("default",) if self.learnt is None else ("learnt",)


@dataclass(frozen=True, kw_only=True)
class PretrainConfig(LearntConfig):
    """Flags of `sdr-jax study pretrain`."""

    rows: Annotated[tuple[PretrainRow, ...], DISTINCT] = ("scratch", "random", "learnt")
    """How networks start: scratch (nothing, or ImageNet weights), random or learnt (pre-trained on random or
    optimised streets), longer (from scratch, but first trained for as many steps on the real subset, which
    costs as much as pre-training for every fraction)."""
    fractions: Annotated[tuple[float, ...], within(0, 1, "(]"), DISTINCT] = (0.05, 0.1, 0.25, 1.0)
    """Shares of the real images for fine-tuning, nested, the same for all rows of a seed."""
    learn_on: Literal["all", "share"] = "all"
    """The labels that the search uses: of all real images, or of the share for fine-tuning, which takes a
    search for every fraction, and the same images for all seeds."""
    search_images: Annotated[int | None, at_least(1)] = None
    """The most real images that the search uses, chosen at random; by default all."""
    finetune_steps: Annotated[int | None, at_least(1)] = None
    """Steps of the fine-tuning; by default a third of --final.train.steps."""
    finetune_lr: Annotated[float | None, POSITIVE] = None
    """Highest learning rate of the fine-tuning; by default a third of --final.train.lr."""


@dataclass(frozen=True, kw_only=True)
class AblationConfig(GroupsConfig, Rederived):
    """Flags of `sdr-jax study ablation`."""

    search: MethodOptions
    evaluations: Annotated[int, at_least(1), NETS] = 96
    """Rewards of each search."""
    variants: Annotated[tuple[Variant, ...], DISTINCT] = VARIANTS
    """The variants to compare; they must include full."""


@dataclass(frozen=True, kw_only=True)
class AssetsConfig(LearntConfig):
    """Flags of `sdr-jax study assets`.

    --fractions replaces --asset-fraction, and --images replaces --final.streets.
    """

    asset_fraction: Annotated[float, UNUSED] = 1.0
    images: Annotated[tuple[int, ...], at_least(1), DISTINCT] = (90, 180, 450, 900, 1350)
    """Sizes of the training set in images, multiples of --final.shots (the images of a street)."""
    fractions: Annotated[tuple[float, ...], within(0, 1, "(]"), DISTINCT] = (1.0, 0.5)
    """Shares of the assets."""
    attributes: Literal["random", "default", "learnt"] = "default"
    """The streets: random, default, or optimised (learnt: those of --learnt, otherwise of a search)."""


@dataclass(frozen=True)
class ManySearch(Search):
    """Options of searches by several methods."""

    method: Annotated[MethodName | RivalName, UNUSED] = "surrogate"  # type: ignore[assignment]


@dataclass(frozen=True, kw_only=True)
class ManyConfig(FewConfig, Rederived):
    """Flags of `sdr-jax study searches`.

    --methods replaces --method.
    """

    search: ManySearch
    searches: Annotated[int, at_least(1)] = 5
    """Searches of each method, with seeds --seed, --seed + 1, ..."""
    methods: Annotated[tuple[MethodName | RivalName, ...], DISTINCT] = (
        "intervals",
        "sdr",
        "random_search",
    )
    """The search methods. Those of other libraries (cma_es, tpe, gaussian_process) need a checkout."""
    core_minutes: Annotated[float | None, POSITIVE] = None
    """Give each search as many rewards as take about N minutes of a core; by default as many as the
    preset has."""
    subset: Annotated[tuple[str, ...] | None, DISTINCT, Option(needs=("--core-minutes",))] = None
    """With --core-minutes: the attributes to optimise; the others stay random. By default all."""


@dataclass(frozen=True, kw_only=True)
class SensitivityConfig(BinsConfig, Rederived):
    """Flags of `sdr-jax study sensitivity`."""

    records: tuple[Path, ...] = ()
    """Stores of evaluations and run folders to analyse; nothing is rendered."""
    records_config: Annotated[str | None, Option(needs=("--records",))] = None
    """The configuration in them to analyse, by its name in sdr-jax store show; by default the one with the
    most rewards."""
    evaluations: Annotated[int, at_least(LEAST), NETS, Option(excludes=("--records",))] = 128
    """Without --records: the number of rewards, those of --store included; missing ones are made with random
    attributes."""

    @property
    def nets_trained(self) -> tuple[str, ...]:
        """Names of the networks that the job may train."""
        return () if self.records else super().nets_trained


@dataclass(frozen=True, kw_only=True)
class FidelityConfig(FinalConfig, BinsConfig, Rederived):
    """Flags of `sdr-jax study fidelity`."""

    proposals: Annotated[int, at_least(2), NETS] = 24
    """Proposals with random bins for all attributes; the default street and random streets are added."""
    repeated: Annotated[int, at_least(2), NETS] = 6
    """Proposals evaluated with several seeds, including the two added ones."""
    repeats: Annotated[int, within(2, MOST_REPEATS), NETS] = 4
    """Seeds of each such proposal."""
    rungs: Annotated[int | None, at_least(1)] = None
    """The number of sizes to measure, the cheapest first; by default all, up to the final one."""
    require_signal: Annotated[float | None, POSITIVE] = None
    """Exit with code 1 if the signal of the cheapest reward, which a search would use, is less than N
    times its noise. Require 2 before a search with a network that may learn nothing."""


def methods_of(config: GroupsConfig) -> tuple[str, ...]:
    """Return the methods by which a job searches."""
    if isinstance(config, ManyConfig):
        return config.methods
    return (config.search.method,) if isinstance(config.search, MethodOptions) else ()


class Job(NamedTuple):
    """A command whose flags are the fields of a configuration."""

    kind: type[Config]
    module: str  # whose docstring is the help's first part
    work: str  # the study, or another function of the configuration, as ``module:name``
    called: str  # the command after ``sdr-jax``
    changes: Mapping[Preset, Table] = {}  # differences from the main job by preset
    target: TargetName | None = None  # of a command without --target
    with_data: TargetName | None = None  # another target of such a command with --data


def _main(name: str, target: TargetName, with_data: TargetName | None = None) -> Job:
    module, work = f"experiments.{name}", "experiments.app.main_job:RUN"
    return Job(MainConfig, module, work, name, {}, target, with_data)


def _study(
    name: str, kind: type[Config], changes: Mapping[Preset, Table], work: str = "STUDY"
) -> Job:
    module = f"experiments.studies.{name}"
    return Job(kind, module, f"{module}:{work}", f"study {name}", changes)


# Ten images of each street, as in the paper's presets, divide all numbers of images.
_TEN: Table = {"final": {"streets": 45, "shots": 10}}
_FCN8S: Table = {"final": {"train": {"net": "fcn8s"}}}

STUDIES: dict[str, Job] = {
    "table": _study("table", TableConfig, {
        "paper": {"nets": ("fcn8s", "deeplabv2"), "all_images": True},
    }),
    "labels": _study("labels", LabelsConfig, {"smoke": {"counts": (0, 2, 4)}}),
    "pretrain": _study("pretrain", PretrainConfig, {
        "smoke": {"fractions": (0.25, 1.0)},
        "paper": {"reward_images": None, "search_images": 500, **_FCN8S},
    }),
    "ablation": _study("ablation", AblationConfig, {
        # One of each kind, since compiling each variant's search takes most of the time.
        "smoke": {
            "evaluations": 4,
            "variants": ("full", "no_relaxation", "shuffled_groups", "no_positions"),
        },
        # With eight, methods that go group by group leave no rewards over.
        "quick": {"search": {"datasets_per_update": 8, "method": "intervals"}, "seeds": 3},
        "paper": {"evaluations": 300},  # the budget of its six groups, 50 updates each
    }),
    "assets": _study("assets", AssetsConfig, {
        "smoke": {"images": (2, 4)},
        "quick": {**_TEN, "seeds": 3},
        "paper": {**_TEN, "attributes": "learnt"},
    }),
    "searches": _study("searches", ManyConfig, {
        "smoke": {"searches": 2, "methods": ("intervals", "random_search")},
        "quick": {"seeds": 3},
        "paper": {"searches": 1, "methods": ("sdr",)},
    }),
    "sensitivity": _study("sensitivity", SensitivityConfig, {
        "smoke": {"evaluations": 12}, "quick": {"evaluations": 128}, "paper": {"evaluations": 300},
    }, "analyse"),
    "fidelity": _study("fidelity", FidelityConfig, {
        "smoke": {"proposals": 3, "repeated": 2, "repeats": 2},
    }, "measure"),
}  # fmt: skip
"""The studies of the paper, `sdr-jax study NAME`, in the order of the help."""

JOBS: dict[str, Job] = {
    "cityscapes": _main("cityscapes", "twin", "cityscapes"),
    "camvid": _main("camvid", "camvid"),
    "labelmefacade": _main("labelmefacade", "labelmefacade"),
    **STUDIES,
}
"""All commands with the flags of a configuration."""


def defaults_of(name: str, target: TargetName, preset: Preset) -> Any:
    """Make the defaults of a job for a target and a preset."""
    job = JOBS[name]
    return presets.defaults(job.kind, target, preset, **job.changes.get(preset, {}))
