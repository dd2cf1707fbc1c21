"""Files of unknown origin: no code of theirs runs, no size of theirs is believed, no path leads out."""

import io
import json
import pickle
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from common.errors import UserError
from common.files import read_json
from common.labels.target_file import shipped
from scene.dataset.formats.png import read_png
from scene.dataset.read import describe
from scene.dataset.real import open_images
from seg.data import LabelReader, list_split
from seg.data.images import read_header, read_image
from seg.weights.read import read
from tests.conftest import png_chunk, refused


def bomb(width: int, height: int) -> bytes:
    """A PNG that says it has so many grey pixels, in some dozen bytes."""
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    rows = png_chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    return b"\x89PNG\r\n\x1a\n" + header + rows + png_chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(7100, 7100), (100_000, 100_000), (2**31 - 1, 2**31 - 1)])
def test_a_picture_that_says_it_is_huge_is_not_decoded(size, tmp_path, monkeypatch):
    path = tmp_path / "train" / "1.png"
    path.parent.mkdir()
    (tmp_path / "trainannot").mkdir()
    path.write_bytes(bomb(*size))
    monkeypatch.setattr("cv2.imdecode", None)
    labels, pairs = LabelReader(shipped("camvid")), open_images(tmp_path).pairs
    for reader in (read_image, read_header, labels, read_png, lambda _: next(pairs)):
        refused(ValueError, r"1\.png: .*more than 50,000,000 pixels", reader, path)


@pytest.mark.parametrize("name", ["../../secret.png", "train/../../secret.png"])
def test_a_list_of_images_does_not_lead_out_of_its_folder(name, tmp_path):
    (tmp_path / "train.txt").write_text(f"train/a.png trainannot/a.png\n{name} {name}\n")
    for part in ("train", "trainannot"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "a.png").write_bytes(bomb(1, 1))
    refused(
        UserError,
        rf"train\.txt, line 2: {name} is outside ",
        list_split,
        shipped("camvid"),
        tmp_path,
        "train",
    )
    (tmp_path / "train.txt").write_text(f"\n../{name}\n")
    message = rf"train\.txt, line 2: \.\./{name} is outside "
    refused(UserError, message, list_split, shipped("labelmefacade"), tmp_path, "train")


def header(shape: tuple[int, ...], descr: str = "<f4") -> bytes:
    file = io.BytesIO()
    about = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue()


@pytest.mark.parametrize(("content", "message"), [
    (header((10**12,)), "says .*, and is cut short"),
    (header((600,)) + bytes(2400), "2,528 bytes of arrays; VGG16 has"),
    (header((1,), "|O") + pickle.dumps([print]), "not of plain arrays"),
])  # fmt: skip
def test_arrays_are_no_larger_than_their_file_and_no_objects(
    content, message, tmp_path, monkeypatch
):
    monkeypatch.setattr("seg.weights.read.LARGEST", 2000)
    path = tmp_path / "w.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("a.npy", content)
    refused(UserError, rf"w\.npz: .*{message}", read, path)


def nested(depth: int) -> bytes:
    """A tuple of twice the tuple before, as a key: its hash takes 2^depth steps."""
    start = b"\x80\x02ccollections\nOrderedDict\n)R)q\x00"
    return start + b"h\x00h\x00\x86q\x00" * depth + b"K\x01s."


def test_a_pickle_cannot_keep_us_busy_or_share_its_bytes(tmp_path):
    path = tmp_path / "w.pth"
    for storage, message in (("data", "a tuple as a name"), ("shared", "share their bytes")):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("w/data.pkl", nested(64))
            archive.writestr("w/data/0", bytes(1000))
        if storage == "shared":
            data = bytearray(path.read_bytes())
            at = data.rfind(b"PK\x01\x02")
            data[at + 20 : at + 28] = struct.pack("<II", 10**9, 10**9)
            path.write_bytes(data)
        refused(UserError, message, read, path)


def test_json_without_end_and_datasets_of_trillions(tmp_path, monkeypatch):
    monkeypatch.setattr("common.files.LARGEST", 1000)
    refused(UserError, "/dev/zero has more than 1,000 bytes", read_json, Path("/dev/zero"))
    told = {"images": 10**12, "shots": 1, "render": {"width": 8, "height": 8}}
    (tmp_path / "dataset.json").write_text(json.dumps({**told, "format": "coco", "split": "val"}))
    refused(ValueError, "does not describe a dataset: format, split, images", describe, tmp_path)
