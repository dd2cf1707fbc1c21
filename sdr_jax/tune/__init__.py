"""Optimises a simulator that is a program of its own; the command line is `python -m sdr_jax.tune`.

What the program reads: `units.py`; how it is run: `simulator.py`; what the TOML file may say: `settings.py`.
"""
