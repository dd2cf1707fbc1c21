"""Datasets of labelled images of many streets: rendering, writing, reading and checking."""
