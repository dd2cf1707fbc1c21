"""Learn to simulate for LabelMeFacade.

    python -m experiments.labelmefacade --data DIR                    # reward: train, reported: test
    python -m experiments.labelmefacade --data DIR --holdout ALBUM    # reported on an album left out
    python -m experiments.labelmefacade --data DIR --preset smoke     # under a minute

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

    own, work = partial(defaults, MainConfig), partial(do, MAIN)
    sys.exit(main("labelmefacade", own, work, __doc__, target="labelmefacade"))
