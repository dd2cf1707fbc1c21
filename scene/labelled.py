"""One street in a few lines of Python: sample it, add objects, render it with any camera.

World frame: metres, x along the road at its begin, y left, z up. A camera's pose is 4x4, camera to world,
with axes as in OpenCV: x right, y down, z forward.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from common.errors import UserError
from scene.assets import catalogue, own_class
from scene.assets.catalogue import AssetPool, check_pool
from scene.assets.families import FAMILIES
from scene.assets.library import snapshot
from scene.attributes import SPACES, SpaceName, default_unit, names, unit_value
from scene.classes import CLASS_NAMES
from scene.dataset.formats.planes import focal_length, principal_point
from scene.dataset.formats.segments import segments
from scene.dataset.render import street_of
from scene.ground.build import GROUND_INSTANCES
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
"""Passes, and the field of a frame that each is."""


ASPECT = 2e-3
"""The largest relative difference of the focal lengths in x and y; their mean is used."""


class Instance(NamedTuple):
    """One visible object of an image."""

    id: int  # in ``instances``
    class_name: str
    asset: str
    box: tuple[int, int, int, int]  # left, top, width and height in pixels
    pixels: int  # that show it


class Rendered(NamedTuple):
    """A picture of a street; passes that were not asked for are None."""

    image: np.ndarray | None  # u8[h, w, 3] sRGB
    classes: np.ndarray | None  # u8[h, w] train ids, 255 is void
    instances: np.ndarray | None  # u16[h, w], 0 is the sky
    depth: np.ndarray | None  # f32[h, w] metres along the optical axis, 0 for the sky
    normals: (
        np.ndarray | None
    )  # f32[h, w, 3] unit: x right, y up, z towards the camera; 0 for the sky
    table: tuple[Instance, ...]  # what is seen, by id, without the sky
    intrinsics: np.ndarray  # f64[3, 3] pixels; the middle of the first pixel is (0, 0)
    pose: np.ndarray  # f64[4, 4] camera to world, axes as in OpenCV


class LabelledStreet:
    """A street to which objects can be added, and which renders itself; see `sample`."""

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
        """Place an object on the ground; nothing else moves.

        Args:
            mesh: a mesh of trimesh or an `Asset` (metres, z up, front along x), a mesh file, or family and
                number of an asset of ours, as ``("car", 3)``.
            class_name: its class in labels, such as ``car``; or the own class of ``assets``.
            position: metres along the road and left of its centre line; a third number lifts it.
            yaw: degrees left of the road's direction.

        Returns:
            Its id in ``instances``.

        Raises:
            UserError: an unknown class or asset, a bad mesh, position or yaw.
        """
        train_id = self._train_id(class_name)
        place = np.asarray(position, float)
        if place.shape not in ((2,), (3,)) or not np.isfinite(place).all():
            raise UserError(f"position must be 2 or 3 finite numbers in metres, not {position!r}")
        if not math.isfinite(yaw):
            raise UserError(f"yaw must be a finite number of degrees, not {yaw}")
        x, y, lift = [*place.tolist(), 0.0][:3]
        stand = Stand(*_reference(mesh), x, y, math.radians(yaw), lift)
        [placement] = placed(self.street.ground, [stand])
        number = FIRST_INSTANCE + len(self.street.placements)
        placement = placement._replace(train_id=train_id, instance=number, far=False)
        self.street = self.street._replace(placements=(*self.street.placements, placement))
        return number

    def render(
        self,
        camera: int | Camera | tuple[Any, Any] = 0,
        size: tuple[int, int] = (640, 320),
        passes: Sequence[str] = tuple(PASSES),
        samples: int = 1,
        renderer_name: str = "embree",
    ) -> Rendered:
        """Render one picture.

        Args:
            camera: number of one of the street's own, a `Camera`, or intrinsics [3, 3] in pixels (the middle
                of the first pixel is (0, 0)) and pose [4, 4], camera to world: x right, y down, z forward.
                Pixels are square; the principal point may be anywhere in the image. With the intrinsics
                and pose of camera 0, the images are those of camera 0.
            size: width and height in pixels.
            passes: of ``image``, ``classes``, ``instances``, ``depth``, ``normals``.
            samples: rays per pixel along each axis.
            renderer_name: ``embree`` or ``opengl``.

        Raises:
            UserError: an unknown pass, a bad size, or a camera that cannot be.
        """
        for name in passes:
            if name not in PASSES:
                raise UserError(f"passes: {name!r} is unknown; known: {', '.join(PASSES)}")
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
        own = self.pool.own_class
        known = (*CLASS_NAMES, *([own.name] if own else []))
        if class_name not in known:
            near = get_close_matches(str(class_name), known, 1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
            raise UserError(f"class_name {class_name!r} is unknown; {hint}")
        return known.index(class_name)

    def _table(self, frame: Frame) -> tuple[Instance, ...]:
        own = self.pool.own_class
        class_names = (*CLASS_NAMES, own.name if own else "")
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
    """Sample a street, the first of a dataset with this seed.

    Args:
        seed: decides all random choices.
        space: ``scenex``, or ``extended`` for its further attributes.
        assets: the assets that may appear, or a folder of your own.
        weather: ``clear``, ``fog``, ``rain``, ``snow`` or ``night``; by default left to chance.
        shots: number of cameras along the road.
        attributes: by name, in the units of the table of attributes; the others as in the default street.

    Raises:
        UserError: an unknown attribute, or a value out of range.
    """
    if seed < 0:
        raise UserError(f"seed must be 0 or more, not {seed}")
    if shots < 1:
        raise UserError(f"shots must be 1 or more, not {shots}")
    if space not in SPACES:
        raise UserError(f"space {space!r} is unknown; known: {', '.join(SPACES)}")
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
    """Family and reference of what is to be added."""
    if isinstance(mesh, str | Path):
        if not Path(mesh).is_file():
            raise UserError(f"mesh {mesh} is not a file")
        ref = snapshot(str(mesh))
        own_class.load(ref)
        return own_class.FAMILY, ref
    if isinstance(mesh, tuple) and not isinstance(mesh, Asset):
        if len(mesh) != 2 or mesh[0] not in FAMILIES or not isinstance(mesh[1], int) or mesh[1] < 0:
            raise UserError(
                f"mesh {mesh!r}: an asset is a family and a number from 0, as ('car', 3); families: "
                f"{', '.join(FAMILIES)}"
            )
        return mesh
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
