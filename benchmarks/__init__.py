"""Benchmarks that compare alternatives side by side in one run. Each takes ``--json FILE``."""

from common.interrupt import while_loading

while_loading(__name__)  # before all else
