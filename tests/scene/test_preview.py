"""Contact sheets, sweeps and pages of assets: the right images in the right places, or one line of error."""

import math

import cv2
import numpy as np
import pytest
import trimesh

from scene import CLASS_NAMES, RenderSettings, TrainId, colorize, renderer
from scene.assets.catalogue import AssetPool, asset, bounds, surfaces
from scene.assets.families import FAMILIES
from scene.assets.library import scan
from scene.attributes import BY_NAME, NAMES
from scene.preview.__main__ import main
from scene.preview.closeup import SKIES, _refs, asset_street, fit, named_sky, surface_street
from scene.preview.dataset import _small
from scene.preview.layout import CAPTION, Studio, captioned, grid, save, stack, tile
from scene.preview.streets import sweep
from scene.preview.themes import THEMES, VIEW, themed
from scene.street.camera import camera_axes
from scene.street.extras import Mix
from tests.scene.conftest import POOL, chosen, refused

SMALL = RenderSettings(64, 48, samples=1)
ROW = 32 + CAPTION


def look(street):
    return renderer("embree").render(street, SMALL)[0]


def test_grids_stacks_and_tiles_show_their_parts():
    red, blue = (np.full((4, 6, 3), color, np.uint8) for color in ((255, 0, 0), (0, 0, 255)))
    page = grid([red, blue, red], 2)
    assert page.shape == (8, 12, 3) and stack([red, page]).shape == (12, 12, 3)
    assert (page[:4, 6:] == blue).all() and (page[4:, :6] == red).all()
    assert (page[4:, 6:] == 255).all()
    # A caption is above the image and does not change it.
    above = captioned(np.zeros((20, 60, 3), np.uint8), "car 3")
    assert not above[CAPTION:].any() and 0.02 < (above[:CAPTION] < 128).mean() < 0.5
    frame = look(asset_street("car", 0, 4 / 3, 50.0))
    image, label, depth = np.split(tile(frame), 3)
    assert (image == frame.image).all() and (label == colorize(frame.label)).all()
    assert depth.shape == (48, 64, 3) and (depth[frame.depth == 0] == 0).all()
    # Riders ride, and signs have posts.
    assert len(asset_street("rider", 0, 1.3, 50).placements) == 2
    assert asset_street("traffic sign", 0, 1.3, 50).placements[1].family == "signpost"


