"""The paper's ablation: what the search loses without one of its parts.

    python -m experiments.ablation --target camvid --data DIR --holdout 0006R0
    python -m experiments.ablation --target camvid --data DIR --method sdr       # the paper's search
    python -m experiments.ablation --target twin --preset smoke                  # under a minute
    python -m experiments.ablation --rederive runs/a/ablation.json --out runs/b  # no net at all

Every variant is a search of its own with as many evaluations: without relaxation, with all attributes in
one group, with groups that pay no regard to correlation, and with environment, positions or densities
left random. Nets trained on what they found are scored on the test images, paired. Kill it at any moment;
the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from functools import partial

    from experiments.ablation.job import STUDY, defaults
    from experiments.cli import main
    from experiments.study.skeleton import do

    sys.exit(main("ablation", defaults, partial(do, STUDY), __doc__))
