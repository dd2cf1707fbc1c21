"""Several searches of several methods with equal rewards, each as the main job's, in one table.

    python -m experiments.searches --target camvid --data DIR --holdout 0006R0 --space extended
    python -m experiments.searches --target camvid --data DIR --methods intervals --searches 3
    python -m experiments.searches --target twin --preset smoke                   # about a minute
    python -m experiments.searches --rederive runs/a/searches.json --out runs/b   # no net at all

The k-th search of every method has the seed --seed + k and is what the main job with that seed and method
does: with its --store, nothing is scored twice. Final nets of all answers, of random attributes, of the
street set by eye and of the reward images share their seeds, and intervals are over searches and nets.
Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.searches.job import STUDY, defaults
    from experiments.study.skeleton import do

    sys.exit(main("searches", defaults, partial(do, STUDY), __doc__))
