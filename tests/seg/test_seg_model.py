"""Models: saved and loaded bit by bit, used on images of any size, and refused where they are damaged."""

import hashlib
import json
import os
import re
from dataclasses import replace

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from safetensors.numpy import save as tensor_bytes

import seg
from common.labels.target_file import parse_target, shipped
from seg import ModelError, TrainSettings, inference
from seg.card import card as card_of
from seg.data.labelled import fitted
from seg.inference import _predictor, logits, predict
from seg.model import CONFIG, SHIPPED, WEIGHTS, Model, classes_of, label_classes, load_model
from seg.model import shipped as shipped_models
from seg.train import train
from tests.conftest import refused

from .conftest import assert_same, pixels, toy

SIZE = (32, 40)
COMPACT = TrainSettings(steps=2, batch=2, warmup=1, predict_batch=2)
LITE0 = replace(
    seg.RECIPES["lite0-frozen"], steps=2, warmup=1, batch=2, predict_batch=2, head_width=8
)
SETTINGS = {
    "compact": COMPACT,
    "frozen": LITE0,
    "heads": replace(LITE0, heads=2, average_mirror=True),
    "tuned": replace(LITE0, backbone="tuned", average=0.0),
}
CLASSES = label_classes(["road", "sky", "car"], ids=[7, 300, 0])


def model_of(kind: str, net: str = "compact") -> Model:
    settings, (images, labels) = SETTINGS[kind], toy(2, SIZE)
    if kind != "compact":
        settings = replace(settings, net=net)
    return Model(settings, train(0, images, labels, settings, 3), SIZE, CLASSES)


@pytest.fixture(scope="module")
def compact() -> Model:
    return model_of("compact")


@pytest.fixture
def saved(compact, tmp_path):
    compact.save(tmp_path / "model")
    return tmp_path / "model"


