"""The C interface of Intel Embree 4 from the ``embreex`` wheel, called from compiled loops.

embreex itself casts one ray at a time and has no instances. The library in its wheel has packets of eight
rays and instancing, which together make a street several times faster. Only its published C interface
(``rtcore.h`` of Embree 4) is used here.
"""

from __future__ import annotations

import ctypes
import importlib.util
from ctypes import c_char_p, c_int, c_size_t, c_uint, c_void_p
from functools import cache
from pathlib import Path

import llvmlite.binding
import numpy as np
from numba import types

from scene.render.protocol import RendererError

PATTERNS = (
    "embreex.libs/libembree4*.so*",  # Linux
    "embreex.libs/embree4*.dll",  # Windows
    "embreex/.dylibs/libembree4*.dylib",  # macOS
    "embreex/embree4*.dll",
)
TRIANGLE, INSTANCES = 0, 122  # RTCGeometryType
INDEX, VERTEX, TRANSFORM = 0, 1, 23  # RTCBufferType
UINT, UINT3, FLOAT3, FLOAT3X4_ROW_MAJOR = 0x5001, 0x5003, 0x9003, 0x9134  # RTCFormat
LANES = 8
"""Rays in a packet."""

_SIGNATURES = {
    "rtcNewDevice": (c_void_p, (c_char_p,)),
    "rtcGetDeviceError": (c_int, (c_void_p,)),
    "rtcNewScene": (c_void_p, (c_void_p,)),
    "rtcCommitScene": (None, (c_void_p,)),
    "rtcReleaseScene": (None, (c_void_p,)),
    "rtcNewGeometry": (c_void_p, (c_void_p, c_int)),
    "rtcSetSharedGeometryBuffer": (
        None,
        (c_void_p, c_int, c_uint, c_int, c_void_p, c_size_t, c_size_t, c_size_t),
    ),
    "rtcSetGeometryInstancedScenes": (None, (c_void_p, c_void_p, c_size_t)),
    "rtcCommitGeometry": (None, (c_void_p,)),
    "rtcAttachGeometryByID": (None, (c_void_p, c_void_p, c_uint)),
    "rtcReleaseGeometry": (None, (c_void_p,)),
}


def _find() -> Path:
    spec = importlib.util.find_spec("embreex")
    if spec is None or spec.origin is None:
        raise RendererError(
            "rendering needs the embreex wheel (pip install embreex), which does not exist for Linux on ARM"
        )
    site = Path(spec.origin).parents[1]
    for pattern in PATTERNS:
        for path in sorted(site.glob(pattern)):
            return path
    raise RendererError(
        f"the embreex wheel in {site} has no Embree 4 library; reinstall it (4.3 or later)"
    )


@cache
def library() -> ctypes.CDLL:
    """Embree, loaded once; afterwards, compiled code finds its symbols.

    Raises:
        RendererError: the embreex wheel is missing, or has no Embree 4.
    """
    path = _find()
    try:
        # The wheel's own module first: it finds the libraries that Embree needs.
        import embreex.rtcore  # noqa: F401

        llvmlite.binding.load_library_permanently(str(path))
        embree = ctypes.CDLL(str(path))
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(embree, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, ImportError, RuntimeError, AttributeError) as error:
        raise RendererError(f"Embree cannot be loaded from {path} ({error})") from error
    return embree


@cache
def device() -> int:
    """Embree's device of this process: one thread, since workers are processes."""
    handle = library().rtcNewDevice(b"threads=1")
    if not handle:
        raise RendererError(
            "Embree does not support this processor; rendering needs one that it supports"
        )
    return int(handle)


class _QueryArguments(ctypes.Structure):
    """``RTCIntersectArguments``; ``RTCOccludedArguments`` has the same layout."""

    _fields_ = (
        ("flags", c_int),
        ("feature_mask", c_int),
        ("context", c_void_p),
        ("filter", c_void_p),
        ("function", c_void_p),
    )


