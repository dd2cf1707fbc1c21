"""ImageNet weights: VGG16 and DINOv2 from files that people have, the Lites from packages that bring them."""

from seg.errors import WeightsError
from seg.weights.normalisation import NORMALISATIONS
from seg.weights.store import check, convert, described, load

__all__ = ["NORMALISATIONS", "WeightsError", "check", "convert", "described", "load"]
