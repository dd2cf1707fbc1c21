"""Statistics of a dataset, compared with those of its target."""

import json
import shutil

import numpy as np
import pytest

from scene import CLASS_NAMES, AssetPool, RenderSettings, export_dataset
from scene.dataset.export import read_dataset
from scene.dataset.formats.png import encode as png
from scene.dataset.formats.png import read_png
from scene.dataset.real import CAMVID, CAMVID_OF_TRAIN
from scene.proposal import draw, random_proposal
from scene.stats import compare, count, main
from seg.classes import CAMVID_11
from tests.conftest import packed_png


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stats") / "dataset"
    units, options = draw(random_proposal(), 2, 2), {"shots": 2, "pool": AssetPool(0, 3)}
    export_dataset(units, 5, folder, settings=RenderSettings(96, 64), **options)
    return folder


@pytest.fixture
def camvid(tmp_path):
    """Two images of two by two pixels in CamVid's layout: sky over road, then a car and ignored pixels."""
    rows = ("0001TP_1", 100, [[0, 0], [3, 3]]), ("0016E5_2", 200, [[11, 11], [11, 8]])
    for name, blue, label in rows:
        for part, plane in (("train", [[(0, 0, blue)] * 2] * 2), ("trainannot", label)):
            (tmp_path / part).mkdir(exist_ok=True)
            (tmp_path / part / f"{name}.png").write_bytes(png(np.array(plane, np.uint8)))
    return tmp_path


def test_counts_by_hand():
    image = np.array([[(4, 8, 12)]] + [[(0, 0, 0)]] * 3, np.uint8)
    pairs = [(image, np.array([[1], [1], [0], [255]], np.uint8)), (image, np.full((4, 1), 0))]
    statistics = count(pairs, 3)
    assert statistics.images == 2 and statistics.void == pytest.approx(1 / 8)
    assert statistics.frequency.tolist() == pytest.approx([5 / 7, 2 / 7, 0])
    assert statistics.containing.tolist() == [2, 1, 0]
    # Row centres: 1/8, 3/8, 5/8, 7/8.
    assert statistics.mean_row[:2].tolist() == pytest.approx([(5 / 8 + 16 / 8) / 5, 1 / 4])
    assert np.isnan(statistics.mean_row[2])
    assert statistics.mean_rgb.tolist() == [1, 2, 3]


def test_the_figures_of_a_dataset_are_those_of_its_description(dataset):
    classes, statistics = compare(dataset, None, ())
    description = json.loads((dataset / "dataset.json").read_text())
    assert classes == CLASS_NAMES and list(statistics) == ["dataset"]
    figures = statistics["dataset"]
    np.testing.assert_allclose(
        figures.frequency, [*description["class_frequency"].values()], atol=1e-8
    )
    assert figures.containing.tolist() == [*description["images_with_class"].values()]
    np.testing.assert_allclose(figures.mean_rgb, description["mean_rgb"], atol=1e-3)
    assert figures.framing == (description["shots_retaken"], description["shots_refused"])


def test_camvid_is_the_measure_in_its_own_classes_all_of_it_or_some_sequences(dataset, camvid):
    assert CAMVID == CAMVID_11.classes
    np.testing.assert_array_equal(CAMVID_OF_TRAIN, CAMVID_11.from_train_id)
    classes, statistics = compare(dataset, camvid, ())
    target = statistics["target"]
    assert classes == CAMVID and target.images == 2
    assert dict(zip(classes, target.frequency, strict=True)) == {
        **dict.fromkeys(CAMVID, 0), "sky": 2 / 5, "road": 2 / 5, "car": 1 / 5
    }  # fmt: skip
    assert target.void == 3 / 8 and target.mean_rgb.tolist() == [0, 0, 150]
    labels = CAMVID_OF_TRAIN[read_dataset(dataset).labels]
    share = np.bincount(labels.ravel(), minlength=256)[:11]
    np.testing.assert_allclose(statistics["dataset"].frequency, share / share.sum())
    _, statistics = compare(dataset, camvid, ("0016E5", "0006R0"))
    assert statistics["target"].images == 1 and statistics["target"].mean_rgb.tolist() == [
        0,
        0,
        200,
    ]
    with pytest.raises(ValueError, match="no images called Seq05"):
        compare(dataset, camvid, ("Seq05",))


