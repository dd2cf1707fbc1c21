"""ImageNet weights: VGG16 from the files that people have, Lite0 from the package that brings it."""

from shell.lazy import import_on_use

__all__ = import_on_use(__name__)
