"""The parts of the results, each a command of its own."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

HOLDOUT, OTHER = "0006R0", "0001TP"
"""The sequence that is reported on, and another that stands in its place once."""


class Part(NamedTuple):
    """One command."""

    name: str  # of its folder
    title: str
    asks: str  # what it tells, in a sentence
    module: str
    flags: tuple[str, ...]

    @property
    def study(self) -> str:
        """Its files are called so."""
        return self.module.rpartition(".")[2]

    @property
    def command(self) -> tuple[str, ...]:
        """What is run, but for where it writes."""
        return ("python", "-m", self.module, *self.flags)

    @property
    def shown(self) -> str:
        """The command for people; where the data lie is theirs to know."""
        words = list(self.command)
        if "--data" in words:
            words[words.index("--data") + 1] = "DIR"
        return shlex.join(words)


NAMES = (
    "searches", f"labels-{HOLDOUT}", f"labels-{OTHER}", "table", "pretrain", "ablation", "assets",
    "compare", "fidelity", "sensitivity", "twins",
)  # fmt: skip
"""Of all parts."""


def parts(data: Path, out: Path, preset: str, searches: int) -> list[Part]:
    """Every part, in the order of the page.

    Args:
        data: CamVid.
        out: folder of all runs; where a part wants learnt attributes, they are those of its first search.
        preset: of all commands.
        searches: of each method, and twins.
    """
    size = ("--preset", preset)
    extended = (*size, "--space", "extended")
    camvid = ("--target", "camvid", "--data", str(data), "--holdout")
    learnt = ("--learnt", str(out / "searches/attributes/intervals-0.json"))

    def study(name: str, module: str, title: str, asks: str, *flags: str) -> Part:
        return Part(name, title, asks, f"experiments.{module}", flags)

    # The smoke preset's four are too few for sdr's groups.
    fewest = ("--evaluations", "12") if preset == "smoke" else ()
    curve = "What labelled images are worth alone and beside renders"
    renders = ("--renders", "random", "default", "learnt")
    return [
        study(
            "searches", "searches", "Learnt attributes",
            f"What nets gain that are trained on learnt attributes, on a drive ({HOLDOUT}) that neither the "
            "search nor anybody else has seen.",
            *camvid, HOLDOUT, *extended, "--searches", str(searches),
        ),
        study(
            f"labels-{HOLDOUT}", "labels", "Labels and renders", f"{curve}.",
            *camvid, HOLDOUT, *extended, *renders, *learnt,
        ),
        study(
            f"labels-{OTHER}", "labels", f"Labels and renders, {OTHER} left out",
            f"{curve}, scored on another drive; a search of its own has not seen it.",
            *camvid, OTHER, *extended, *renders,
        ),
        study(
            "table", "table", "Training sets beside each other", "The paper's table 2, for several nets.",
            *camvid, HOLDOUT, *extended, *learnt, "--nets", "lite0", "compact",
        ),
        study(
            "pretrain", "pretrain", "Pre-training",
            "The paper's table 3: nets trained on renders, then on a part of the labelled images; the "
            "search for attributes has seen that part alone.",
            *camvid, HOLDOUT, *extended, "--learn-on", "share",
            "--rows", "scratch", "random", "learnt", "longer",
        ),
        study(
            "ablation", "ablation", "Ablation", "What each part of the method is worth.",
            *camvid, HOLDOUT, *size,
        ),
        study(
            "assets", "assets", "Assets and images", "What more assets and more images are worth.",
            *camvid, HOLDOUT, *size,
        ),
        study(
            "compare", "compare", "Search methods on all 23 attributes",
            "Every method with the same number of rewards.",
            *camvid, HOLDOUT, *size, "--subsets", "all", *fewest,
        ),
        study(
            "fidelity", "fidelity", "How good is the reward?",
            "Its signal, its noise, and whether it ranks as the final nets do.",
            *camvid, HOLDOUT, *size,
        ),
        study(
            "sensitivity", "sensitivity", "Which attributes matter",
            "A model of the rewards of all searches above.",
            "--target", "camvid", *extended,
            "--records", str(out / "searches/evaluations.jsonl"),
        ),
        study(
            "twins", "searches", "The twin (not real data)",
            "The same on a target that our own engine renders with hidden attributes.",
            "--target", "twin", *size, "--methods", "intervals", "--searches", str(searches),
        ),
    ]  # fmt: skip
