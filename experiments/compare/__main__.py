"""Compare search methods on real rewards, at equal numbers of evaluations.

    python -m experiments.compare --target camvid --data DIR --holdout 0006R0     # the paper's figure
    python -m experiments.compare --target twin --preset smoke                    # seconds
    python -m experiments.compare --methods sdr cma_es --subsets all --no-finals  # only record rewards
    python -m experiments.compare --rederive runs/a/compare.json --out runs/b     # no net at all

With 3, 5 and 7 positions optimised and all else random, every method finds attributes; nets trained on
them are scored on the test images. Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from functools import partial

    from experiments.cli import main
    from experiments.compare.job import STUDY, defaults
    from experiments.study.skeleton import do

    sys.exit(main("compare", defaults, partial(do, STUDY), __doc__))
