"""Names that command lines offer; importing them loads no network."""

from typing import Literal, get_args

As = Literal["ids", "colours", "overlay"]
"""Formats of a written prediction; an overlay is half image, half colours."""

Normalisation = Literal["torchvision", "caffe"]
NORMALISATIONS = get_args(Normalisation)
"""Which images weights expect, see `sdr-jax weights`."""
