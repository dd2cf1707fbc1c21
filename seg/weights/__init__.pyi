"""ImageNet weights: VGG16 from the files that people have, Lite0 from the package that brings it."""

from seg.errors import WeightsError as WeightsError
from seg.names import NORMALISATIONS as NORMALISATIONS
from seg.weights.store import check, convert, described, load

__all__ = ["NORMALISATIONS", "WeightsError", "check", "convert", "described", "load"]
