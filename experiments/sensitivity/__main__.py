"""Which of the 23 attributes matter, and which of them together, from recorded rewards.

    python -m experiments.sensitivity --target camvid --records benchmarks/data/camvid.jsonl
    python -m experiments.sensitivity --target camvid --data DIR --holdout 0006R0 --store FILE
    python -m experiments.sensitivity --target twin --preset smoke                # under a minute

With --records nothing is rendered and no data are needed. Without, rewards come from the store and
the run folder, and those that they lack are made first. Kill it at any moment; the same command goes on
where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.cli import main
    from experiments.sensitivity.job import analyse, defaults

    sys.exit(main("sensitivity", defaults, analyse, __doc__))
