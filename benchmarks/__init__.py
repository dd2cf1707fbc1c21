"""Benchmarks that compare things side by side in one run. Each takes ``--json FILE``."""

from shell.interrupt import while_loading

while_loading(__name__)  # before all else
