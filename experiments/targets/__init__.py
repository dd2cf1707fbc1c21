"""Targets, on which networks are tested: real images, or a twin where there are none."""
