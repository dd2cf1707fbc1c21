"""Tables of networks: rows with paired seeds, their plan, statistics and report.

`experiments.app` and `experiments.studies` share them, so that neither imports the other.
"""
