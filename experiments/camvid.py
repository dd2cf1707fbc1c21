"""Learn to simulate for CamVid.

    python -m experiments.camvid --data DIR                     # reward: train, reported: test
    python -m experiments.camvid --data DIR --holdout 0006R0    # reported on a sequence left out
    python -m experiments.camvid --data DIR --preset smoke      # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config import camvid_config
    from experiments.main import main
    from experiments.targets import camvid_target

    sys.exit(
        main("camvid", camvid_config, camvid_target, __doc__ or "", data_variable="CAMVID_DIR")
    )
