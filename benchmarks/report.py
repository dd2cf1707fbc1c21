"""The output of every benchmark: machine, versions, and rows of numbers and text."""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from common.files import versions
from common.files import write as write_file
from common.labels.target_file import SHIPPED
from common.workers.pool import cores
from experiments.tables.stats import paired_gain

Row = dict[str, Any]
PACKAGES = ("sdr-jax", "jax", "flax", "optax", "numpy", "trimesh", "embreex", "pyrender")
Done = TypeVar("Done")


def parser(description: str | None) -> argparse.ArgumentParser:
    """Make a command line with ``--json``."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=new_file, help="also write machine, versions and rows here")
    return parser


def target_parser(
    description: str | None,
    name: str,
    defaults: Mapping[str, Any],
    *,
    holdout: str,
    seeds: int,
    counts: Sequence[tuple[str, int, str]] = (),
) -> argparse.ArgumentParser:
    """Make the command line of a benchmark whose networks are tested on labelled images of a target.

    Args:
        description: the module's docstring.
        name: name of the module.
        defaults: defaults of the recipe.
        holdout: what happens to the images that ``--holdout`` names.
        seeds: networks of each row.
        counts: further options for whole numbers, their least values and meanings.
    """
    command = parser(description)
    command.prog = f"python -m benchmarks.{name}"
    add = command.add_argument
    add("--data", required=True, help="folder of labelled images")
    add("--target", help=f"{', '.join(SHIPPED)}, or a target's file; by default the folder's")
    add("--holdout", help=f"a group of images that is {holdout}, such as 0006R0")
    add("--out", type=Path, default=Path("runs", name), help="folder of finished networks")
    for option, least, meaning in (
        ("width", 32, "width in pixels, of renders and real images"),
        ("height", 32, "height in pixels"),
        ("streets", 1, "streets of each training set"),
        ("steps", 1, "training steps of a network"),
        *counts,
    ):
        default = defaults[option]
        help = f"{meaning} ({'the recipe has them' if default is None else default})"
        add(f"--{option}", type=partial(count, least), default=default, help=help)
    add("--seeds", type=partial(count, 1), default=seeds, help=f"networks of each row ({seeds})")
    workers = "processes, one core each; 0 uses this one (2)"
    add("--workers", type=partial(count, 0), default=2, help=workers)
    return command


def new_file(text: str) -> Path:
    """Read the path of a new file, and check it before the work starts."""
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text} must be a file in an existing folder")
    return path


def count(least: int, text: str) -> int:
    """Read a whole number of at least ``least``, for ``argparse``."""
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(
            f"must be a whole number of at least {least}, not {text!r}"
        )
    return int(text)


def gain_text(ours: Sequence[float], theirs: Sequence[float]) -> str:
    """Write the mean gain of paired repeats with its 95 % interval, such as ``+1.20 (-0.31 to +2.71)``."""
    gain, ci95 = paired_gain(ours, theirs)
    return f"{gain:+.2f}" + ("" if ci95 is None else f" ({ci95[0]:+.2f} to {ci95[1]:+.2f})")


def timed(work: Callable[[], Done]) -> tuple[float, Done]:
    """Measure the wall-clock seconds of some work, and return its result."""
    started = time.perf_counter()
    done = work()
    return time.perf_counter() - started, done


def machine() -> dict[str, Any]:
    """Describe the machine: its processor, and the number of cores that this process may use."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    return {"processor": name, "cores": cores(), "system": platform.system()}


def report(rows: list[Row], path: Path | None) -> None:
    """Print the rows as a table; with ``path``, write all as JSON there."""
    print(table(rows))
    write(path, rows=rows)


def table(rows: list[Row]) -> str:
    """Format rows as a Markdown table with aligned columns; the columns are those of the first row."""
    columns = list(rows[0])
    cells = [[_text(row[c]) for c in columns] for row in rows]
    widths = [max(len(c), *(len(r[i]) for r in cells)) for i, c in enumerate(columns)]
    lines = [columns, ["-" * width for width in widths], *cells]
    return "\n".join(
        "| " + " | ".join(t.ljust(w) for t, w in zip(line, widths, strict=True)) + " |"
        for line in lines
    )


def write(path: Path | None, **values: Any) -> None:
    """Write machine, versions and ``values`` as one JSON object; None writes nothing."""
    if path is not None:
        value = {"machine": machine(), "versions": versions(PACKAGES), **values}
        write_file(path, json.dumps(value, indent=2) + "\n")


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
