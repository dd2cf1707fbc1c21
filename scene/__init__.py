"""SceneX: a street-scene engine with exact labels of the 19 Cityscapes classes.

    import numpy as np
    import scene

    units = np.random.default_rng(0).random((4, len(scene.ATTRIBUTES)), np.float32)  # 4 streets
    dataset = scene.render_dataset(units, 0, shots=2, settings=scene.RenderSettings(160, 120, 2))
    dataset.images, dataset.labels  # u8[8, 120, 160, 3], u8[8, 120, 160] train ids

Names are imported on first use, so that the table of attributes loads no renderer. ``__init__.pyi`` lists
them.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
