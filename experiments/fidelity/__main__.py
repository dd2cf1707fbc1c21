"""How much a cheap reward is worth: does it rank attributes as the full size does, and for what price?

    python -m experiments.fidelity --target camvid --data DIR --holdout 0006R0
    python -m experiments.fidelity --target twin --preset smoke                  # about a minute
    python -m experiments.fidelity --target twin --reward-kind mmd               # without labels
    python -m experiments.fidelity --rungs 1 --require-signal 2 --reward.train.net fcn8s && ...  # then search

Proposals with random bins, the street set by eye and random attributes are scored on every rung of the
ladder from the reward's size to the final one, some of them with several seeds. Kill it at any moment;
the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.fidelity.job import defaults, measure

    sys.exit(main("fidelity", defaults, measure, __doc__))
