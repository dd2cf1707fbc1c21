"""ImageNet weights: VGG16 and DINOv2 from files that people have, the Lites from packages that bring them."""

from shell.lazy import import_on_use

__all__ = import_on_use(__name__)
