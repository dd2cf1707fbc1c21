"""The parts of the results, each of them a command, in the groups of the page."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from experiments.config.config import TargetName

HOLDOUT = "0006R0"
"""The held-out sequence of CamVid."""
METHOD = "intervals"
"""The method that optimises streets: the default of preset quick."""


class Group(NamedTuple):
    """Parts that answer one question."""

    title: str
    asks: str  # its question in a sentence
    summed: bool = False  # whether one table has a row per part, instead of a table per part
    averaged: bool = (
        False  # whether that table ends with means over parts of one kind, as far-0 and far-1
    )


GROUPS = {
    "main": Group(
        "Optimised streets",
        "What optimised streets add: on CamVid with its usual training and test images, on CamVid without "
        f"the sequence {HOLDOUT}, and on LabelMeFacade. Searches are by {METHOD} in the extended space, "
        "networks a segmentation head on a frozen lite0: only the split of the first is the paper's, so do "
        "not compare numbers.",
    ),
    "twins": Group(
        "Twins (not real data)",
        "The same on targets that our own engine renders with hidden attributes, far from the default "
        "street and near it.",
        summed=True,
        averaged=True,
    ),
    "labels": Group("Labels plus renders", "What renders add to a few labelled images."),
    "few": Group(
        "Searches with labels",
        "Do optimised streets add more to a labelled subset than random ones? Every training set is mixed "
        "with the subset, also in the search.",
        summed=True,
    ),
    "rivals": Group("Rivals", "Search methods at equal core-minutes."),
    "paper": Group(
        "The paper's tables",
        "Training sets, ablation, assets, pre-training and sensitivity, on a far twin and on CamVid: the "
        "paper's questions with our networks, searches and sizes.",
    ),
    "scale": Group("Scale", "What longer searches gain.", summed=True),
    "images": Group("More images", "What larger sets of optimised and of random streets gain."),
}
"""The sections of the page in their order."""


class Part(NamedTuple):
    """One command."""

    name: str  # of its folder
    group: str  # among `GROUPS`
    module: str
    flags: tuple[str, ...]

    @property
    def study(self) -> str:
        """The name of the study, and of its files."""
        return self.module.rpartition(".")[2]

    @property
    def command(self) -> tuple[str, ...]:
        """The command without its output folder."""
        return ("python", "-m", self.module, *self.flags)

    @property
    def shown(self) -> str:
        """The command to show, without the paths of data and weights."""
        words = ["sdr-jax", "study", self.study, *self.flags]
        for flag, word in (("--data", "DIR"), ("--weights", "FILE")):
            if flag in words:
                words[words.index(flag) + 1] = word
        return shlex.join(words)


class Data(NamedTuple):
    """Folders of real data; parts without their data are left out."""

    camvid: Path | None = None
    labelmefacade: Path | None = None
    weights: Path | None = None  # VGG16's, which add FCN8s and DeepLabv2 to the tables

    def flags(self, target: TargetName) -> tuple[str, ...] | None:
        """Make the flags of a target; None without its data."""
        if target == "twin":
            return ("--target", target)
        folder = self.camvid if target == "camvid" else self.labelmefacade
        return None if folder is None else ("--target", target, "--data", str(folder))


Size = Literal["smoke", "quick"]
LARGE = ("--final.width", "480", "--final.height", "360")
MINUTES, TWIN_MINUTES = "15", "6"
"""Core-minutes of each search, and of each rival on a twin."""
RIVALS = ("intervals", "surrogate", "sdr", "random_search", "tpe", "gaussian_process")
COUNTS = ("7", "14", "27", "67")
"""Numbers of labelled images with a search of their own."""
LENGTHS = ("5", "15", "45")
"""Core-minutes of shorter and longer searches."""


def parts(data: Data, out: Path, preset: Size, searches: int, twins: int) -> list[Part]:
    """Make every part for which there is data, in the order of the page.

    Args:
        data: folders of real data, and weights.
        out: folder of all runs; some parts use the attributes that another has optimised.
        preset: preset of all commands.
        searches: number of searches of each method.
        twins: number of twins of each kind.
    """
    quick = preset == "quick"  # the smoke preset is small already
    size = ("--preset", preset, "--space", "extended")
    learner = ("--methods", METHOD)
    one, many = ("--searches", "1"), ("--searches", str(searches))
    three = ("--seeds", "3") if quick else ()
    real: tuple[tuple[str, TargetName, tuple[str, ...]], ...] = (
        (f"camvid-{HOLDOUT}", "camvid", ("--holdout", HOLDOUT)),
        ("labelmefacade", "labelmefacade", ()),
    )

    def study(
        name: str, group: str, module: str, target: TargetName, *flags: str
    ) -> Iterator[Part]:
        where = data.flags(target)
        if where is not None:
            yield Part(name, group, f"experiments.studies.{module}", (*where, *size, *flags))

    def optimised(main: str) -> tuple[str, str]:
        return "--learnt", str(out / f"{main}/attributes/{METHOD}-0.json")

    def within(minutes: str) -> tuple[str, str]:
        return "--core-minutes", minutes if quick else "0.1"

    def all_parts() -> Iterator[Part]:
        brief = (*learner, *within(MINUTES))
        large = LARGE if quick else ()
        for name, target, flags in (("camvid", "camvid", ()), *real):
            yield from study(name, "main", "searches", target, *flags, *large, *brief, *many)
        for kind in ("far", "near"):
            for seed in map(str, range(twins)):
                flags = ("--twin", kind, "--twin-seed", seed, *learner, *one)
                yield from study(f"{kind}-{seed}", "twins", "searches", "twin", *flags)
        for name, target, flags in real:
            every = "266" if target == "camvid" else "100"
            counts = ("--counts", "0", *COUNTS, every) if quick else ()
            rows = ("--renders", "random", "default", "mixed", "learnt", *optimised(name))
            yield from study(f"labels-{name}", "labels", "labels", target, *flags, *counts, *rows)
        for name, target, flags in real:
            for count in COUNTS if quick else ("2",):
                few = (*flags, "--few", count, *brief, *one)
                yield from study(f"few-{count}-{name}", "few", "searches", target, *few)
        rivals = ("--methods", *(RIVALS if quick else (METHOD, "random_search")), *many)
        for name, target, flags, minutes in (
            ("labelmefacade", "labelmefacade", (), MINUTES),
            ("far", "twin", ("--twin", "far"), TWIN_MINUTES),
        ):
            equal = (*flags, *rivals, *within(minutes))
            yield from study(f"rivals-{name}", "rivals", "searches", target, *equal)
        yield from papers()
        for minutes in LENGTHS if quick else ():
            length = (*learner, *within(minutes), *one)
            yield from study(f"minutes-{minutes}", "scale", "searches", "labelmefacade", *length)
        images = ("--images", "100", "400", "1600", "6400") if quick else ()
        for name in ("random", "learnt"):
            sizes = (*images, "--final.shots", "1", "--fractions", "1", "--attributes", name)
            source = optimised("labelmefacade") if name == "learnt" else ()
            yield from study(
                f"images-{name}", "images", "assets", "labelmefacade", *sizes, *source, *three
            )

    def papers() -> Iterator[Part]:
        vgg = ("fcn8s", "deeplabv2", "--weights", str(data.weights)) if data.weights else ()
        nets = ("--nets", "lite0", *(("lite2",) if quick else ()), "compact", *vgg)
        fractions = ("--fractions", "0.05", "0.25", "1") if quick else ()
        starts = ("--rows", "scratch", "random", "learnt", "longer", *fractions)
        # The four evaluations of the smoke preset are too few for the groups of sdr.
        evaluations = ("--evaluations", "48" if quick else "20")
        images = ("--images", "90", "180", "450", "900") if quick else ()
        main, far = f"camvid-{HOLDOUT}", ("--twin", "far")
        for name, target, flags, source in (
            (main, "camvid", ("--holdout", HOLDOUT), optimised(main)),
            ("far", "twin", far, optimised("far-0")),
        ):
            for kind, more in (("table", (*source, *nets)), ("pretrain", (*source, *starts))):
                all_flags = (*flags, *more, *three)
                yield from study(f"{kind}-{name}", "paper", kind, target, *all_flags)  # type: ignore[arg-type]
        yield from study("ablation", "paper", "ablation", "twin", *far, *evaluations)
        yield from study("assets", "paper", "assets", "twin", *far, *images)
        records = ("--records", str(out / "rivals-labelmefacade"))
        yield from study("sensitivity", "paper", "sensitivity", "labelmefacade", *records)

    return list(all_parts())