@pytest.mark.parametrize(("bits", "colour_type"), [(4, 0), (4, 3), (8, 3), (16, 0)])
def test_labels_of_a_palette_and_of_other_bits_are_counted_alike(camvid, bits, colour_type):
    _, before = compare(camvid, None, ())
    for path in (camvid / "trainannot").iterdir():
        path.write_bytes(packed_png(read_png(path).tolist(), bits, colour_type))
    _, after = compare(camvid, None, ())
    np.testing.assert_array_equal(after["dataset"].frequency, before["dataset"].frequency)
    assert after["dataset"].void == before["dataset"].void


def test_a_folder_like_cityscapes_is_read_without_a_description(dataset, tmp_path):
    # Real labels hold ids that do not count.
    extra = (("leftImg8bit", "leftImg8bit", np.zeros((2, 2, 3), np.uint8)),
             ("gtFine", "gtFine_labelIds", np.full((2, 2), 4, np.uint8)))  # fmt: skip
    for part, kind, plane in extra:
        folder = tmp_path / part / "train" / "scenex"
        folder.mkdir(parents=True)
        for path in dataset.glob(f"{part}/train/scenex/*_{kind}.png"):
            shutil.copy(path, folder)
        (folder / f"scenex_9_9_{kind}.png").write_bytes(png(plane))
    classes, statistics = compare(dataset, tmp_path, ())
    assert len(classes) == 19
    np.testing.assert_allclose(statistics["target"].frequency, statistics["dataset"].frequency)
    assert statistics["target"].images == 5 and statistics["target"].void > 0


def test_the_command_line_prints_and_writes_the_same_figures(dataset, camvid, tmp_path, printed):
    path = tmp_path / "stats.json"
    text = printed(main, dataset, "--against", camvid, "--json", path)
    stored = json.loads(path.read_text())
    assert list(stored) == ["dataset", "target"]
    nowhere = {"frequency": 0, "mean_row": None, "images": 0}
    assert stored["target"]["classes"]["bicyclist"] == nowhere
    [line] = [line for line in text.splitlines() if line.startswith("sky")]
    share = 100 * stored["dataset"]["classes"]["sky"]["frequency"]
    assert f"{share:.3f}" in line and "40.000" in line
    assert "target: 2 images, mean RGB 0/0/150, 37.5 % of pixels ignored" in text


@pytest.mark.parametrize(("damage", "message"), [
    (lambda root: (root / "train/0001TP_1.png").write_bytes(b"x"), "cannot be decoded"),
    (lambda root: (root / "train/0001TP_1.png").write_bytes(b""), "cannot be decoded"),
    (lambda root: (root / "trainannot/0001TP_1.png").unlink(), "0001TP_1.png"),
    (lambda root: (root / "trainannot/0001TP_1.png").write_bytes(png(np.zeros((3, 3), np.uint8))),
     "differ in size"),
    (lambda root: (root / "trainannot/0001TP_1.png").write_bytes(packed_png([[300] * 2] * 2, 16, 0)),
     "label value 300; expected 0..255"),
    (lambda root: shutil.copy(root / "train/0001TP_1.png", root / "trainannot"), "mode RGB"),
    (lambda root: (root / "trainannot").rename(root / "labels"), "expected dataset.json"),
])  # fmt: skip
def test_a_broken_target_is_one_line_and_exit_code_two(damage, message, dataset, camvid, refusal):
    damage(camvid)
    error = refusal(main, dataset, "--against", camvid)
    assert message in error and str(camvid) in error


def test_real_camvid(dataset, camvid_dir):
    statistics = compare(dataset, camvid_dir, ("0016E5", "0001TP"))[1]["target"]
    assert statistics.images > 200 and statistics.mean_row[CAMVID.index("sky")] < 0.3
    assert 0.2 < statistics.frequency[CAMVID.index("road")] < 0.45


def test_names_of_real_images_choose_no_rendered_ones(dataset, refusal):
    error = refusal(main, dataset, "--against", dataset, "--only", "0016E5")
    assert "--only is for real images, but these are rendered" in error
    assert "--only needs --against" in refusal(main, dataset, "--only", "0016E5")
