"""Tables of networks: rows with paired seeds, their plan, statistics and report.

What `experiments.app` and `experiments.studies` share, so that neither imports the other.
"""
