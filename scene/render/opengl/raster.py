"""Draw the face of every pixel with OpenGL through pyrender.

pyrender provides the context, the buffers and the scene graph. Its multisampled 8-bit framebuffer and its
culling would blur and drop ids, so both are replaced here: every pixel gets the index of its face and its
depth, as two floats.

Import this module only if OpenGL is needed: importing it loads EGL. Use it from one thread only.
"""

from __future__ import annotations

import os
from ctypes import c_void_p
from typing import Any

import numpy as np

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
if not hasattr(np, "infty"):  # pyrender 0.1.45 knows NumPy 1 only
    np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201

import pyrender
from OpenGL import GL
from OpenGL.error import Error as OpenGLError
from pyrender.constants import RenderFlags
from pyrender.shader_program import ShaderProgram

from scene.render.protocol import RendererError

VERTEX = """#version 330 core
layout(location = 0) in vec3 position;
uniform mat4 V;
uniform mat4 P;
out float depth;
void main() {
    vec4 seen = V * vec4(position, 1.0);
    depth = -seen.z;
    gl_Position = P * seen;
}
"""
FRAGMENT = """#version 330 core
in float depth;
out vec2 face_and_depth;
void main() {
    face_and_depth = vec2(float(gl_PrimitiveID), depth);
}
"""
NOTHING = -1.0
"""Face index of pixels without a face."""
MOST_FACES = 2**24
"""Floats represent face indices exactly up to this one."""


class Rasterizer:
    """A context that draws images of one mesh at a time."""

    def __init__(self) -> None:
        self._offscreen = pyrender.OffscreenRenderer(8, 8)
        self._offscreen._renderer = _FaceRenderer(8, 8)
        self._most = int(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE))
        self._scene: pyrender.Scene | None = None

    def load(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Replace the mesh: vertices f32[v, 3], faces i32[f, 3]; RendererError if it has too many."""
        if len(faces) > MOST_FACES:
            raise RendererError(
                f"the street has {len(faces):,} triangles, but opengl draws at most {MOST_FACES:,}; use "
                "--renderer embree or simpler assets"
            )
        self._scene = pyrender.Scene()
        self._camera = self._scene.add(_Camera())
        self._mesh = self._scene.add(
            pyrender.Mesh([pyrender.Primitive(positions=vertices, indices=faces)])
        )

    def draw(self, pose: np.ndarray, projection: np.ndarray, width: int, height: int) -> np.ndarray:
        """Draw the mesh: f32[h, w, 2] with the face index or NOTHING, and depth in metres.

        Args:
            pose: f64[4, 4], columns: the camera's right, up and backward axes and its position.
            projection: f64[4, 4], from the camera's frame to OpenGL's clip space.
            width: width of the image in pixels.
            height: height of the image in pixels.

        Raises:
            RendererError: the image is too large, or OpenGL failed.
        """
        assert self._scene is not None, "load a mesh first"
        if max(width, height) > self._most:
            raise RendererError(
                f"{width}x{height} samples exceed the limit of this OpenGL driver ({self._most} per side); "
                "use a smaller image, fewer samples per pixel or --renderer embree"
            )
        self._scene.set_pose(self._camera, pose)
        self._camera.camera.matrix = projection
        self._offscreen.viewport_width, self._offscreen.viewport_height = width, height
        try:
            return self._offscreen.render(self._scene, RenderFlags.SEG, {self._mesh: 0})
        # pyrender asserts its EGL calls.
        except (OpenGLError, AssertionError, MemoryError) as error:
            reason = " ".join(str(error).split()) or "the context is lost"
            raise RendererError(f"OpenGL failed ({reason}); try --renderer embree") from error

    def delete(self) -> None:
        """Free the context and all that it holds."""
        self._offscreen.delete()


class _Camera(pyrender.Camera):
    """A camera with a given projection."""

    matrix: np.ndarray

    def get_projection_matrix(self, width: int | None = None, height: int | None = None) -> Any:
        return self.matrix


class _Program(ShaderProgram):
    """A shader program from source texts instead of files."""

    def _load(self, shader_filename: str) -> str:
        return shader_filename


class _Target:
    """A framebuffer of one size: face and depth as floats, and a depth buffer."""

    def __init__(self, width: int, height: int) -> None:
        self.color, self.depth = GL.glGenRenderbuffers(2)
        self.buffer = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.buffer)
        for name, layout, place in (
            (self.color, GL.GL_RG32F, GL.GL_COLOR_ATTACHMENT0),
            (self.depth, GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_ATTACHMENT),
        ):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, name)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, layout, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, name)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise RendererError(
                f"this OpenGL driver has no float framebuffer of {width}x{height} pixels; "
                "use --renderer embree"
            )

    def delete(self) -> None:
        GL.glDeleteFramebuffers(1, [self.buffer])
        GL.glDeleteRenderbuffers(2, [self.color, self.depth])


class _FaceRenderer(pyrender.Renderer):
    """pyrender's renderer with exact ids: no multisampling, no culling, floats for bytes."""

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._targets: dict[tuple[int, int], _Target] = {}
        self._program: _Program | None = None

    def _get_primitive_program(self, primitive: Any, flags: int, program_flags: int) -> _Program:
        if self._program is None:
            self._program = _Program(VERTEX, FRAGMENT)
            self._program._add_to_context()
        return self._program

    def _bind_and_draw_primitive(
        self, primitive: Any, pose: np.ndarray, program: _Program, flags: int
    ) -> None:
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glDisable(GL.GL_BLEND)
        GL.glClearBufferfv(GL.GL_COLOR, 0, (NOTHING, 0.0, 0.0, 0.0))
        primitive._bind()
        GL.glDrawElements(GL.GL_TRIANGLES, primitive.indices.size, GL.GL_UNSIGNED_INT, c_void_p(0))
        primitive._unbind()

    def _configure_main_framebuffer(self) -> None:
        size = self.viewport_width, self.viewport_height
        if size not in self._targets:
            if len(self._targets) >= 4:
                self._delete_main_framebuffer()
            self._targets[size] = _Target(*size)
        self._main_fb_ms = self._targets[size].buffer  # what the forward pass draws into

    def _delete_main_framebuffer(self) -> None:
        for target in self._targets.values():
            target.delete()
        self._targets.clear()

    def _read_main_framebuffer(self, scene: Any, flags: int) -> np.ndarray:
        width, height = self.viewport_width, self.viewport_height
        pixels = np.empty((height, width, 2), np.float32)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb_ms)
        GL.glReadPixels(0, 0, width, height, GL.GL_RG, GL.GL_FLOAT, pixels)
        return pixels[::-1]

    def delete(self) -> None:
        if self._program is not None:
            self._program.delete()
            self._program = None
        super().delete()
