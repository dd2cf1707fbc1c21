"""Optimises a simulator that is a program of its own; the command line is `sdr-jax tune`.

What the program reads: `units.py`; how it is run: `simulator.py`; what the TOML file may say: `settings.py`.
"""
