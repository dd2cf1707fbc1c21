"""The parts of the results, each of which is a command."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

HOLDOUT, OTHER = "0006R0", "0001TP"
"""The held-out sequence, and another one that replaces it once."""


class Part(NamedTuple):
    """One command."""

    name: str  # of its folder
    title: str
    asks: str  # its question in a sentence
    module: str
    flags: tuple[str, ...]

    @property
    def study(self) -> str:
        """The study, after which its files are named."""
        return self.module.rpartition(".")[2]

    @property
    def command(self) -> tuple[str, ...]:
        """The command without its output folder."""
        return ("python", "-m", self.module, *self.flags)

    @property
    def shown(self) -> str:
        """The command for people, without the paths of data and weights."""
        words = ["sdr-jax", "study", self.study, *self.flags]
        for flag, word in (("--data", "DIR"), ("--weights", "FILE")):
            if flag in words:
                words[words.index(flag) + 1] = word
        return shlex.join(words)


SEARCH = (
    "--search.updates-per-group",
    "5",
    "--search.datasets-per-update",
    "2",
)
"""Flags of every search: 90 rewards instead of the preset's 288."""
LARGE = (
    "--final.width", "480", "--final.height", "360", "--final.streets", "100", "--final.shots", "4",
    "--final.samples", "2",
)  # fmt: skip
"""Flags of final nets; in studies that compare searches, nets have the size of rewards, as in the preset."""

METHODS = (
    "random_attributes", "random_search", "attribute_descent", "sdr", "surrogate", "intervals",
)  # fmt: skip
"""The compared methods."""
NAMES = (
    "searches", f"labels-{HOLDOUT}", f"labels-{OTHER}", "table", "pretrain", "ablation", "assets",
    "compare", "fidelity", "sensitivity", "twins",
)  # fmt: skip
"""Names of all parts."""


def parts(
    data: Path, out: Path, preset: str, searches: int, weights: Path | None = None
) -> list[Part]:
    """Make every part in the order of the page.

    Args:
        data: the folder of CamVid.
        out: folder of all runs; parts take learnt attributes from the first search in it.
        preset: preset of all commands.
        searches: number of searches of each method, and of twins.
        weights: VGG16's weights, which add FCN8s and DeepLabv2 to the table.
    """
    size = ("--preset", preset)
    extended = (*size, "--space", "extended")
    camvid = ("--target", "camvid", "--data", str(data), "--holdout")
    learnt = ("--learnt", str(out / "searches/attributes/intervals-0.json"))

    def study(name: str, module: str, title: str, asks: str, *flags: str) -> Part:
        return Part(name, title, asks, f"experiments.{module}", flags)

    # The plans take 18 hours on two cores; the smoke preset is small already.
    quick = preset == "quick"
    budget = SEARCH if quick else ()
    large = LARGE if quick else ()
    three = ("--seeds", "3") if quick else ()
    fractions = ("--fractions", "0.05", "0.25", "1") if quick else ()
    images = ("--images", "90", "180", "450", "900") if quick else ()
    # The smoke preset's four evaluations are too few for sdr's groups.
    evaluations = ("--evaluations", "48" if quick else "12")
    vgg = ("fcn8s", "deeplabv2", "--weights", str(weights)) if weights else ()
    nets = ("lite0", "compact", *vgg)
    curve = "What labelled images are worth alone and beside renders"
    renders = ("--renders", "random", "default", "learnt")
    return [
        study(
            "searches", "searches", "Learnt attributes",
            f"What nets gain that are trained on learnt attributes, on a drive ({HOLDOUT}) that neither the "
            "search nor anybody else has seen.",
            *camvid, HOLDOUT, *extended, *large, *budget, "--searches", str(searches),
        ),
        study(
            f"labels-{HOLDOUT}", "labels", "Labels and renders", f"{curve}.",
            *camvid, HOLDOUT, *extended, *large, *renders, *learnt,
        ),
        study(
            f"labels-{OTHER}", "labels", f"Labels and renders, {OTHER} left out",
            f"{curve}, scored on another drive; a search of its own has not seen it.",
            *camvid, OTHER, *extended, *large, *budget, *renders, *three,
        ),
        study(
            "table", "table", "Training sets beside each other", "The paper's table 2, for several nets.",
            *camvid, HOLDOUT, *extended, *large, *learnt, *three, "--nets", *nets,
        ),
        study(
            "pretrain", "pretrain", "Pre-training",
            "The paper's table 3: nets trained on renders, then on a part of the labelled images; the "
            "search for attributes has seen that part alone.",
            *camvid, HOLDOUT, *extended, *budget, *three,
            "--learn-on", "share", "--rows", "scratch", "random", "learnt", "longer", *fractions,
        ),
        study(
            "ablation", "ablation", "Ablation", "What each part of the method is worth.",
            *camvid, HOLDOUT, *size, *evaluations,
        ),
        study(
            "assets", "assets", "Assets and images", "What more assets and more images are worth.",
            *camvid, HOLDOUT, *size, *images,
        ),
        study(
            "compare", "compare", "Search methods on all 23 attributes",
            "Methods with the same number of rewards; intervals begins at the hand-set street, the others "
            "anywhere.",
            *camvid, HOLDOUT, *size, "--subsets", "all", *evaluations, "--methods", *METHODS,
        ),
        study(
            "fidelity", "fidelity", "How good is the reward?",
            "Its signal, its noise, and whether it ranks as larger nets do.",
            *camvid, HOLDOUT, *size, *large, "--rungs", "2",
        ),
        study(
            "sensitivity", "sensitivity", "Which attributes matter",
            "A model of the rewards of all searches above.",
            "--target", "camvid", *extended,
            "--records", str(out / "searches"),
        ),
        study(
            "twins", "searches", "The twin (not real data)",
            "The same on a target that our own engine renders with hidden attributes.",
            "--target", "twin", *size, "--methods", "intervals", "--searches", str(searches),
        ),
    ]  # fmt: skip
