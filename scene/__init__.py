"""SceneX: a street-scene engine with exact labels of the 19 Cityscapes classes.

    import numpy as np
    import scene

    units = np.random.default_rng(0).random((4, len(scene.ATTRIBUTES)), np.float32)  # 4 streets
    dataset = scene.render_dataset(units, 0, shots=2, settings=scene.RenderSettings(160, 120, 2))
    dataset.images, dataset.labels  # u8[8, 120, 160, 3], u8[8, 120, 160] train ids

Names are imported on first use, so that the table of attributes does not load a renderer.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from shell.interrupt import while_loading

while_loading(__name__)  # before all else

if TYPE_CHECKING:
    from scene.assets.catalogue import AssetPool
    from scene.attributes import ATTRIBUTES, StreetParams, default_unit, street_params
    from scene.classes import CLASS_NAMES, TrainId, colorize
    from scene.dataset.export import export_dataset
    from scene.dataset.render import Dataset, render_dataset, render_street
    from scene.render import RENDERERS, Frame, RendererError, RenderSettings, renderer
    from scene.render.sensor import CameraResponse
    from scene.street.street import Street, sample_street

_HOMES = {
    "scene.attributes": ("ATTRIBUTES", "StreetParams", "default_unit", "street_params"),
    "scene.assets.catalogue": ("AssetPool",),
    "scene.classes": ("CLASS_NAMES", "TrainId", "colorize"),
    "scene.dataset.render": ("Dataset", "render_dataset", "render_street"),
    "scene.dataset.export": ("export_dataset",),
    "scene.render": ("RENDERERS", "Frame", "RenderSettings", "RendererError", "renderer"),
    "scene.render.sensor": ("CameraResponse",),
    "scene.street.street": ("Street", "sample_street"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ATTRIBUTES",
    "CLASS_NAMES",
    "RENDERERS",
    "AssetPool",
    "CameraResponse",
    "Dataset",
    "Frame",
    "RenderSettings",
    "RendererError",
    "Street",
    "StreetParams",
    "TrainId",
    "colorize",
    "default_unit",
    "export_dataset",
    "render_dataset",
    "render_street",
    "renderer",
    "sample_street",
    "street_params",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scene' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
