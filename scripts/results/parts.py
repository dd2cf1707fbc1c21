"""The parts of the results, each of them a command, in the order in which they are made."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from experiments.config.config import TargetName
from scene.attributes import NAMES

HOLDOUT = "0006R0"
"""The held-out sequence of CamVid."""
SHOWN = {"--data": "DIR", "--learnt": "FILE", "--groups": "ALL"}
"""Flags of commands whose value is shown as a word."""


class Part(NamedTuple):
    """One command."""

    name: str  # of its folder
    section: str  # of the page
    study: str  # also the name of its files
    flags: tuple[str, ...]

    @property
    def command(self) -> tuple[str, ...]:
        """The command without its output folder."""
        return ("python", "-m", f"experiments.studies.{self.study}", *self.flags)

    @property
    def shown(self) -> str:
        """The command to show, without paths and long lists."""
        words = ["sdr-jax", "study", self.study, *self.flags]
        for flag, word in SHOWN.items():
            if flag in words:
                words[words.index(flag) + 1] = word
        return shlex.join(words)


class Data(NamedTuple):
    """Folders of real data; parts without their data are left out."""

    camvid: Path | None = None
    labelmefacade: Path | None = None

    def flags(self, target: TargetName) -> tuple[str, ...] | None:
        """Make the flags of a target; None without its data."""
        if target == "twin":
            return ("--target", target)
        folder = self.camvid if target == "camvid" else self.labelmefacade
        return None if folder is None else ("--target", target, "--data", str(folder))


class Real(NamedTuple):
    """Real images to test on."""

    name: str
    target: TargetName
    labels: int  # images to train on
    flags: tuple[str, ...] = ()


REAL = (
    Real(f"camvid-{HOLDOUT}", "camvid", 266, ("--holdout", HOLDOUT)),
    Real("labelmefacade", "labelmefacade", 100),
    Real("camvid", "camvid", 367),
)
FAR_TWINS = 5
COUNTS = ("7", "14", "27", "67")
"""Numbers of labelled images, apart from none and all."""
LARGE = ("--final.width", "480", "--final.height", "360")
MINUTES = "15"
"""Core-minutes of a search by the default method."""
METHODS = ("sdr", "random_search", "attribute_descent")
"""The paper's search, and the two with which it is compared at its own number of rewards."""
GROUPS, UPDATES = 6, 50
"""The paper's groups of attributes, and its updates of each; an update takes one reward."""

Size = Literal["smoke", "quick"]


def parts(data: Data, out: Path, preset: Size) -> list[Part]:
    """Make every part for which there is data; those on which most claims rest come first.

    Args:
        data: folders of real data.
        out: folder of all runs; some parts use the attributes that another has optimised.
        preset: preset of all commands.
    """
    quick = preset == "quick"  # the smoke preset is small already

    def study(name: str, section: str, kind: str, target: TargetName, *flags: str) -> list[Part]:
        where = data.flags(target)
        if where is None:
            return []
        return [Part(name, section, kind, (*where, "--preset", preset, *flags))]

    def if_quick(*flags: str) -> tuple[str, ...]:
        return flags if quick else ()

    wide = ("--space", "extended")
    five = if_quick("--seeds", "5")
    as_fit = if_quick("--final.train.heads", "3", *LARGE)
    ours = ("--methods", "intervals", "--core-minutes", MINUTES if quick else "0.1")
    one, three = ("--searches", "1"), ("--searches", "3" if quick else "2")
    five_searches = ("--searches", "5") if quick else one

    def labels(prefix: str, real: Real, counts: tuple[str, ...], *flags: str) -> list[Part]:
        """Labels alone and plus renders, with the networks of `fit`."""
        every = if_quick("--counts", *counts, str(real.labels))
        return study(
            f"{prefix}-{real.name}", "labels", "labels", real.target,
            *real.flags, *wide, *as_fit, *every, *flags,
        )  # fmt: skip

    def paper(name: str, *flags: str, updates: int = UPDATES) -> list[Part]:
        """The paper's space, groups and updates, on its training and test images."""
        schedule = ("--search.updates-per-group", str(updates), "--search.datasets-per-update", "1")
        return study(
            name, "paper", "searches", "camvid",
            *flags, *if_quick(*schedule), *if_quick(*LARGE), *five,
        )  # fmt: skip

    def all_parts() -> Iterator[list[Part]]:
        for real in REAL:
            yield labels("fit", real, ("0", "14"), "--renders", "mixed")
        for real in REAL:
            flags = (*real.flags, *wide, *ours, *five_searches, *if_quick(*LARGE), *five)
            yield study(real.name, "streets", "searches", real.target, *flags)
        for seed in map(str, range(FAR_TWINS)):
            flags = ("--twin", "far", "--twin-seed", seed, *wide, "--methods", "intervals")
            yield study(f"far-{seed}", "streets", "searches", "twin", *flags, *one, *five)
        tiled = ("--search.relaxation", "0.1")
        for method in METHODS:
            yield paper(f"paper-{method}", "--methods", method, *three, *tiled)
        for real in REAL[:2]:
            optimised = ("--learnt", str(out / real.name / "attributes" / "intervals-0.json"))
            rendered = ("--renders", "random", "default", "mixed", "learnt", *optimised)
            yield labels("kinds", real, ("0", "14"), *rendered)
            yield labels("labels", real, ("0", *COUNTS), "--renders", "mixed")
        sdr = ("--methods", "sdr")
        yield paper("paper-no-relaxation", *sdr, *three, "--search.relaxation", "0")
        in_one = ("--groups", ",".join(NAMES))
        yield paper("paper-no-groups", *sdr, *three, *tiled, *in_one, updates=GROUPS * UPDATES)
        yield paper("paper-squared-reward", *sdr, *three, *tiled, "--search.squared-reward")
        yield paper("paper-3000-rewards", *sdr, *one, *tiled, updates=10 * UPDATES)
        for real in REAL[:2]:
            flags, few = (*real.flags, *wide, *ours, *one), "14" if quick else "2"
            failed = "failed", "searches", real.target
            yield study(f"few-{few}-{real.name}", *failed, *flags, "--few", few)
        real = REAL[0]
        flags = (*real.flags, *wide, *five)
        yield study(
            f"small-{real.name}", "failed", "searches", real.target,
            *flags, *ours, *five_searches,
        )  # fmt: skip
        at_size = if_quick("--reward.width", "480", "--reward.height", "360", *LARGE)
        longer = ("--methods", "intervals", "--core-minutes", "60" if quick else "0.1", *one)
        yield study(
            f"large-rewards-{real.name}", "failed", "searches", real.target,
            *flags, *longer, *at_size,
        )  # fmt: skip
        nets = ("--nets", "lite0", *if_quick("lite2"), *if_quick("--seeds", "3"))
        optimised = ("--learnt", str(out / real.name / "attributes" / "intervals-0.json"))
        yield study(
            f"table-{real.name}", "failed", "table", real.target,
            *real.flags, *wide, *optimised, *nets,
        )  # fmt: skip

    return [part for parts in all_parts() for part in parts]
