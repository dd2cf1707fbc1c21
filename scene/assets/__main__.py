"""Print the catalogue of assets by class and family, or the assets that look most alike.

sdr-jax catalogue                    # class, family, count, kinds
sdr-jax catalogue --json             # {class: count} of all 19 classes
sdr-jax catalogue --closest car      # the pairs of cars that look most alike
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator

from common.command import Arguments, exit_code
from common.errors import flagged
from scene import parsers
from scene.assets.catalogue import asset, families_of, kind, surfaces, train_id
from scene.assets.families import FAMILIES
from scene.assets.likeness import closest, describe
from scene.classes import CLASS_NAMES, TrainId


def counts() -> dict[str, int]:
    """Count the assets of the full catalogue by class, in the order of the train ids."""
    total = {name: len(rows) for name, rows in surfaces().items()}
    for family, row in FAMILIES.items():
        for index in range(row.count):
            name = CLASS_NAMES[train_id(family, index)]
            total[name] = total.get(name, 0) + 1
    return {name: total[name] for name in CLASS_NAMES}


def table() -> Iterator[str]:
    """Yield the lines of the printed catalogue."""
    yield f"{'class':14s} {'family':14s} {'count':>5s}  kinds"
    for number in TrainId:
        name = CLASS_NAMES[number]
        if name in surfaces():
            rows = surfaces()[name]
            yield f"{name:14s} {'-':14s} {len(rows):5d}  {', '.join(rows)}"
        for family, row in FAMILIES.items():
            if row.train_id == number:
                yield f"{name:14s} {family:14s} {row.count:5d}  {', '.join(row.kinds)}"
    yield f"{'all':14s} {'':14s} {sum(counts().values()):5d}"


def nearest(name: str, pairs: int) -> Iterator[str]:
    """Yield lines on the pairs of a class or family that look most alike."""
    with flagged("--closest"):
        keys = [(f, index) for f in families_of(name) for index in range(FAMILIES[f].count)]
    yield f"{name}: {len(keys)} assets; copies are 0.000 apart, others of another shape and colour 1 to 2"
    for apart, *pair in closest([describe(asset(*key)) for key in keys], pairs):
        first, second = (
            f"{family} {k} ({kind(family, k)})" for family, k in (keys[i] for i in pair)
        )
        yield f"{apart:.3f} {first} - {second}"


def main(arguments: Arguments = None) -> int:
    """Run the command line and return the exit code."""
    options = parsers.catalogue().parse_args(arguments)
    names = FAMILIES if options.closest == "all" else (options.closest,)

    def report() -> None:
        if options.pairs < 1:
            raise ValueError(f"--pairs must be 1 or more, not {options.pairs}")
        if options.json:
            print(json.dumps(counts(), indent=2))
            return
        blocks = [nearest(name, options.pairs) for name in names] if options.closest else [table()]
        for lines in blocks:
            print("\n".join(lines))

    return exit_code(report, users=(ValueError,), debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
