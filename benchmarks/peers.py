"""Time other renderers on one of our streets, each in its own process, in any Python that has it.

    python benchmarks/peers.py mitsuba FOLDER     # FOLDER from export_street

They render one merged mesh in one colour from one camera under one sun on both cores, and time themselves:
the median of three images after a warm-up. Their work is simpler than ours (no textures, and labels only
where noted), so a ratio is a lower bound.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scene.street.street import Street

PEERS = ("pyrender", "mitsuba", "blender")
NOT_INSTALLED = 3
"""Exit code of a peer that is not installed."""

Timed = Iterator[tuple[str, float]]


def export_street(folder: Path, street: Street, width: int, height: int) -> None:
    """Write ``street.ply`` and ``view.json`` (camera axes as rows: right, up, forward; radiometry)."""
    import numpy as np
    import trimesh

    from scene.render import RenderSettings
    from scene.render.embree.renderer import scene_bvh
    from scene.render.framing import framed
    from scene.render.geometry import build, world
    from scene.street.camera import camera_axes

    geometry = build(street)
    vertices = world(geometry).vertices
    faces = np.arange(len(vertices)).reshape(-1, 3)
    trimesh.Trimesh(vertices, faces, process=False).export(folder / "street.ply")
    (camera, *_) = framed(street, geometry, scene_bvh(geometry), RenderSettings()).cameras
    view = {
        "position": list(camera.position),
        "axes": camera_axes(camera).tolist(),
        "fov": RenderSettings().fov,
        "width": width,
        "height": height,
        "sun": street.sky.sun_direction.tolist(),
    }
    (folder / "view.json").write_text(json.dumps(view))


def run_peer(python: str, name: str, folder: Path) -> list[tuple[str, float]]:
    """Run a peer, and return its measurements (what, ms); empty, with a note, if it is not installed."""
    command = [python, str(Path(__file__)), name, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == NOT_INSTALLED:
        print(f"{name} left out: not installed in {python}", file=sys.stderr)
        return []
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
        print(f"{name} left out: {reason}", file=sys.stderr)
        return []
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    return [(row["what"], row["ms"]) for row in map(json.loads, lines)]


def _median(draw: Callable[[], Any]) -> float:
    """Measure the median milliseconds of three runs after a warm-up."""
    times = []
    for _ in range(4):
        started = time.perf_counter()
        draw()
        times.append(1000 * (time.perf_counter() - started))
    return statistics.median(times[1:])


def _pyrender(mesh: Any, view: dict[str, Any]) -> Timed:
    import os

    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    import numpy as np

    if not hasattr(np, "infty"):  # pyrender 0.1.45 needs names of NumPy 1
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    import pyrender

    axes = np.array(view["axes"]) * [[1], [1], [-1]]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes.T, view["position"]
    sun = np.eye(4)
    across = np.cross([1.0, 0.0, 0.0], view["sun"])
    across /= np.linalg.norm(across)
    sun[:3, :3] = np.column_stack([across, np.cross(view["sun"], across), view["sun"]])
    scene = pyrender.Scene(ambient_light=[0.3] * 3)
    node = scene.add(pyrender.Mesh.from_trimesh(mesh, smooth=False))
    aspect = view["width"] / view["height"]
    half = np.tan(np.radians(view["fov"]) / 2) / aspect
    scene.add(pyrender.PerspectiveCamera(2 * np.arctan(half), aspectRatio=aspect), pose=pose)
    scene.add(pyrender.DirectionalLight(intensity=3.0), pose=sun)
    renderer = pyrender.OffscreenRenderer(view["width"], view["height"])
    flags = pyrender.RenderFlags
    yield "colour", _median(lambda: renderer.render(scene))
    shadows = flags.SHADOWS_DIRECTIONAL
    yield "colour with shadows", _median(lambda: renderer.render(scene, flags=shadows))
    yield (
        "label alone",
        _median(lambda: renderer.render(scene, flags.SEG, {node: (1, 2, 3)})),
    )


def _mitsuba(folder: Path, view: dict[str, Any]) -> Timed:
    import mitsuba  # type: ignore[import-not-found]
    import numpy as np

    mitsuba.set_variant("scalar_rgb")
    position = np.array(view["position"])
    target = position + np.array(view["axes"][2])
    transform = mitsuba.ScalarTransform4f().look_at(
        origin=position.tolist(), target=target.tolist(), up=[0, 0, 1]
    )
    for samples in (1, 16):
        scene = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "direct"},
                "sensor": {
                    "type": "perspective",
                    "fov": view["fov"],
                    "fov_axis": "x",
                    "to_world": transform,
                    "film": {"type": "hdrfilm", "width": view["width"], "height": view["height"]},
                    "sampler": {"type": "independent", "sample_count": samples},
                },
                "street": {
                    "type": "ply",
                    "filename": str(folder / "street.ply"),
                    "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}},
                },
                "sun": {"type": "directional", "direction": [-x for x in view["sun"]]},
                "sky": {"type": "constant", "radiance": 0.5},
            }
        )
        yield (
            f"scalar_rgb, direct light, {samples} samples a pixel",
            _median(lambda: np.array(mitsuba.render(scene))),  # noqa: B023
        )


def _blender(folder: Path, view: dict[str, Any]) -> Timed:
    import math

    import bpy  # type: ignore[import-not-found]
    from mathutils import Matrix, Vector  # type: ignore[import-not-found]

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.ply_import(filepath=str(folder / "street.ply"), forward_axis="Y", up_axis="Z")
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    right, up, forward = (Vector(axis) for axis in view["axes"])
    camera.matrix_world = (
        Matrix.Translation(view["position"]) @ Matrix((right, up, -forward)).transposed().to_4x4()
    )
    camera.data.sensor_fit, camera.data.angle = "HORIZONTAL", math.radians(view["fov"])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.rotation_euler = Vector(view["sun"]).to_track_quat("Z", "Y").to_euler()
    for item in (camera, sun):
        scene.collection.objects.link(item)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("world")
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = False
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y = view["width"], view["height"]
    scene.render.filepath = str(folder / "blender.png")
    for samples in (1, 16):
        scene.cycles.samples = samples
        yield (
            f"Cycles, {samples} samples a pixel",
            _median(lambda: bpy.ops.render.render(write_still=True)),
        )


def main(name: str, folder: Path) -> int:
    """Measure one peer; returns the exit code."""
    view = json.loads((folder / "view.json").read_text())
    try:
        if name == "pyrender":
            import trimesh

            timed = _pyrender(trimesh.load(folder / "street.ply", process=False), view)
        elif name == "mitsuba":
            timed = _mitsuba(folder, view)
        else:
            timed = _blender(folder, view)
        for what, ms in timed:
            print()
            print(json.dumps({"what": what, "ms": ms}), flush=True)
    except ModuleNotFoundError as error:
        print(error, file=sys.stderr)
        return NOT_INSTALLED
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
