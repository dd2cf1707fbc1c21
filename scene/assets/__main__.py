"""The catalogue: how many assets there are, and which of them look most alike.

python -m scene.assets                     # class, family, count, kinds
python -m scene.assets --json              # {class: count} of all 19 classes
python -m scene.assets --closest car       # the pairs of cars that look most alike
python -m scene.assets --redraw            # write scene/redrawn.py anew, after a generator has changed
"""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import scene.assets.redrawn
from scene.assets.catalogue import COUNTS, FAMILIES, asset, draw, families_of, kind, surfaces
from scene.assets.signature import LOOK_ALIKE, Signature, closest, distances, signature
from scene.classes import CLASS_NAMES, TrainId

MOST_REDRAWS = 50
"""A kind that gives nothing new in so many draws is too poor."""
SPARE = 1.05
"""Redrawn assets keep this factor away from ``LOOK_ALIKE``, whatever a machine rounds."""
REDRAWN_HEAD = '''"""Assets whose first draw came out like an earlier one: family -> index -> redraws.

Written by ``python -m scene.assets --redraw``.
"""
'''


def counts() -> dict[str, int]:
    """Assets of the full catalogue by class, in the order of the train ids."""
    total = {name: len(rows) for name, rows in surfaces().items()}
    for family, row in FAMILIES.items():
        name = CLASS_NAMES[row.train_id]
        total[name] = total.get(name, 0) + COUNTS[family]
    return {name: total[name] for name in CLASS_NAMES}


def table() -> Iterator[str]:
    """Lines of the printed catalogue."""
    yield f"{'class':14s} {'family':14s} {'count':>5s}  kinds"
    for train_id in TrainId:
        name = CLASS_NAMES[train_id]
        if name in surfaces():
            rows = surfaces()[name]
            yield f"{name:14s} {'-':14s} {len(rows):5d}  {', '.join(rows)}"
        for family, row in FAMILIES.items():
            if row.train_id == train_id:
                yield f"{name:14s} {family:14s} {COUNTS[family]:5d}  {', '.join(row.kinds)}"
    yield f"{'all':14s} {'':14s} {sum(counts().values()):5d}"


def nearest(name: str, pairs: int) -> Iterator[str]:
    """Lines on the pairs of one class (or family) that look most alike."""
    keys = [(family, index) for family in families_of(name) for index in range(COUNTS[family])]
    found = closest([signature(asset(*key)) for key in keys], len(keys) ** 2)
    alike = sum(apart < LOOK_ALIKE for apart, _, _ in found)
    yield f"{name}: {len(keys)} assets, {alike} pairs look the same (nearer than {LOOK_ALIKE})"
    for apart, one, other in found[:pairs]:
        labels = [f"{family} {index} ({kind(family, index)})" for family, index in
                  (keys[one], keys[other])]  # fmt: skip
        yield f"{apart:.3f} {'!' if apart < LOOK_ALIKE else ' '} {labels[0]} - {labels[1]}"


def redrawn(families: tuple[str, ...]) -> dict[str, dict[int, int]]:
    """How often each asset must be drawn again until it looks like none before it in its class."""
    table: dict[str, dict[int, int]] = {}
    before: list[Signature] = []
    for family in families:
        for index in range(COUNTS[family]):
            for redraws in range(MOST_REDRAWS):
                mine = signature(draw(family, index, redraws))
                if not before or distances([mine], before).min() >= SPARE * LOOK_ALIKE:
                    break
            else:
                raise ValueError(f"{family} {index} ({kind(family, index)}) has {MOST_REDRAWS} times"
                                 " come out like an earlier one: its kind varies too little")  # fmt: skip
            before.append(mine)
            if redraws:
                table.setdefault(family, {})[index] = redraws
    return table


def write_redrawn(path: Path) -> None:
    """Write the module that ``catalogue`` reads."""
    table: dict[str, dict[int, int]] = {}
    for name in CLASS_NAMES:
        families = tuple(f for f, row in FAMILIES.items() if CLASS_NAMES[row.train_id] == name)
        table.update(redrawn(families))
    lines = [REDRAWN_HEAD, "REDRAWN: dict[str, dict[int, int]] = {"]
    for family, rows in table.items():
        pairs = ", ".join(f"{index}:_{redraws}" for index, redraws in rows.items())
        wrapped = textwrap.wrap(pairs, 90, initial_indent=" " * 8, subsequent_indent=" " * 8)
        lines += [f'    "{family}": {{', *(line.replace("_", " ") for line in wrapped), "    },"]
    path.write_text("\n".join([*lines, "}  # fmt: skip", ""]), encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m scene.assets",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--json", action="store_true", help="print {class: count}")
    what.add_argument("--closest", metavar="CLASS", help="class or family; 'all' for every one")
    parser.add_argument("--pairs", type=int, default=10, help="pairs to print with --closest")
    what.add_argument("--redraw", action="store_true", help="write scene/redrawn.py")
    options = parser.parse_args(arguments)
    if options.redraw:
        try:
            write_redrawn(Path(scene.assets.redrawn.__file__))
        except ValueError as error:
            parser.error(str(error))
    elif options.json:
        print(json.dumps(counts(), indent=2))
    elif options.closest:
        try:
            for name in FAMILIES if options.closest == "all" else (options.closest,):
                for line in nearest(name, options.pairs):
                    print(line)
        except ValueError as error:
            parser.error(str(error))
    else:
        for line in table():
            print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