def test_weights_go_to_the_device_once(compact, saved, monkeypatch):
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(load_model(saved).variables))
    leaves, run = [], _predictor(COMPACT.net_spec, 1, 3, "labels")

    def noting_predictor(variables, batch):
        leaves.append(jax.tree.leaves(variables))
        return run(variables, batch)

    monkeypatch.setattr(inference, "_predictor", lambda *_: noting_predictor)
    predict(jax.tree.map(np.asarray, compact.variables), pixels(4, *SIZE, 3), COMPACT, 3)
    first, second = leaves
    assert all(a is b and isinstance(a, jax.Array) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("kind", SETTINGS)
def test_what_is_loaded_is_what_was_saved(kind, tmp_path, narrow_lite):
    model = model_of(kind, narrow_lite)
    model.save(tmp_path / "model")
    again = load_model(tmp_path / "model")
    assert_same(again.variables, model.variables)
    assert replace(again, variables=None) == replace(model, variables=None)
    assert again.digest == model.digest
    images = pixels(3, *SIZE, 3)
    predictions = again.predict(images)
    np.testing.assert_array_equal(predictions, predict(model.variables, images, model.settings, 3))
    assert predictions.dtype == np.uint8 and len(np.unique(predictions)) > 1
    names = load_file(tmp_path / "model" / WEIGHTS).keys()
    assert ("head/mean" in names) == (kind != "compact") and not any("params/" in n for n in names)
    assert any(n.startswith("backbone/") for n in names) == (kind == "tuned")
    before = (tmp_path / "model" / WEIGHTS).read_bytes()
    again.save(tmp_path / "model")  # over the older one
    assert (tmp_path / "model" / WEIGHTS).read_bytes() == before
    without_mirror = load_model(tmp_path / "model", mirror=False)
    assert not without_mirror.settings.average_mirror
    assert (without_mirror.digest == model.digest) == (kind != "heads")
    assert ("mirror image" in (tmp_path / "model" / "README.md").read_text()) == (kind == "heads")


@pytest.mark.parametrize("kind", ["frozen", "tuned"])
def test_a_model_of_format_1_is_read(kind, tmp_path, narrow_lite):
    model, folder = model_of(kind, narrow_lite), tmp_path / "model"
    model.save(folder)
    arrays = {re.sub("^backbone/", "trunk/", n): a for n, a in load_file(folder / WEIGHTS).items()}
    save_file(arrays, folder / WEIGHTS)
    text = (folder / CONFIG).read_text().replace('"backbone":', '"trunk":')
    sha256 = hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest()
    config = json.loads(text)
    config |= {"format": 1, "weights": {"file": WEIGHTS, "sha256": sha256}}
    (folder / CONFIG).write_text(json.dumps(config))
    assert_same(load_model(folder).variables, model.variables)


def test_weights_are_serialised_once(compact, tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(
        "seg.model.tensor_bytes", lambda arrays: calls.append(arrays) or tensor_bytes(arrays)
    )
    compact.save(tmp_path / "model")
    assert len(calls) == 1


def test_images_of_any_size_give_labels_of_their_own(compact):
    shapes = [(64, 80), (9, 30), (50, 20), (1, 1), (32, 40)]
    images = [pixels(*shape, 3, seed=k) for k, shape in enumerate(shapes)]
    predictions = compact.predict(images)
    assert [labels.shape for labels in predictions] == shapes
    # Twice as large: the scores of the halved image, enlarged and compared.
    halved = images[0].reshape(32, 2, 40, 2, 3).astype(float).mean(axis=(1, 3))
    canvas, shown = fitted(images[0], SIZE)
    assert shown == SIZE and np.abs(canvas - halved).max() <= 0.51
    scores = logits(compact.variables, canvas[None], COMPACT, 3)[0]
    # At the corner bilinear interpolation repeats the first pixel.
    assert (
        predictions[0][0, 0] == scores[0, 0].argmax()
        and predictions[0][-1, -1] == scores[-1, -1].argmax()
    )
    np.testing.assert_array_equal(predictions[4], compact.predict(images[4][None])[0])


def test_the_aspect_is_kept_and_the_edge_is_repeated():
    image = np.random.default_rng(0).integers(0, 256, (10, 40, 3), np.uint8)
    canvas, shown = fitted(image, SIZE)
    assert shown == (10, 40) and (canvas[:10] == image).all() and (canvas[10:] == image[9]).all()
    canvas, shown = fitted(image.swapaxes(0, 1), (40, 32))
    assert shown == (40, 10) and (canvas[:, 10:] == image.swapaxes(0, 1)[:, 9:]).all()


def test_probabilities_are_the_softmax_of_the_scores(compact):
    images = pixels(3, *SIZE, 3)
    probabilities = compact.probabilities(images)
    scores = logits(compact.variables, images, COMPACT, 3)
    expected = np.exp(scores) / np.exp(scores).sum(-1, keepdims=True)
    np.testing.assert_allclose(probabilities, expected, atol=1e-6)
    np.testing.assert_array_equal(probabilities.argmax(-1), compact.predict(images))
    (odd,) = compact.probabilities([pixels(20, 70, 3)])
    assert odd.shape == (20, 70, 3) and np.abs(odd.sum(-1) - 1).max() < 1e-5


def test_labels_can_be_kept_to_some_classes(compact):
    images = pixels(2, *SIZE, 3)
    scores = logits(compact.variables, images, COMPACT, 3)
    expected = np.where(scores[..., 2] > scores[..., 0], 2, 0)
    np.testing.assert_array_equal(compact.predict(images, among=(0, 2)), expected)
    for among in ([], [-1], [3]):
        refused(
            ValueError, r"among must be indices of classes, 0\.\.2", compact.predict, images, among
        )


def test_the_last_batch_has_the_shape_of_the_others(compact, monkeypatch):
    shapes = []

    def recorded(variables, images, *rest):
        shapes.append(images.shape)
        return logits(variables, images, *rest)

    monkeypatch.setattr("seg.model.logits", recorded)
    images = pixels(5, *SIZE, 3)
    model = replace(compact, settings=replace(COMPACT, predict_batch=4))
    np.testing.assert_array_equal(model.predict(images)[4], compact.predict(images)[4])
    assert shapes[:2] == [(4, *SIZE, 3)] * 2


def test_labels_are_painted_as_label_files_have_them(compact):
    labels = np.array([[0, 1], [2, 255]], np.uint8)
    ids = compact.painted(labels)
    assert ids.dtype == np.uint16 and ids.tolist() == [[7, 300], [0, 255]]
    mask = replace(compact, classes=label_classes("ab", ids=[0, 255]))
    assert mask.painted(labels % 2).tolist() == [[0, 255], [0, 255]]
    assert mask.painted(np.array([[0, 1, 255]], np.uint8)).tolist() == [[0, 255, 1]]  # not a class
    small = replace(compact, classes=label_classes("abc"), written="colours")
    assert small.painted(labels, "ids").dtype == np.uint8
    colours = small.painted(labels)
    # PASCAL VOC's first three.
    assert colours.tolist() == [[[128, 0, 0], [0, 128, 0]], [[128, 128, 0], [0, 0, 0]]]
    over = small.painted(labels, "overlay", np.full((2, 2, 3), 100, np.uint8))
    assert over[0, 0].tolist() == [114, 50, 50]
    with pytest.raises(ValueError, match="an overlay needs the image"):
        small.painted(labels, "overlay")


def test_classes_of_a_target_have_the_values_of_its_files():
    cityscapes = {
        label_class.name: label_class for label_class in classes_of(shipped("cityscapes"))
    }
    assert cityscapes["road"] == ("road", 7, (128, 64, 128)) and cityscapes["bicycle"].id == 33
    assert [label_class.id for label_class in classes_of(shipped("camvid"))] == list(range(11))
    text = "images: 'a/{name}'\nlabels: 'b/{name}'\nformat: colours\nclasses:\n"
    mixed = text + "  road: {colours: [[1, 2, 3]]}\n  sky: {colours: [[9, 9, 9]], ids: [0]}\n"
    assert [label_class.id for label_class in classes_of(parse_target(mixed, "x"))] == [0, 1]
    facade = classes_of(shipped("labelmefacade"))  # its files hold colours
    assert [label_class.id for label_class in facade] == list(range(6)) and facade[3].color == (
        128,
        64,
        0,
    )


@pytest.mark.parametrize(("changes", "message"), [
    ({"format": 3}, f"{CONFIG}: format is 3, and this version reads 1 to 2; upgrade sdr-jax"),
    ({"format": 0}, f"{CONFIG}: format is 0, and this version reads 1 to 2$"),
    ({"format": None}, f"{CONFIG}: format is None; expected int"),
    ({"classes": []}, f"{CONFIG}: a model has 1 to 255 classes, not 0"),
    ({"classes": [{"name": "a", "id": 1, "color": [0, 0, 0]}]}, f"{WEIGHTS}: .*: .*with 1 classes has"),
    ({"classes": [{"name": "a", "id": 1, "color": [0, 0]}]}, r"classes\[0\].color is \[0, 0\]"),
    ({"classes": [{"id": 1, "color": [0, 0, 0]}]}, rf"{CONFIG}: classes\[0\]\.name is missing"),
    ({"weights": {"file": WEIGHTS}}, rf"{CONFIG}: weights\.sha256 is missing"),
    ({"size": {"width": 4}}, rf"{CONFIG}: size\.height is missing"),
    ({"written": "words"}, f"{CONFIG}: written is 'words'; expected ids or colours"),
    ({"recipe": {"net": "compact", "stride": 2}}, r"recipe\.stride: there is no such setting"),
    ({"recipe": {"net": "compact", "lr": "high"}}, r"recipe\.lr must be a number, not 'high'"),
    ({"recipe": {"net": "compact", "norm": True, "weights": "x"}}, f"{CONFIG}: norm is for"),
    ({"recipe": {"net": "fcn8s"}}, f"{WEIGHTS}: .* of another network"),
    ({"recipe": {"net": "compact", "dtype": "half"}}, r"recipe\.dtype must be one of float32, bfloat16"),
    ({"recipe": {"net": "compact", "lr": []}}, r"recipe\.lr must be a number, not \[\]"),
    ({"recipe": {"net": "dinov2", "weights": 5}}, r"recipe\.weights must be text or None, not 5"),
    ({"recipe": {"net": "lite0", "head_width": 2**63}}, r"recipe\.head_width must be 65536 or less"),
    ({"recipe": {"net": "compact", "predict_batch": 2**63}}, f"{CONFIG}: predict_batch .* of memory"),
    ({"recipe": {"net": "compact", "dtype": "\x1b[31m"}}, r"bfloat16, not \\x1b\[31m"),
    ({"recipe": {"net": "lite0"}, "backbone": {"sha256": None}}, r"trained on the backbone None\.\.\."),
    ({"size": {"width": 2**31, "height": 2**31}}, f"{CONFIG}: size, in pixels, .* of memory"),
])  # fmt: skip
def test_a_model_that_is_not_right_is_refused_by_name(changes, message, saved):
    config = json.loads((saved / CONFIG).read_text())
    (saved / CONFIG).write_text(json.dumps({**config, **changes}))
    refused(ModelError, message, load_model, saved)


def test_its_card_is_read_by_hugging_face(tmp_path, compact):
    hub = pytest.importorskip("huggingface_hub")
    notes = {"target": "my: streets", "miou": 37.512, "reported_on": "group a", "labelled_images": 14,
             "trained_on": "labels+renders", "verdict": "Renders add 2.4 points."}  # fmt: skip
    model = replace(compact, notes=notes)
    model.save(tmp_path / "model")
    card = hub.ModelCard.load(tmp_path / "model" / "README.md")
    assert card.data.pipeline_tag == "image-segmentation" and card.data.library_name == "sdr-jax"
    [result] = card.data.eval_results
    assert (result.dataset_name, result.metric_type, result.metric_value) == (
        "my: streets", "mean_iou", 37.51,
    )  # fmt: skip
    assert "on 14 labelled images and renders, by sdr-jax" in card.text
    assert "37.5 % mIoU on images that they have not seen (group a). Renders add" in card.text
    assert all(
        f"| {label_class.id} | {label_class.name} |" in card.text for label_class in model.classes
    )
    compact.save(tmp_path / "model")  # of one that tells nothing of itself
    reloaded = hub.ModelCard.load(tmp_path / "model" / "README.md")
    assert reloaded.data.eval_results is None and "mIoU" not in reloaded.text
    shipped_model = load_model("renders19")
    assert (SHIPPED / "renders19" / "README.md").read_text() == card_of(shipped_model.config())


def test_the_model_that_comes_with_the_package_is_there_and_small():
    assert shipped_models() == ("renders19",)
    model = load_model("renders19")
    assert model.names == seg.CITYSCAPES_19.classes and model.size == (360, 480)
    assert sum(path.stat().st_size for path in (SHIPPED / "renders19").iterdir()) < 2_000_000
    sky_above_ground = np.full((88, 120, 3), (120, 120, 120), np.uint8)
    sky_above_ground[:44] = (150, 190, 240)
    (labels,) = model.predict([sky_above_ground])
    assert labels.shape == (88, 120) and labels.max() < 19


def test_text_of_others_is_plain_in_a_card(compact):
    names = ("a|b", "<img src=x>", "[x](http://e)\n# c")
    notes = {"target": "<b>\x1b[31m", "miou": "37", "reported_on": "`x`", "trained_on": "|"}
    card = card_of(replace(compact, classes=label_classes(names), notes=notes).config())
    body = card.partition("---\n")[2].partition("---\n")[2]
    assert r"| 0 | a\|b |" in body and r"| 1 | \<img src=x\> |" in body
    assert r"| 2 | \[x\](http://e) # c |" in body
    assert r"# compact for \<b\>\\x1b\[31m" in body and "\x1b" not in card
    assert "mIoU" not in body and r"on \|, by" in body


def test_damaged_files_are_refused_by_name(saved):
    refused(ModelError, "nothing is not a model: pass a folder with", load_model, saved / "nothing")
    whole = (saved / WEIGHTS).read_bytes()
    for data in (b"", whole[:-1], whole[:99] + b"x" + whole[100:]):
        (saved / WEIGHTS).write_bytes(data)
        refused(ModelError, f"{WEIGHTS}: its SHA-256 is", load_model, saved)
    (saved / WEIGHTS).unlink()
    refused(ModelError, f"{WEIGHTS}: No such file", load_model, saved)
    (saved / CONFIG).write_text("{")
    refused(ModelError, f"{CONFIG} is not a JSON file", load_model, saved)


def test_nothing_is_lost_or_half_written(saved, compact, tmp_path, full_disk):
    before = {path.name: path.read_bytes() for path in saved.iterdir()}
    with pytest.raises(OSError, match="No space left"):
        compact.save(saved)
    with pytest.raises(OSError, match="No space left"):
        compact.save(tmp_path / "new")
    assert {path.name: path.read_bytes() for path in saved.iterdir()} == before
    assert os.listdir(tmp_path) == ["model"]


def test_a_folder_of_other_files_is_left_alone(compact, tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    refused(ModelError, "holds other files, such as letter.txt", compact.save, tmp_path)
    assert os.listdir(tmp_path) == ["letter.txt"]


@pytest.mark.parametrize(("changes", "message"), [
    ({"classes": label_classes("aba")}, "two classes have the name 'a'"),
    ({"classes": label_classes("abc", ids=[1, 2, 1])}, "two classes have the id 1"),
    ({"classes": label_classes("abc", ids=[1, 2, 2**16])}, "ids of classes must be in"),
    ({"classes": label_classes("ab", colors=[(0, 0, 0)] * 2), "written": "colours"}, "the color"),
    ({"classes": label_classes("ab", colors=[(0, 0, 300)] * 2)}, r"color of a is \(0, 0, 300\)"),
    ({"size": (0, 8)}, r"size must be .* of 1 or more; got \(0, 8\)"),
    ({"settings": LITE0, "size": (31, 80)}, "of 32 or more"),
])  # fmt: skip
def test_models_that_make_no_sense(changes, message, compact):
    refused(ValueError, message, replace, compact, **changes)


def test_there_is_one_id_and_one_colour_for_each_name():
    refused(ValueError, "ids has 1 entries, but there are 2 names", label_classes, "ab", [3])
    refused(ValueError, "colors has 3 entries", label_classes, "ab", colors=[(0, 0, 0)] * 3)


def test_what_cannot_be_loaded_is_not_saved(compact, tmp_path):
    broken = jax.tree.map(lambda leaf: np.full_like(leaf, np.nan), compact.variables)
    model = replace(compact, variables=broken)
    refused(ValueError, "have values that are not finite", model.save, tmp_path / "model")
    numpy_numbers = replace(COMPACT)
    object.__setattr__(numpy_numbers, "lr", np.float32(0.5))  # tests refuse it as an argument
    replace(compact, settings=numpy_numbers).save(tmp_path / "numpy")
    assert load_model(tmp_path / "numpy").settings == replace(COMPACT, lr=0.5)


def test_the_digest_does_not_depend_on_the_path_of_weights(compact, monkeypatch):
    config = compact.config()
    digests = []
    for path in (None, "a/file", "b/file"):
        written = {**config, "recipe": {**config["recipe"], "weights": path}}
        monkeypatch.setattr(Model, "config", lambda _, written=written: written)
        digests.append(compact.digest)
    assert len({*digests}) == 1


@pytest.mark.parametrize("image", [
    np.zeros((4, 4), np.uint8), np.zeros((4, 4, 4), np.uint8), np.zeros((4, 4, 3), np.float32),
    np.zeros((0, 4, 3), np.uint8),
])  # fmt: skip
def test_what_is_no_image_is_refused(image, compact):
    none = np.zeros((0, 8, 8, 3), np.uint8)
    for method in (compact.predict, compact.probabilities):
        refused(ValueError, r"n > 0; got \[0, 8, 8, 3\]", method, none)
    refused(ValueError, r"an image must be u8\[h, w, 3\]; got ", compact.predict, [image])
