"""The paper's table 2: what nets trained on one set after another are worth on the target's test images.

    python -m experiments.table --target camvid --data DIR --holdout 0006R0
    python -m experiments.table --target camvid --data DIR --gta5 DIR --synthia DIR --nets compact fcn8s
    python -m experiments.table --target twin --preset smoke                     # under a minute
    python -m experiments.table --rederive runs/a/table.json --out runs/b        # no net at all

Training sets are SceneX with random attributes, with the street set by eye and with learnt attributes,
data sets of others, and the reward images themselves. Attributes are learnt first, unless
--learnt names what an earlier run has learnt; with its --store, that run's nets are not trained again.
Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.study.skeleton import do
    from experiments.table.job import STUDY, defaults

    sys.exit(main("table", defaults, partial(do, STUDY), __doc__))
