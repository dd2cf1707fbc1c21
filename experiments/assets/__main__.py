"""The paper's study of assets and images: what half the assets, or fewer images, cost.

    python -m experiments.assets --target camvid --data DIR --holdout 0006R0
    python -m experiments.assets --target camvid --data DIR --attributes learnt --learnt a.json
    python -m experiments.assets --target twin --preset smoke                  # under a minute
    python -m experiments.assets --rederive runs/a/assets.json --out runs/b    # no net at all

Nets are trained on 90 to 1350 images that draw from all assets or from the first half of each class, and
scored on the test images, paired. Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.assets.job import STUDY, defaults
    from experiments.cli import main
    from experiments.study.skeleton import do

    sys.exit(main("assets", defaults, partial(do, STUDY), __doc__))