@pytest.mark.parametrize("azimuth", [-160, -38, 0, 95])
@pytest.mark.parametrize("size", [(4, 2, 1.5), (0.1, 0.5, 8), (12, 30, 9)])
def test_a_fitted_camera_has_the_whole_box_in_view_and_no_more_than_needed(azimuth, size):
    low, high = np.array([3.0, -2.0, 1.0]), np.array([3.0, -2.0, 1.0]) + size
    camera = fit(low, high, azimuth, 15.0, 1.5, 50.0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
    right, up, ahead = camera_axes(camera) @ (corners - camera.position).T
    share = np.abs([right, 1.5 * up]) / ahead / math.tan(math.radians(25))
    assert (ahead > 0).all() and 0.85 < share.max() < 0.9
    middle = camera_axes(camera) @ ((low + high) / 2 - camera.position)
    assert middle[:2] == pytest.approx([0, 0], abs=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_each_asset_is_seen_and_in_view(family):
    frame = look(asset_street(family, 1, 4 / 3, 50.0))
    assert (frame.label == FAMILIES[family].train_id).mean() > 0.004
    rows, columns = np.nonzero(frame.instance == 4)
    assert max(np.ptp(rows) / 48, np.ptp(columns) / 64) > 0.45
    assert 0 < columns.min() and columns.max() < 63 and 0 < rows.min()


@pytest.mark.parametrize("name", surfaces())
def test_surfaces_are_seen(name):
    assert (look(surface_street(name, 1)).label == TrainId[name.upper()]).mean() > 0.3


def test_a_sweep_of_light_goes_from_dark_to_bright_and_every_sky_can_be_shown_by_name():
    page = sweep("illumination_intensity", 3, 0, Studio(SMALL, pool=POOL))
    assert page.shape == (48 + CAPTION, 3 * 64, 3)
    light = [part.mean() for part in np.split(page[CAPTION:], 3, axis=1)]
    assert light == sorted(set(light))
    assert [named_sky(row.name).weather for row in SKIES] == [row.name for row in SKIES]
    refused(ValueError, "unknown weather 'green'", named_sky, "green")


@pytest.mark.parametrize(("line", "file", "height", "columns"), [
    ("--streets 2 --shots 2", "sheet.png", 2 * 3 * 32, 2),
    ("--sweep car_interval --steps 2", "sweep.jpg", ROW, 2),
    ("--asset vegetation --count 4 --columns 2", "page.png", 2 * ROW, 2),
    pytest.param("--asset all --columns 3", "page.png", len(CLASS_NAMES) * ROW, 3, marks=pytest.mark.slow),
    pytest.param("--sweep all --steps 2", "page.png", len(BY_NAME) * ROW, 2, marks=pytest.mark.slow),
])  # fmt: skip
def test_pages_are_written(line, file, height, columns, tmp_path):
    out = tmp_path / file
    assert main(["--out", str(out), *line.split(), "--size", "48x32"]) == 0
    assert cv2.imread(str(out)).shape == (height, columns * 48, 3)
    assert out.read_bytes().startswith({".jpg": b"\xff\xd8", ".png": b"\x89PNG"}[out.suffix])


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_a_theme_gives_each_street_what_it_says_and_leaves_the_rest(theme):
    rows = themed(theme, 3, 4)
    expected = {**VIEW, **theme.attributes}
    for k, (name, row) in enumerate(BY_NAME.items()):
        if name in expected:
            assert row.physical(rows[0, k]) == pytest.approx(expected[name], abs=1e-5)
        assert (np.ptp(rows[:, k]) > 0) == (k < len(NAMES) and name not in expected)
    assert set(theme.mix) <= set(Mix._fields)


def test_a_theme_is_shown_by_both_renderers(tmp_path, printed):
    chosen("opengl")
    line = "--theme islands --renderer both --streets 2 --size 48x36"
    printed(main, "--out", tmp_path / "page.png", *line.split())
    page = cv2.imread(str(tmp_path / "page.png")).astype(int)
    assert page.shape == (2 * (24 + CAPTION), 2 * 32, 3)
    first, second = (part[CAPTION:] for part in np.split(page, 2))
    assert 0 < np.abs(first - second).mean() < 20


@pytest.fixture
def folder(shelf):
    """One box as an own bus."""
    return shelf("bus/box.stl", trimesh.creation.box((10, 2.5, 3)))


def test_own_assets_are_shown_and_what_is_left_out_is_said(folder, tmp_path, printed):
    out, (ref,) = tmp_path / "page.png", scan(str(folder))["bus"]
    line = f"--out {out} --asset bus --assets {folder} --asset-use own --size 48x32"
    assert "left out: building, train" in printed(main, *line.split())
    assert len(cv2.imread(str(out))) == ROW
    # They stand in streets.
    assert bounds("bus", ref)[1] == pytest.approx([5, 1.25, 3])
    frame = look(asset_street("bus", ref, 4 / 3, 50.0))
    assert (frame.label == TrainId.BUS).mean() > 0.1 and len(asset("bus", ref).mesh.faces) == 12


def test_own_assets_of_the_second_family_of_a_class_are_shown(shelf):
    folder = shelf("bush/box.stl", trimesh.creation.box((1, 1, 1)))
    own = AssetPool(own=folder, use="own")
    refs = [("bush", ref) for ref in scan(folder)["bush"]]
    assert _refs("vegetation", 1, own) == _refs("vegetation", 5, own) == refs
    assert _refs("vegetation", 3, AssetPool()) == [("tree", 0), ("tree", 1), ("bush", 0)]


@pytest.mark.parametrize("version", [4, 5])
def test_a_page_that_is_too_large_is_refused_with_any_opencv(version, tmp_path, monkeypatch):
    def encode(*_):
        if version == 4:
            raise cv2.error("too large")
        return False, ()

    monkeypatch.setattr(cv2, "imencode", encode)
    message = r"page\.jpg: 6x4 pixels are too many for \.jpg"
    refused(ValueError, message, save, np.zeros((4, 6, 3), np.uint8), tmp_path / "page.jpg")


@pytest.mark.parametrize(("size", "small"), [
    ((640, 320), (320, 160)), ((64, 48), (64, 48)), ((64, 60_000), (3, 2560)), ((5000, 8), (320, 1)),
])  # fmt: skip
def test_images_of_a_contact_sheet_are_bounded_in_width_and_height(size, small):
    assert _small(np.zeros((*size[::-1], 3), np.uint8), cv2.INTER_AREA).shape[1::-1] == small


@pytest.mark.parametrize(("flags", "message"), [
    ("--sweep hats", "unknown attribute 'hats'; known: illumination_intensity"),
    ("--theme hats", "unknown theme 'hats'; known: islands, bends"),
    ("--renderer both", "--renderer both works with --theme only"),
    ("--asset boat", "no assets of class 'boat'; known: building"),
    ("--sweep car_intervall", "unknown attribute 'car_intervall'; did you mean car_interval?"),
    ("--theme bend", "unknown theme 'bend'; did you mean bends?"),
    ("--asset caar", "no assets of class 'caar'; did you mean car?"),
    ("--size 48", "must look like 640x320, not '48'"), ("--size 0x32", "0x32 is too small"),
    ("--streets 0", "--streets must lie in 1..400, not 0"),
    ("--shots -1", "--shots must lie in 1..400, not -1"),
    ("--sweep all --steps 1", "--steps must lie in 2..400, not 1"),
    ("--sweep all --attributes random", "--attributes has no effect with --sweep"),
    ("--asset car --space=extended", "--space has no effect with --asset"),
    ("--asset car --weather fog", "--weather has no effect with --asset"),
    ("--asset car --seed 3", "--seed has no effect with --asset"),
    ("--theme bends --shots 3", "--shots has no effect with --theme"),
    ("--sweep all --streets 2", "--streets has no effect with --sweep"),
    ("--steps 3", "--steps needs --sweep"), ("--columns 3", "--columns needs --asset"),
    ("--asset all --count 9999", "--count must lie in 1..400, not 9999"),
    ("--seed 4294967296", "--seed must lie in 0..4294967295, not 4294967296"),
    ("--asset-fraction 0", "asset fraction must lie in (0, 1], not 0"),
    ("--asset-use own", "needs a folder of own assets"),
    ("--weather hail", "'hail'"),
    ("--asset car --assets own --asset-use own", "the asset pool has no car"),
    ("--assets /no/such", "/no/such does not exist"),
    ("--renderer blender", "both, not 'blender'"),
    ("--sweep all --asset all", "not allowed with"), ("--out x.gif", "must end in .png"),
    ("--out none/x.png", "the folder none does not exist"),
])  # fmt: skip
def test_bad_input_is_refused_in_one_line(flags, message, folder, tmp_path, refusal, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(main, "--out", "x.png", *flags.split())
    assert [path.name for path in tmp_path.iterdir()] == ["own"]
