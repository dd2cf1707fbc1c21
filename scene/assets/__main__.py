"""The catalogue: how many assets there are, and which of them look most alike.

python -m scene.assets                     # class, family, count, kinds
python -m scene.assets --json              # {class: count} of all 19 classes
python -m scene.assets --closest car       # the pairs of cars that look most alike
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator

from scene.catalogue import COUNTS, FAMILIES, asset, families_of, kind, surfaces
from scene.classes import CLASS_NAMES, TrainId
from scene.signature import LOOK_ALIKE, closest, signature


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
    options = parser.parse_args(arguments)
    if options.json:
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
