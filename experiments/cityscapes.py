"""Learn to simulate for Cityscapes, or for the embedded twin where there is no data.

    python -m experiments.cityscapes                       # the twin: a stand-in, not real data
    python -m experiments.cityscapes --data DIR            # real Cityscapes
    python -m experiments.cityscapes --preset smoke        # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config import cityscapes_config
    from experiments.main import main
    from experiments.targets import cityscapes_target

    sys.exit(main("cityscapes", cityscapes_config, cityscapes_target, __doc__ or ""))
