"""Show and merge stores: files of evaluations that runs share, so that none is repeated.

    sdr-jax store show FILE
    sdr-jax store merge A.jsonl B.jsonl runs/c --out C.jsonl

Two evaluations are the same if they agree in sizes, network, training, classes, renderer, assets, real
images, engine version, JAX backend, library versions, proposal and seed. A store has one JSON object per
line, after a first line that names the attributes. Several runs may write to it at once, and a half-written
last line is dropped. In place of a file you can pass a run folder, which records its evaluations in the
same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.command import Arguments, exit_code, say
from common.errors import UserError, counted
from common.files import check_file
from experiments.config import parsers
from experiments.evaluation.made_with import makers_in_words
from experiments.evaluation.store import kinds_of, merged, read, write_store


def merge(paths: Sequence[Path], out: Path) -> str:
    """Write all evaluations of several stores into a new one, and say how many there are.

    Args:
        paths: stores, or run folders.
        out: the new file.

    Raises:
        UserError: a file is missing or not a store, or two evaluations disagree; the message names both.
    """
    if out.exists():
        raise UserError(f"--out {out} exists already; choose a new file")
    check_file("--out", out)
    entries = merged(entry for path in paths for entry in read(path).values())
    records = [record for record, _ in entries.values()]
    write_store(out, records)
    return "\n".join(
        filter(None, (f"{out}: {counted(len(records), 'evaluation')}", makers_in_words(records)))
    )


def table(path: Path) -> str:
    """The contents of a store or a run folder, one line per configuration."""
    records = [record for record, _ in read(path).values()]
    lines = [f"{path}: {counted(len(records), 'evaluation')}"]
    for config, evaluations in kinds_of(records).items():
        first = evaluations[0]
        about = [str(first.get(name, "?")) for name in ("target", "side", "size", "images")]
        kind = f"{' '.join(about)} images"
        rewards = [line["reward"] for line in evaluations if line["reward"] is not None]
        best_and_mean = ""
        if rewards:
            best_and_mean = (
                f" | mIoU best {100 * max(rewards):.1f}, mean {100 * np.mean(rewards):.1f}"
            )
        count, failed = len(evaluations), len(evaluations) - len(rewards)
        made = f"{count:6d} evaluation{'s' * (count != 1)}"
        lines.append(f"  {config}  {kind:36s} {made}, {failed} failed{best_and_mean}")
    if differences := makers_in_words(records):
        lines.append(f"  {differences}")
    return "\n".join(lines)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.store().parse_args(arguments)

    def work() -> None:
        if (options.out is not None) != (options.command == "merge"):
            raise UserError(
                "merge needs --out FILE"
                if options.command == "merge"
                else "--out is only for merge; leave it out with show"
            )
        if options.command == "show":
            say("\n".join(table(path) for path in options.files))
        else:
            say(merge(options.files, options.out))

    return exit_code(work, debug=options.debug, resumes=False)
