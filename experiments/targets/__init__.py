"""Targets, on which nets are tested: real images, or without any a twin."""
