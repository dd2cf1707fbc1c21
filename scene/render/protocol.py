"""The input and output of every renderer."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from common.memory import refuse_larger
from scene.render.sensor import CameraResponse
from scene.street.camera import Camera
from scene.street.street import Street


class RenderSettings(NamedTuple):
    """Size and quality of every image of a dataset."""

    width: int = 640
    height: int = 320
    samples: int = 1  # rays per pixel along each axis
    fov: float = 50.0  # horizontal field of view in degrees, for cameras without their own
    shadows: bool = True
    occlusion: bool = True  # ambient occlusion; in screen space with opengl
    textures: bool = True
    response: CameraResponse = CameraResponse()


class Frame(NamedTuple):
    """One shot with its exact labels."""

    image: np.ndarray  # u8[h, w, 3] sRGB
    label: np.ndarray  # u8[h, w] train ids, VOID for ignored pixels
    instance: np.ndarray  # u16[h, w], 0 is the sky
    depth: np.ndarray  # f32[h, w] metres along the optical axis, 0 for the sky
    normal: np.ndarray  # f32[h, w, 3] unit, in the camera's frame, 0 for the sky; see below
    # x is to the camera's right, y up, z from the scene towards the camera.
    camera: Camera  # that took it, of the candidates of the street


Lap = Callable[[str], None]
"""Called with the name of each stage of rendering when it ends, for timing."""


def no_lap(stage: str) -> None:
    """Do nothing."""


class Renderer(Protocol):
    """Renders all shots of a street."""

    name: str

    def render(
        self,
        street: Street,
        settings: RenderSettings,
        lap: Lap = no_lap,
        shots: Sequence[int] | None = None,
    ) -> list[Frame]:
        """Render one frame per camera of the street.

        Args:
            street: what to render.
            settings: size and quality.
            lap: called after the stages ``build`` (street to arrays), ``bvh`` (or upload), ``rays``
                (what is seen and lit) and ``shade`` (to finished frames), the last two once per shot.
            shots: indices of the cameras to render; by default all.
        """
        ...


class RendererError(RuntimeError):
    """A renderer cannot run on this machine; the message says what is missing."""


MAX_PIXELS = 50_000_000
MOST_SAMPLES = 8
"""Largest number of rays per pixel along each axis."""


def check_settings(settings: RenderSettings) -> RenderSettings:
    """Return the settings; raises ValueError that names a field out of range."""
    for name in ("width", "height", "samples"):
        value = getattr(settings, name)
        if not isinstance(value, int | np.integer):
            raise ValueError(f"{name} must be a whole number, not {value!r}")
    if settings.width < 8 or settings.height < 8:
        raise ValueError(
            f"image size {settings.width}x{settings.height} is too small; 8x8 is the least"
        )
    if settings.width * settings.height > MAX_PIXELS:
        raise ValueError(
            f"image size {settings.width}x{settings.height} has more than {MAX_PIXELS:,} pixels"
        )
    if not 1 <= settings.samples <= MOST_SAMPLES:
        raise ValueError(f"samples must lie in 1..{MOST_SAMPLES}, not {settings.samples}")
    if not 5 <= settings.fov <= 150:
        raise ValueError(f"fov must lie in 5..150 degrees, not {settings.fov}")
    return settings


RAY, SHOWN = 40, 22
"""Least bytes of memory per ray of an image in progress, and per pixel of a finished frame."""


def refuse_large_images(flag: str, settings: RenderSettings) -> None:
    """Raise UserError if the rays of one image do not fit in memory; it names the flag of samples."""
    pixels = settings.width * settings.height
    what = f"the rays of an image of {settings.width}x{settings.height}"
    refuse_larger(flag, settings.samples, lambda samples: samples**2 * pixels * RAY, what)


def refuse_many_shots(flag: str, shots: int, settings: RenderSettings) -> None:
    """Raise UserError if the frames of one street do not fit in memory; it names the flag."""
    size = f"{settings.width}x{settings.height}"
    frame = settings.width * settings.height * SHOWN
    refuse_larger(flag, shots, lambda count: count * frame, f"the frames of a street at {size}")


SHAPES = {
    "position": (3,), "yaw": (), "pitch": (), "roll": (), "exposure": (), "warmth": (), "offset": (2,)
}  # fmt: skip
"""Shapes of a camera's numbers, without its field of view."""


def seen_through(camera: Camera, settings: RenderSettings) -> RenderSettings:
    """The settings with the camera's own field of view, if it has one.

    Raises:
        ValueError: the camera has a number that is not finite, or a field is out of range.
    """
    for name, shape in SHAPES.items():
        value = np.asarray(getattr(camera, name))
        if value.shape != shape or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            number = f"{shape[0]} finite numbers" if shape else "a finite number"
            raise ValueError(f"{name} must be {number}, not {getattr(camera, name)!r}")
    if camera.field_of_view is None:
        return check_settings(settings)
    return check_settings(settings._replace(fov=math.degrees(camera.field_of_view)))


def pixel_rays(
    settings: RenderSettings, samples: int, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Sample positions on the image plane at distance 1: f64[w * samples] rightwards, f64[h * samples] up.

    Args:
        settings: size and field of view.
        samples: rays per pixel along each axis.
        offset: of the principal point, see ``Camera``.
    """
    half = math.tan(math.radians(settings.fov) / 2)
    columns, rows = settings.width * samples, settings.height * samples
    x = ((np.arange(columns) + 0.5) / columns * 2 - 1) * half
    y = (1 - (np.arange(rows) + 0.5) / rows * 2) * half * settings.height / settings.width
    return x - 2 * half * offset[0], y + 2 * half * offset[1]


def through_middles(settings: RenderSettings) -> RenderSettings:
    """The settings with a sample at the centre of each pixel, for label, instance, depth and normal.

    An even number of samples has none there; then it is one sample per pixel, in a separate pass.
    """
    return settings if settings.samples % 2 else settings._replace(samples=1)
