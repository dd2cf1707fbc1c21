"""What a few labelled images are worth, alone and beside renders: how many labels do renders replace?

    python -m experiments.labels --target camvid --data DIR --holdout 0006R0
    python -m experiments.labels --target camvid --data DIR --learnt a.json --counts 0 14 266
    python -m experiments.labels --target twin --preset smoke                  # under a minute
    python -m experiments.labels --rederive runs/a/labels.json --out runs/b    # no net at all

Nets are trained on 0, 7, 14, ... labelled images (a seeded choice, spread over sequences and time), on these
beside renders, and scored on the test images. Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.labels.job import STUDY, defaults
    from experiments.study.skeleton import do

    sys.exit(main("labels", defaults, partial(do, STUDY), __doc__))
