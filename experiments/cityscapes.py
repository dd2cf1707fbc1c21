"""Learn to simulate for Cityscapes, or for the embedded twin where there is no data.

    python -m experiments.cityscapes                       # the twin: a stand-in, not real data
    python -m experiments.cityscapes --data DIR            # real Cityscapes
    python -m experiments.cityscapes --preset smoke        # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.config import MainConfig
    from experiments.main.job import MAIN
    from experiments.presets import defaults
    from experiments.study.skeleton import do

    def work(config: MainConfig) -> None:
        """The main job on the data, if there are any."""
        do(MAIN, config if config.data is None else replace(config, target="cityscapes"))

    sys.exit(main("cityscapes", partial(defaults, MainConfig), work, __doc__, target="twin"))
