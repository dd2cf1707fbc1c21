"""ImageNet weights of VGG16: read from the files that people have, put into our nets."""

from seg.errors import WeightsError
from seg.weights.normalisation import NORMALISATIONS
from seg.weights.store import check, convert, load

__all__ = ["NORMALISATIONS", "WeightsError", "check", "convert", "load"]
