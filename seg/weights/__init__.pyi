"""ImageNet weights: VGG16 from the files that people have, Lite0 from the package that brings it."""

from .store import check, convert, described, load

__all__ = ["check", "convert", "described", "load"]
