"""Scripts that measure, side by side in one run. Each takes ``--json FILE``."""
