"""Learn to simulate for CamVid.

    python -m experiments.camvid --data DIR                     # reward: train, reported: test
    python -m experiments.camvid --data DIR --holdout 0006R0    # reported on a sequence left out
    python -m experiments.camvid --data DIR --preset smoke      # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config import MainConfig
    from experiments.config.cli import main
    from experiments.config.presets import defaults
    from experiments.main.job import MAIN
    from experiments.study.skeleton import do

    sys.exit(
        main("camvid", partial(defaults, MainConfig), partial(do, MAIN), __doc__, target="camvid")
    )
