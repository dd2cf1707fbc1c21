"""The opengl renderer compared with embree, and failures of OpenGL."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from scene import AssetPool, CameraResponse, RenderSettings, TrainId, default_unit, street_params
from scene.assets.families import FAMILIES
from scene.attributes import BY_NAME
from scene.classes import VOID
from scene.dataset.render import render_dataset
from scene.preview.closeup import asset_street
from scene.render import RendererError, renderer
from scene.street.extras import Mix
from scene.street.street import sample_street
from tests.conftest import printed
from tests.scene import conftest
from tests.scene.conftest import chosen

POOL = AssetPool(0, 6)
street = partial(conftest.street, pool=POOL)
SMALL = RenderSettings(width=96, height=64)


@pytest.fixture(scope="module")
def opengl():
    return chosen("opengl")


def test_more_triangles_than_labels_can_hold_are_refused(opengl):
    from scene.render.opengl.raster import MOST_FACES, Rasterizer

    faces = np.broadcast_to(np.int32(0), (MOST_FACES + 1, 3))
    with pytest.raises(
        RendererError, match="16,777,217 triangles, but opengl draws at most 16,777,216"
    ):
        Rasterizer.load(None, np.zeros((1, 3), np.float32), faces)


def both(opengl, sampled, settings):
    """The first frame of each renderer, with images as floats."""
    frames = [by.render(sampled, settings)[0] for by in (renderer("embree"), opengl)]
    return [frame._replace(image=frame.image.astype(float)) for frame in frames]


@pytest.mark.parametrize("random", [False, True], ids=["default", "random"])
@pytest.mark.parametrize("seed", range(4))
def test_labels_instances_and_depth_agree_with_embree(opengl, seed, random):
    unit = np.random.default_rng([3, seed]).random(23) if random else default_unit()
    sampled = street(street_params(unit), seed, 2)
    settings = RenderSettings(width=640, height=320, shadows=False, occlusion=False, textures=False)
    frames = (by.render(sampled, settings) for by in (renderer("embree"), opengl))
    for a, b in zip(*frames, strict=True):
        assert (a.label != b.label).mean() < 0.001  # 0.005 is promised
        # Facades of neighbours may lie in one plane: there, either is right.
        assert (a.instance != b.instance).mean() < 0.005
        same = (a.instance == b.instance) & (a.depth > 0)
        assert np.quantile(np.abs(b.depth[same] / a.depth[same] - 1), 0.99) < 1e-4


@pytest.mark.parametrize(("family", "kind"), [("fence", "guard rail"), ("person", "suitcase")])
def test_both_leave_the_same_pixels_void(opengl, family, kind):
    sampled = asset_street(family, FAMILIES[family].kind_cycle.index(kind), 4 / 3, 50)
    a, b = both(opengl, sampled, RenderSettings(400, 300, shadows=False, occlusion=False))
    assert (a.label == VOID).mean() > 0.02 and (a.label != b.label).mean() < 0.001


@pytest.mark.slow
def test_labels_agree_over_a_hundred_images_of_streets_with_all_there_is(opengl):
    """On 99.9 % of pixels: attributes at random in the extended space, every ingredient as likely as not."""
    flat_settings = RenderSettings(480, 360, shadows=False, occlusion=False, textures=False)
    units = np.random.default_rng(17).random((50, len(BY_NAME)))
    differ = []
    for seed, unit in enumerate(units):
        sampled = sample_street(street_params(unit), seed, 2, POOL, Mix(*[0.5] * len(Mix._fields)))
        frames = (by.render(sampled, flat_settings) for by in (renderer("embree"), opengl))
        differ += [(a.label != b.label).mean() for a, b in zip(*frames, strict=True)]
    mean, most = np.mean(differ), max(differ)
    print(f"labels differ on {mean:.4%} of pixels, at most {most:.3%} of an image")
    assert len(differ) == 100 and mean < 0.001


@pytest.mark.parametrize("seed", range(3))
def test_pictures_look_alike(opengl, seed):
    sampled = street(seed=seed)
    settings = RenderSettings(width=320, height=160, response=CameraResponse(noise=0.0))
    a, b = both(opengl, sampled, settings)
    assert b.image.mean() == pytest.approx(a.image.mean(), abs=5)
    # Shadow maps and occlusion on screen are approximations; nothing else differs.
    assert np.abs(a.image - b.image).mean() < 8
    a, b = both(opengl, sampled, settings._replace(shadows=False, occlusion=False))
    assert np.abs(a.image - b.image).mean() < 0.35  # levels of 255: the edges of leaves
    for samples in (2, 3):
        a, b = both(opengl, sampled, SMALL._replace(samples=samples, occlusion=False))
        assert (a.label != b.label).mean() < 0.005 and np.abs(a.image - b.image).mean() < 3


def test_shadows_agree_with_embree(opengl):
    sunny = street(seed=1)
    sunny = sunny._replace(sky=sunny.sky._replace(cover=0.0, sun=np.float32([1.5, 1.4, 1.3])))
    settings = RenderSettings(320, 160, occlusion=False, response=CameraResponse(noise=0.0))
    with_it = both(opengl, sunny, settings)
    without = both(opengl, sunny, settings._replace(shadows=False))
    frames = zip(with_it, without, strict=True)
    one, other = ((lit.image - dark.image).sum(axis=2) < 30 for dark, lit in frames)
    assert 0.2 < one.mean() < 0.9 and (one != other).mean() < 0.03


def test_neither_threads_nor_workers_nor_pictures_of_other_sizes_change_the_bytes(opengl):
    sampled = street()
    serial = opengl.render(sampled, SMALL)[0]
    with ThreadPoolExecutor(3) as threads:
        frames = list(threads.map(lambda _: opengl.render(sampled, SMALL)[0], range(6)))
    for width in (64, 80, 112, 128, 200):
        opengl.render(sampled, SMALL._replace(width=width))
    for frame in (*frames, opengl.render(sampled, SMALL)[0]):
        assert all(a.tobytes() == b.tobytes() for a, b in zip(serial[:5], frame[:5], strict=True))
    with pytest.raises(RendererError, match=r"20000x8 samples exceed .* embree"):
        opengl.render(street(), RenderSettings(width=20_000, height=8))
    assert (opengl.render(street(), SMALL)[0].label == TrainId.ROAD).any()
    units = np.stack([default_unit(), np.full(23, 0.5, np.float32)])
    options = {"shots": 1, "settings": SMALL, "renderer_name": "opengl", "pool": POOL}
    serial, parallel = (render_dataset(units, 1, workers=workers, **options) for workers in (0, 1))
    assert (serial.images == parallel.images).all() and (serial.labels == parallel.labels).all()


def test_after_a_failure_resources_are_free_and_the_next_picture_is_right(opengl, monkeypatch):
    from scene.render.opengl import raster

    sampled, deleted, delete = street(), [], raster.Rasterizer.delete
    before = opengl.render(sampled, SMALL)[0]
    monkeypatch.setattr(raster.Rasterizer, "delete", lambda r: (deleted.append(r), delete(r)))

    def fail(*_, **__):
        raise raster.OpenGLError("out of\nmemory")

    with monkeypatch.context() as broken:
        broken.setattr(raster._FaceRenderer, "_forward_pass", fail)
        with pytest.raises(RendererError, match=r"^OpenGL failed \(out of memory\); .*embree$"):
            opengl.render(sampled, SMALL)
    assert len(deleted) == 1
    assert opengl.render(sampled, SMALL)[0].image.tobytes() == before.image.tobytes()


@pytest.mark.parametrize(("setting", "value"), [
    ("EGL_DEVICE_ID", "99"), ("PYOPENGL_PLATFORM", "nonsense"), ("hide", "pyrender"),
])  # fmt: skip
def test_where_opengl_is_missing_one_line_says_what_to_install(setting, value):
    hide = f"sys.modules[{value!r}] = None\n" if setting == "hide" else ""
    code = (
        f"import sys\n{hide}"
        "from scene.render import RendererError, renderer\n"
        "try:\n    renderer('opengl')\n"
        "except RendererError as error:\n    print(error)\n"
        "print(renderer('embree').name)\n"
    )
    message, name = printed(code, **{setting: value})
    assert message.startswith("the opengl renderer cannot start (") and name == "embree"
    assert "apt-get install libegl1 libgl1-mesa-dri" in message and "--renderer embree" in message
