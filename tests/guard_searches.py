"""Three searches as they were recorded, to be replayed: the same rewards must end in the same answers.

One job on the twin holds the paper's search, the default and random search, and the nets of each answer.
`record` reduces its folder to what a replay needs: the seed of every net, a number that stands for its
streets, its reward; the actions and the answer of every search.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

RECORD = Path(__file__).with_suffix(".json")
METHODS = ("sdr", "intervals", "random_search")
FLAGS = (
    "--target", "twin", "--preset", "smoke", "--workers", "0", "--methods", *METHODS, "--searches", "1",
    "--search.updates-per-group", "4", "--search.datasets-per-update", "2", "--search.relaxation", "0.3",
)  # fmt: skip
"""Of `sdr-jax study searches`: 48 rewards each."""


def mark(centre: Any, width: Any) -> float | None:
    """One number that tells intervals apart: a sum with a weight of its own for each; None without any."""
    if centre is None:
        return None
    values = np.concatenate([np.asarray(part, float) for part in (centre, width)])
    return round(float(np.sqrt(np.arange(1, len(values) + 1)) @ values), 5)


def lines(path: Path) -> list[dict[str, Any]]:
    """The records of a file of JSON lines."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def summed_up(folder: Path) -> dict[str, list[Any]]:
    """What the folder of the job holds: rewards, other nets and answers, a line each."""
    asked, nets = lines(folder / "evaluations.jsonl"), lines(folder / "finals.jsonl")

    def scored(line: dict[str, Any]) -> list[Any]:
        return [line["seed"], mark(line["centre"], line["width"]), line["reward"]]

    places = ("search", "update", "dataset", "actions")
    return {
        "rewards": sorted([*(line[name] for name in places), *scored(line)] for line in asked),
        "nets": sorted([line["nets"], line["row"], *scored(line)] for line in nets),
        "answers": [
            [
                name := f"{own['method']}-{own['seed']}",
                *_intervals(folder / "attributes" / f"{name}.json"),
            ]
            for own in json.loads((folder / "searches.json").read_text())["searches"]
        ],
    }


def _intervals(path: Path) -> list[list[float]]:
    """Centres and widths of the one component of an answer."""
    (component,) = json.loads(path.read_text())["components"]
    units = [row["unit"] for row in component["attributes"].values()]
    return [[unit[part] for unit in units] for part in ("centre", "width")]


def record() -> None:
    """Do the job with real nets, and write what a replay needs."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "experiments.studies.searches", *FLAGS, "--out", folder]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        found = summed_up(Path(folder))
    parts = []
    for name, own in found.items():
        rows = [json.dumps(each, separators=(",", ":")) for each in own]
        parts.append(f'"{name}": [\n' + ",\n".join(rows) + "\n]")
    RECORD.write_text("{\n" + ",\n".join(parts) + "\n}\n")
