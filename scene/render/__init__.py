"""Renderers by name, behind one protocol."""

from __future__ import annotations

from common.errors import hint
from scene.names import RENDERERS
from scene.render.memory import keep_freed_memory
from scene.render.protocol import Frame, Renderer, RendererError, RenderSettings, check_settings

__all__ = [
    "RENDERERS",
    "Frame",
    "RenderSettings",
    "Renderer",
    "RendererError",
    "check_settings",
    "renderer",
]


def renderer(name: str) -> Renderer:
    """The renderer called ``name``, imported only now.

    Raises:
        ValueError: unknown name.
        RendererError: this machine lacks what the renderer needs.
    """
    keep_freed_memory()
    if name == "embree":
        from scene.render.embree.renderer import EmbreeRenderer

        return EmbreeRenderer()
    if name == "opengl":
        from scene.render.opengl.renderer import OpenGLRenderer

        return OpenGLRenderer()
    raise ValueError(f"unknown renderer {name!r}; {hint(name, RENDERERS)}")
