"""ImageNet weights: Lites from the package that brings them, others from the files that people have."""

from .store import check, convert, described, load

__all__ = ["check", "convert", "described", "load"]
