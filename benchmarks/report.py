"""The output of every benchmark: the machine, the versions, and rows of plain values."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from shell.files import versions
from shell.files import write as write_file

Row = dict[str, Any]
PACKAGES = ("sdr-jax", "jax", "flax", "optax", "numpy", "trimesh", "embreex", "pyrender")
Done = TypeVar("Done")


def parser(description: str | None) -> argparse.ArgumentParser:
    """A command line with ``--json``."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=_new_file, help="also write machine, versions and rows here")
    return parser


def _new_file(text: str) -> Path:
    """A path that can be written; it is checked before the work begins."""
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"{text} is no place for a file: no such folder to put it in"
        )
    return path


def count(least: int, text: str) -> int:
    """A whole number of at least ``least``, for ``argparse``."""
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"must be a whole number from {least} on, not {text!r}")
    return int(text)


def timed(work: Callable[[], Done]) -> tuple[float, Done]:
    """The wall-clock seconds of some work, and its result."""
    started = time.perf_counter()
    done = work()
    return time.perf_counter() - started, done


def machine() -> dict[str, Any]:
    """The system's name of the processor, and the number of cores that this process may use."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"processor": name, "cores": cores, "system": platform.system()}


def report(rows: list[Row], path: Path | None) -> None:
    """Print the rows as a table; with ``path``, write all as JSON there."""
    print(table(rows))
    write(path, rows=rows)


def table(rows: list[Row]) -> str:
    """Rows as a Markdown table with aligned columns; the columns are those of the first row."""
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
