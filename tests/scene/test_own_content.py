"""Own assets follow the current content of their files, in all processes and whatever was rendered before."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

from common.files import read_json
from common.workers.pool import WorkerPool
from scene.assets import catalogue, library
from scene.assets.catalogue import AssetPool
from scene.dataset.export import ExportError, export_dataset
from scene.dataset.render import render_dataset
from scene.render import RenderSettings
from tests.scene.conftest import refused, units

SETTINGS = RenderSettings(64, 48, samples=1)


def house(width=9.0, color=(90, 30, 20)):
    """A box as wide as a house, of one colour."""
    mesh = trimesh.creation.box((8, width, 7))
    picture = Image.new("RGB", (2, 2), color)
    mesh.visual = TextureVisuals(uv=np.full((8, 2), 0.3), material=SimpleMaterial(image=picture))
    return mesh


def render(folder, workers=0, **options):
    pool = AssetPool(own=str(folder), use="own")
    shots = {"shots": 1, "settings": SETTINGS, "pool": pool, **options}
    return render_dataset(units(2), 1, workers=workers, **shots)


def are_equal(a, b) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_a_file_that_changes_between_renders_is_read_again_by_all_workers(shelf):
    folder = shelf("building/h.obj", house())
    with WorkerPool(1) as pool:
        first = render(folder, pool)
        assert are_equal(first, render(folder))
        house(14.0).export(Path(folder) / "building/h.obj")
        wider = render(folder)
        assert not np.array_equal(first.labels, wider.labels)
        assert are_equal(wider, render(folder, pool))


def test_a_changed_texture_or_manifest_is_read_again(shelf, tmp_path):
    folder = shelf("building/h.obj", house())
    first = render(folder)
    (texture,) = (tmp_path / "own" / "building").glob("*.png")
    Image.new("RGB", (2, 2), (20, 200, 30)).save(texture)
    green = render(folder)
    assert np.array_equal(first.labels, green.labels) and not are_equal(first, green)
    listing = tmp_path / "own" / "assets.csv"
    listing.write_text(
        "file,author,licence,source,scale\nbuilding/h.obj,A. Maker,CC0-1.0,own work,0.8\n"
    )
    assert not np.array_equal(green.labels, render(folder).labels)


def test_a_relative_folder_is_resolved_when_the_call_is_made(shelf, tmp_path, monkeypatch):
    shelf("building/h.obj", house())
    first_place, second_place = tmp_path / "there", tmp_path / "elsewhere"
    for place in (first_place, second_place):
        place.mkdir()
        shutil.copytree(tmp_path / "own", place / "own")
    house(14.0).export(second_place / "own/building/h.obj")
    monkeypatch.chdir(first_place)
    with WorkerPool(1) as pool:
        first = render("own", pool)
        monkeypatch.chdir(second_place)
        wider = render("own", pool)
    assert are_equal(wider, render(second_place / "own")) and not are_equal(first, wider)
    monkeypatch.chdir(first_place)
    assert are_equal(first, render("own", progress=lambda *_: monkeypatch.chdir(tmp_path)))


def test_an_export_names_all_files_and_stops_where_they_change(shelf, tmp_path):
    folder = shelf("building/h.obj", house())
    pool = AssetPool(own=folder, use="own")

    def export(name, then=lambda *_: None):
        return export_dataset(
            units(3), 1, tmp_path / name, shots=1, settings=SETTINGS, pool=pool, progress=then
        )

    before = export("first")["own_files"]
    (texture,) = (tmp_path / "own" / "building").glob("*.png")
    original = texture.read_bytes()

    def repaint(done, images, written):
        if done == 1:
            Image.new("RGB", (2, 2), (20, 200, 30)).save(texture)

    refused(
        ExportError,
        "own has changed since the export to .*second started",
        export,
        "second",
        repaint,
    )
    refused(ExportError, "other|own_files", export, "second")
    texture.write_bytes(original)
    export("second")
    for name in ("dataset.json", "assets.csv"):
        texts = [(tmp_path / which / name).read_text() for which in ("first", "second")]
        assert texts[0] == texts[1]
    assert read_json(tmp_path / "second" / "dataset.json")["own_files"] == before


def test_a_file_that_changes_before_it_is_read_is_refused(shelf):
    folder = shelf("building/h.obj", house())
    (ref,) = library.scan(folder)["building"]
    house(14.0).export(Path(folder) / "building/h.obj")
    refused(library.LibraryError, "changed while it was read", catalogue.asset, "building", ref)
    (new_ref,) = library.scan(folder)["building"]
    assert new_ref != ref and catalogue.kind("building", new_ref) == "h.obj"
    assert catalogue.bounds("building", new_ref)[1, 0] == pytest.approx(7.0)
