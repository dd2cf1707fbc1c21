"""What pre-training on SceneX saves: nets fine-tuned on ever more of the real reward images.

    python -m experiments.pretrain --target camvid --data DIR --holdout 0006R0
    python -m experiments.pretrain --target camvid --data DIR --fractions 0.05 1.0 --seeds 8
    python -m experiments.pretrain --target twin --preset smoke                  # under a minute
    python -m experiments.pretrain --rederive runs/a/pretrain.json --out runs/b  # no net at all

Nets from scratch (or from ImageNet weights, with --final.train.weights), pre-trained on random and on
learnt attributes are fine-tuned alike on 5, 10, 25 and 100 % of the reward images and scored on the test
images; Welch's t-test over seeds says which differences are more than chance. Attributes are learnt first,
unless --learnt names what an earlier run has learnt. Kill it at any moment; the same command goes on
where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.pretrain.job import STUDY, defaults
    from experiments.study.skeleton import do

    sys.exit(main("pretrain", defaults, partial(do, STUDY), __doc__))
