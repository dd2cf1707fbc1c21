"""One street in a few lines of Python: sample it, add objects, render it from any camera.

World frame: metres, x along the road at its start, y left, z up. A camera's pose is a 4x4 matrix from camera
to world, with axes as in OpenCV: x right, y down, z forward.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from common.errors import UserError, hint
from scene.assets import catalogue, own_class
from scene.assets.catalogue import AssetPool, check_pool, parts_of
from scene.assets.families import FAMILIES
from scene.assets.library import snapshot
from scene.attributes import SPACES, SpaceName, default_unit, names, unit_value
from scene.classes import CLASS_NAMES
from scene.dataset.formats.planes import focal_length, principal_point
from scene.dataset.formats.segments import segments
from scene.dataset.render import check_seed, street_of
from scene.ground.build import GROUND_INSTANCES
from scene.ground.path import FROM, TO
from scene.mesh.asset import Asset
from scene.mesh.bombs import MeshError
from scene.mesh.file import from_trimesh
from scene.render import Frame, RenderSettings, check_settings, renderer
from scene.render.protocol import seen_through
from scene.street.camera import Camera, camera_axes
from scene.street.instances import FIRST_INSTANCE, Stand, placed
from scene.street.street import Street

if TYPE_CHECKING:
    import trimesh

PASSES = {
    "image": "image", "classes": "label", "instances": "instance", "depth": "depth",
    "normals": "normal",
}  # fmt: skip
"""Passes by name, with their field of a frame."""


ASPECT = 2e-3
"""The largest relative difference of the focal lengths in x and y; their mean is used."""


class Instance(NamedTuple):
    """One visible object of an image."""

    id: int  # in ``instances``
    class_name: str
    asset: str
    box: tuple[int, int, int, int]  # left, top, width and height in pixels
    pixels: int  # number of visible pixels


class Rendered(NamedTuple):
    """One rendered image of a street; passes that were not requested are None."""

    image: np.ndarray | None  # u8[h, w, 3] sRGB
    classes: np.ndarray | None  # u8[h, w] train ids, 255 is ignored
    instances: np.ndarray | None  # u16[h, w], 0 is the sky
    depth: np.ndarray | None  # f32[h, w] metres along the optical axis, 0 for the sky
    normals: np.ndarray | None  # f32[h, w, 3] x right, y up, z towards the camera; 0 for the sky
    table: tuple[Instance, ...]  # visible objects by id, without the sky
    intrinsics: np.ndarray  # f64[3, 3] in pixels; the centre of the first pixel is (0, 0)
    pose: np.ndarray  # f64[4, 4] camera to world, axes as in OpenCV


class LabelledStreet:
    """A street that can be extended with objects and rendered; made by `sample`."""

    def __init__(self, street: Street, pool: AssetPool) -> None:
        self.street = street
        self.pool = pool

    def add(
        self,
        mesh: trimesh.Trimesh | trimesh.Scene | str | Path | Asset | tuple[str, int],
        class_name: str,
        position: Sequence[float],
        yaw: float = 0.0,
    ) -> int:
        """Place an object on the ground; no other object moves.

        A mesh is moved so that its bounding box is centred on ``position`` and stands on the ground; it leans
        with the slope of the road. A built-in rider comes with a machine, a built-in sign or light with a
        post; these have their own classes and the next ids.

        Args:
            mesh: a trimesh mesh or an `Asset` (metres, z up, front along x), a mesh file, or the family and
                number of a built-in asset, such as ``("car", 3)``.
            class_name: its class in the labels, such as ``car``, or your own class if ``assets`` has one; not
                ``sky``.
            position: metres along the road and to the left of its centre line, and optionally the height of
                its lowest point above the ground.
            yaw: degrees to the left of the road's direction.

        Returns:
            Its id in ``instances``.

        Raises:
            UserError: the class or asset is unknown, or the mesh, position or yaw is invalid.
        """
        train_id = self._train_id(class_name)
        try:
            place = np.asarray(position, float)
        except (TypeError, ValueError):
            place = np.empty(0)
        if place.shape not in ((2,), (3,)) or not np.isfinite(place).all():
            raise UserError(f"position must be 2 or 3 finite numbers in metres, not {position!r}")
        is_number = isinstance(yaw, int | float | np.integer | np.floating)
        if not is_number or not math.isfinite(yaw):
            raise UserError(f"yaw must be a finite number of degrees, not {yaw!r}")
        x, y, lift = [*place.tolist(), 0.0][:3]
        if not FROM <= x <= TO:
            raise UserError(f"position {x:g} along the road must lie in {FROM:g}..{TO:g} metres")
        parts = parts_of(*_reference(mesh), 0.0, AssetPool())
        stands = [
            Stand(*part, x, y, math.radians(yaw), lift, part=k > 0) for k, part in enumerate(parts)
        ]
        number = FIRST_INSTANCE + len(self.street.placements)
        placements = [
            placement._replace(instance=number + k, far=False)
            for k, placement in enumerate(placed(self.street.ground, stands))
        ]
        placements[0] = placements[0]._replace(train_id=train_id)
        self.street = self.street._replace(placements=(*self.street.placements, *placements))
        return number

    def render(
        self,
        camera: int | Camera | tuple[Any, Any] = 0,
        size: tuple[int, int] = (640, 320),
        passes: Sequence[str] = tuple(PASSES),
        samples: int = 1,
        renderer_name: str = "embree",
    ) -> Rendered:
        """Render one image.

        Args:
            camera: the number of one of the street's cameras, a `Camera`, or a pair of intrinsics [3, 3] in
                pixels (the centre of the first pixel is (0, 0)) and pose [4, 4] from camera to world (x
                right, y down, z forward). Pixels are square; the principal point may be anywhere in the
                image. The intrinsics and pose of camera 0 give the arrays of camera 0, normals up to
                rounding.
            size: width and height in pixels.
            passes: any of ``image``, ``classes``, ``instances``, ``depth``, ``normals``.
            samples: rays per pixel along each axis.
            renderer_name: ``embree`` or ``opengl``.

        Raises:
            UserError: a pass is unknown, or the size or camera is invalid.
        """
        passes = (passes,) if isinstance(passes, str) else tuple(passes)
        for name in passes:
            if name not in PASSES:
                raise UserError(f"passes: {name!r} is unknown; {hint(name, PASSES)}")
        try:
            settings = check_settings(RenderSettings(*size, samples=samples))
        except (TypeError, ValueError) as error:
            raise UserError(f"size {size!r}, samples {samples!r}: {error}") from None
        street, cameras, shot = self.street, self.street.cameras, 0
        if isinstance(camera, int | np.integer):
            if not 0 <= camera < len(cameras):
                raise UserError(
                    f"camera {camera} does not exist; the street has 0 to {len(cameras) - 1}"
                )
            shot = int(camera)
        else:
            if not isinstance(camera, Camera):
                camera = _camera(camera, settings, cameras[0])
            try:
                seen_through(camera, settings)
            except (TypeError, ValueError) as error:
                raise UserError(f"camera: {error}") from None
            # The other cameras stay: greenery near any of them has leaves in all images.
            street = street._replace(cameras=(camera, *cameras))
        [frame] = renderer(renderer_name).render(street, settings, shots=(shot,))
        arrays = {name: getattr(frame, f) if name in passes else None for name, f in PASSES.items()}
        return Rendered(
            **arrays,
            table=self._table(frame),
            intrinsics=_intrinsics(frame.camera, seen_through(frame.camera, settings)),
            pose=_pose(frame.camera),
        )

    def _train_id(self, class_name: str) -> int:
        own_class = self.pool.own_class
        class_names = (*CLASS_NAMES, *([own_class.name] if own_class else []))
        if class_name == "sky":
            raise UserError(
                "class_name 'sky' is what no object covers; choose the class of an object"
            )
        if class_name not in class_names:
            raise UserError(
                f"class_name {class_name!r} is unknown; {hint(class_name, class_names)}"
            )
        return class_names.index(class_name)

    def _table(self, frame: Frame) -> tuple[Instance, ...]:
        own_class = self.pool.own_class
        class_names = (*CLASS_NAMES, own_class.name if own_class else "")
        ground = [class_names[k] for k in GROUND_INSTANCES.values()]
        assets = {k: (name, name) for k, name in enumerate(ground, start=1)}
        for p in self.street.placements:
            assets[p.instance] = (class_names[p.train_id], _asset_name(p.family, p.asset))
        return tuple(
            Instance(row.id, *assets[row.id], row.box, row.area)
            for row in segments(frame.instance.astype(np.int32))
        )


def sample(
    seed: int = 0,
    *,
    space: SpaceName = "scenex",
    assets: AssetPool | str | Path | None = None,
    weather: str = "",
    shots: int = 1,
    **attributes: float,
) -> LabelledStreet:
    """Sample a street: the first one of a dataset with this seed.

    Args:
        seed: random seed, below 2**32.
        space: ``scenex``, or ``extended`` for more attributes.
        assets: the assets to use, or a folder of your own.
        weather: ``clear``, ``fog``, ``rain``, ``snow`` or ``night``; by default random.
        shots: number of cameras along the road.
        attributes: values by name, in the units of the table of attributes; the others keep their defaults.

    Raises:
        UserError: an attribute is unknown, or a value is out of range.
    """
    check_seed(seed)
    if shots < 1:
        raise UserError(f"shots must be 1 or more, not {shots}")
    if space not in SPACES:
        raise UserError(f"space {space!r} is unknown; {hint(space, SPACES)}")
    unit = default_unit(space)
    for name, value in attributes.items():
        number = unit_value(name, value, space)  # refuses unknown names
        unit[names(space).index(name)] = number
    pool = AssetPool(own=str(assets)) if isinstance(assets, str | Path) else assets or AssetPool()
    try:
        pool = check_pool(pool._replace(weather=weather or pool.weather))
    except UserError:
        raise
    except ValueError as error:
        raise UserError(str(error)) from None
    return LabelledStreet(street_of(unit, seed, 0, shots, pool), pool)


def _reference(mesh: Any) -> tuple[str, int | str]:
    """Family and reference of the asset to add."""
    if isinstance(mesh, str | Path):
        if not Path(mesh).is_file():
            raise UserError(f"mesh {mesh} is not a file")
        ref = snapshot(str(mesh))
        own_class.load(ref)
        return own_class.FAMILY, ref
    if isinstance(mesh, tuple) and not isinstance(mesh, Asset):
        is_index = len(mesh) == 2 and isinstance(mesh[1], int | np.integer) and mesh[1] >= 0
        if not is_index or mesh[0] not in FAMILIES:
            raise UserError(
                f"mesh {mesh!r}: an asset is a family and a number from 0, such as ('car', 3); families: "
                f"{', '.join(FAMILIES)}"
            )
        return mesh[0], int(mesh[1])
    try:
        asset = mesh if isinstance(mesh, Asset) else from_trimesh(mesh)
        return own_class.FAMILY, own_class.in_memory(asset)
    except MeshError as error:
        raise UserError(f"mesh {error}") from None
    except (AttributeError, TypeError, ValueError):
        kind = type(mesh).__name__
        raise UserError(f"mesh must be a trimesh mesh, a file or an asset, not {kind}") from None


def _asset_name(family: str, ref: int | str) -> str:
    if isinstance(ref, int):
        return f"{family} {ref}"
    return ref if ref.startswith("mesh ") else catalogue.kind(family, ref)


def _camera(matrices: Any, settings: RenderSettings, like: Camera) -> Camera:
    """The camera with these intrinsics and pose, and with the exposure of another one."""
    try:
        intrinsics, pose = (np.asarray(matrix, float) for matrix in matrices)
    except (TypeError, ValueError):
        raise UserError(
            "camera must be a number, a Camera, or intrinsics [3, 3] and pose [4, 4]"
        ) from None
    for name, matrix, shape in (("intrinsics", intrinsics, (3, 3)), ("pose", pose, (4, 4))):
        if matrix.shape != shape or not np.isfinite(matrix).all():
            problem = "NaN or infinite" if matrix.shape == shape else f"shape {matrix.shape}"
            raise UserError(f"camera {name} must be finite numbers of shape {shape}, not {problem}")
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    width, height = settings.width, settings.height
    focal = (fx + fy) / 2
    if not fx > 0 or abs(fy / fx - 1) > ASPECT:
        raise UserError(
            f"camera intrinsics must have one focal length above 0, not fx {fx:g} and fy {fy:g}: pixels "
            "are square"
        )
    if not np.allclose(intrinsics, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rtol=0, atol=1e-3):
        raise UserError(
            f"camera intrinsics must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], not {intrinsics.tolist()}"
        )
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        raise UserError(
            f"camera intrinsics: the principal point ({cx:g}, {cy:g}) is outside of the image of "
            f"{width}x{height} pixels"
        )
    view = 2 * math.atan(width / 2 / focal)
    if not 5 <= math.degrees(view) <= 150:
        raise UserError(
            f"camera fx {focal:g} at width {width} is a field of view of {math.degrees(view):.3g} "
            "degrees; it must lie in 5..150"
        )
    turn = pose[:3, :3]
    if (
        not np.allclose(turn.T @ turn, np.eye(3), atol=1e-3)
        or np.linalg.det(turn) < 0
        or not np.allclose(pose[3], [0, 0, 0, 1])
    ):
        raise UserError("camera pose must be a rotation and a position, with the last row 0 0 0 1")
    right, forward = turn[:, 0], turn[:, 2]
    yaw, pitch = math.atan2(-forward[1], forward[0]), -math.asin(np.clip(forward[2], -1, 1))
    level = np.array([-math.sin(yaw), -math.cos(yaw), 0.0])
    roll = math.atan2(-right @ np.cross(level, forward), right @ level)
    x, y, z = pose[:3, 3].tolist()
    offset = (cx - (width - 1) / 2) / width, (cy - (height - 1) / 2) / width
    return Camera((x, y, z), yaw, pitch, roll, view, like.exposure, like.warmth, offset=offset)


def _intrinsics(camera: Camera, settings: RenderSettings) -> np.ndarray:
    focal, (cx, cy) = focal_length(settings), principal_point(camera, settings)
    return np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])


def _pose(camera: Camera) -> np.ndarray:
    right, up, forward = camera_axes(camera)
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, -up, forward, camera.position])
    return pose
