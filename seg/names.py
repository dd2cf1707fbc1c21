"""Names that command lines offer, apart from what bears them: no net is loaded."""

from typing import Literal, get_args

As = Literal["ids", "colours", "overlay"]
"""What is written of a prediction; an overlay is half image, half colours."""

Normalisation = Literal["torchvision", "caffe", "hed"]
NORMALISATIONS = get_args(Normalisation)
"""Which images weights expect, see `sdr-jax weights`."""
