"""Datasets of labelled images: rendering, writing, reading and checking."""
