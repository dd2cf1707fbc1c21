"""The keys of all JSON files that commands write, beside those that were recorded.

    python -m tests.guard_files        # run the commands at preset smoke, and record their keys anew

A test that has run a command calls `as_recorded` with its folder. Keys are nested. The items of a list count
as one; so do the lines of a file, files whose names differ in numbers only, and the keys of a map that are
names of attributes or classes.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from scene.attributes import names
from seg.classes import class_table

RECORD = Path(__file__).with_suffix(".json")
RECORDING = "GUARD_RECORD"
"""The variable of the environment with which `as_recorded` records."""
TESTS = (
    "tests/experiments/test_commands.py",
    "tests/experiments/test_guard_searches.py",
    "tests/experiments/test_main_job.py::test_the_run_folder_is_complete",
)
TABLES = map(class_table, ("cityscapes", "camvid", "labelmefacade"))
NAMES = {*names("extended")}.union(*(table.classes for table in TABLES))
"""A map whose keys are all of these is one by attribute or by class."""
FREE = ("over_classes",)
"""Maps by number of classes, by their own key."""


def keys_of(value: Any, path: str = "") -> set[str]:
    """The paths of all plain values in a JSON value: ``rows[].mean``, and ``*`` for any key of a free map."""
    if isinstance(value, list):
        return set().union({path}, *(keys_of(own, f"{path}[]") for own in value)) - {f"{path}[]"}
    if not isinstance(value, dict) or not value:
        return {path}
    free = NAMES.issuperset(value) or re.split(r"[.\[]", path)[-1] in FREE
    return set().union(
        *(keys_of(own, f"{path}.{'*' if free else key}".lstrip(".")) for key, own in value.items())
    )


def written(folder: Path) -> dict[str, set[str]]:
    """The keys of all files of JSON, and of JSON lines, below a folder, by name with # for a number.

    The arrays that worker processes share are no business of anybody else.
    """
    found: dict[str, set[str]] = {}
    for path in sorted([*folder.rglob("*.json"), *folder.rglob("*.jsonl")]):
        name = re.sub(r"\d+", "#", path.relative_to(folder).as_posix())
        if name.startswith("shared/"):
            continue
        texts = path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
        found[name] = found.get(name, set()).union(*(keys_of(json.loads(text)) for text in texts))
    return found


def as_recorded(command: str, folder: Path) -> None:
    """Fail where the files that a command wrote have other keys than were recorded, and say which."""
    new, record = written(folder), json.loads(RECORD.read_text())
    if os.environ.get(RECORDING):
        record[command] = {name: ", ".join(sorted(keys)) for name, keys in new.items()}
        RECORD.write_text(json.dumps(record, indent=0, sort_keys=True) + "\n")
        return
    ours, theirs = (
        {f"{name}: {key}" for name, keys in files.items() for key in keys}
        for files in (new, {name: text.split(", ") for name, text in record[command].items()})
    )
    assert ours == theirs, f"gone: {sorted(theirs - ours)}, new: {sorted(ours - theirs)}"


def main() -> int:
    """Run the tests that run commands, so that they record."""
    RECORD.write_text("{}\n")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", *TESTS]
    return subprocess.run(command, env={**os.environ, RECORDING: "1"}).returncode


if __name__ == "__main__":
    sys.exit(main())