_INCOHERENT = _QueryArguments(0, -1, None, None, None)


def query_arguments() -> int:
    """Address of the arguments for incoherent rays.

    With the many small boxes of a street this is faster even for parallel rays.
    """
    return ctypes.addressof(_INCOHERENT)


_packet = types.void(types.uintp, types.uintp, types.uintp, types.uintp)
occluded8 = types.ExternalFunction("rtcOccluded8", _packet)
intersect8 = types.ExternalFunction("rtcIntersect8", _packet)
"""For compiled code: (valid, scene, packet of rays, or of rays and hits, arguments), all addresses."""


class MeshBVH:
    """A bounding volume hierarchy of one mesh; higher quality takes six times as long to build for no gain.

    It keeps the arrays that Embree reads alive.

    Args:
        vertices: f32[v, 3].
        faces: i32[f, 3].
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._embree = library()
        # Embree reads 16 bytes at each vertex, so one more must follow the last.
        self._vertices = np.concatenate([vertices, np.zeros((1, 3), np.float32)])
        self._faces = np.ascontiguousarray(faces, np.int32)
        self.scene = int(self._embree.rtcNewScene(device()))
        embree, vertices, faces = self._embree, self._vertices, self._faces
        mesh = embree.rtcNewGeometry(device(), TRIANGLE)
        embree.rtcSetSharedGeometryBuffer(
            mesh, VERTEX, 0, FLOAT3, vertices.ctypes.data, 0, 12, len(vertices)
        )
        embree.rtcSetSharedGeometryBuffer(
            mesh, INDEX, 0, UINT3, faces.ctypes.data, 0, 12, len(faces)
        )
        embree.rtcCommitGeometry(mesh)
        embree.rtcAttachGeometryByID(self.scene, mesh, 0)
        embree.rtcReleaseGeometry(mesh)
        embree.rtcCommitScene(self.scene)
        check("a mesh")

    def __del__(self) -> None:
        if hasattr(self, "scene"):
            self._embree.rtcReleaseScene(self.scene)


class SceneBVH:
    """A bounding volume hierarchy of instances of meshes.

    Args:
        meshes: the distinct meshes.
        mesh: i[n] index of the mesh of each instance.
        poses: f32[n, 3, 4] from the frames of the meshes to the world.
    """

    def __init__(self, meshes: list[MeshBVH], mesh: np.ndarray, poses: np.ndarray) -> None:
        self._embree = embree = library()
        scenes = np.array([mesh.scene for mesh in meshes], np.uintp)
        which = np.ascontiguousarray(mesh, np.uint32)
        poses = np.ascontiguousarray(poses, np.float32)
        self._kept = meshes, which, poses  # Embree reads them
        self.scene = int(embree.rtcNewScene(device()))
        if len(which):
            instances = embree.rtcNewGeometry(device(), INSTANCES)
            embree.rtcSetGeometryInstancedScenes(instances, scenes.ctypes.data, len(scenes))
            for kind, layout, array, stride in (
                (INDEX, UINT, which, 4), (TRANSFORM, FLOAT3X4_ROW_MAJOR, poses, 48),
            ):  # fmt: skip
                embree.rtcSetSharedGeometryBuffer(
                    instances, kind, 0, layout, array.ctypes.data, 0, stride, len(array)
                )
            embree.rtcCommitGeometry(instances)
            embree.rtcAttachGeometryByID(self.scene, instances, 0)
            embree.rtcReleaseGeometry(instances)
        embree.rtcCommitScene(self.scene)
        check("a street")

    def __del__(self) -> None:
        if hasattr(self, "scene"):
            self._embree.rtcReleaseScene(self.scene)


def check(what: str) -> None:
    """Raise RendererError if Embree could not build ``what``."""
    code = library().rtcGetDeviceError(device())
    if code:
        reason = {4: "out of memory", 5: "unsupported processor"}.get(code, f"error {code}")
        raise RendererError(f"Embree could not build {what}: {reason}")
