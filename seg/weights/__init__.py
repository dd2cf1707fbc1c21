"""ImageNet weights: VGG16 and DINOv2 from the user's files, the Lites from packages."""

from shell.lazy import import_on_use

__all__ = import_on_use(__name__)
