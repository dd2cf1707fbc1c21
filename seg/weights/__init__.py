"""ImageNet weights: VGG16 and DINOv2 from the user's files, the Lites from packages."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
