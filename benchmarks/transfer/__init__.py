"""Measures how renders transfer to real images: ``python -m benchmarks.transfer``."""
