"""Optimise a simulator that is a program of its own; the command line is `sdr-jax tune`.

`units.py` writes the file that the program reads, `simulator.py` runs it, `settings.py` reads the TOML file.
"""
