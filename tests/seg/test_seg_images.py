"""Decoding of single image and label files, and folders of photographs without labels."""

import numpy as np
import pytest
from PIL import Image

from common.labels.target_file import shipped
from seg.data import LabelReader
from seg.data.images import read_header, read_image
from tests.conftest import packed_png

from .conftest import pixels, refuses_file, write_label

read_camvid_label = LabelReader(shipped("camvid"))


@pytest.mark.parametrize(("mode", "colour"), [
    ("RGB", (250, 10, 20)), *((mode, (102, 102, 102)) for mode in ("L", "LA", "RGBA", "P")),
])  # fmt: skip
def test_images_become_rgb(tmp_path, mode, colour):
    path = tmp_path / "image.png"
    Image.new("RGB", (3, 2), colour).convert(mode).save(path)
    image = read_image(path)
    assert image.shape == (2, 3, 3) and image.dtype == np.uint8 and (image == colour).all()


@pytest.mark.parametrize("kind", ["png", "tif"])
def test_photographs_are_turned_as_their_orientation_says(kind, tmp_path):
    path, lying = tmp_path / f"image.{kind}", pixels(4, 6, 3)
    exif = Image.Exif()
    exif[0x112] = 6  # the top is at the right
    Image.fromarray(lying.astype(np.uint8)).save(path, exif=exif)
    np.testing.assert_array_equal(read_image(path), np.rot90(lying, -1))
    assert read_header(path) == ((6, 4), 6) and read_header(path).size == (4, 6)


def test_an_orientation_that_is_no_number_turns_nothing(tmp_path):
    path = tmp_path / "image.png"
    text = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x02\0\0\0\x04abc\0\0\0\0\0"  # "abc" as text
    Image.fromarray(pixels(4, 6, 3).astype(np.uint8)).save(path, exif=text)
    assert read_header(path).size == (6, 4) and read_image(path).shape == (4, 6, 3)


def test_labels_of_8_and_16_bits_and_of_palettes_keep_their_ids(tmp_path):
    path, ids = tmp_path / "label.png", np.array([[0, 3, 10], [11, 5, 1]])
    for dtype in (np.uint8, np.uint16):
        write_label(path, ids, dtype)
        np.testing.assert_array_equal(read_camvid_label(path), np.where(ids == 11, 255, ids))
    picture = Image.fromarray(ids.astype(np.uint8)).convert("P")
    picture.putdata(ids.ravel().tolist())
    picture.putpalette(np.random.default_rng(0).integers(0, 256, 768).tolist())
    picture.save(path)
    assert Image.open(path).mode == "P"
    np.testing.assert_array_equal(read_camvid_label(path), [[0, 3, 10], [255, 5, 1]])


@pytest.mark.parametrize("colour_type", [0, 3], ids=["grey", "palette"])
@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_labels_of_few_bits_keep_their_ids(tmp_path, bits, colour_type):
    ids = np.array([[0, 1, 1, 0, 1], [1, 0, 0, 0, 1]]) * min(2**bits - 1, 10)
    (path := tmp_path / "label.png").write_bytes(packed_png(ids, bits, colour_type))
    np.testing.assert_array_equal(read_camvid_label(path), ids)


@pytest.mark.parametrize(("mode", "extension", "keep"), [
    *(("RGB", extension, keep) for extension in ("png", "jpg") for keep in (0.0, 0.5, 0.9)),
    *((mode, "png", 0.5) for mode in ("L", "P", "I;16")),
])  # fmt: skip
def test_truncated_files(tmp_path, mode, extension, keep):
    path = tmp_path / f"image.{extension}"
    noise = pixels(40, 50, *(3,) * (mode == "RGB"), below=12)
    picture = Image.fromarray(noise.astype(np.uint16 if mode == "I;16" else np.uint8))
    (picture if picture.mode == mode else picture.convert(mode)).save(path)
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    read = read_image if mode == "RGB" else read_camvid_label
    refuses_file(rf"image\.{extension}: not a readable image", read, path)


@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
def test_files_that_are_no_images_and_labels_in_colours(tmp_path, mode):
    path = tmp_path / "label.png"
    Image.new(mode, (3, 2), (1, 2, 3)).save(path)
    refuses_file(
        rf"label\.png: a label in colours .mode {mode}.*one channel", read_camvid_label, path
    )
    path.write_text("not an image")
    for read in (read_image, read_header, read_camvid_label):
        refuses_file(
            r"label\.png: not a readable image, broken or truncated \([a-z ]+\)", read, path
        )
        refuses_file(r"gone\.png: cannot be read \(No such file", read, tmp_path / "gone.png")


def test_jpegs_may_have_bytes_after_their_end(tmp_path):
    path = tmp_path / "image.jpg"
    Image.new("RGB", (9, 7), (40, 50, 60)).save(path)
    path.write_bytes(path.read_bytes() + b"camera notes")
    assert read_image(path).shape == (7, 9, 3)
