"""Whatever flags and files say, a command ends well or with one error: never with a traceback.

``ROBUST_EXAMPLES`` says how many of each kind are made; `make robust` says 500.
"""

import contextlib
import io
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints
from unittest.mock import patch

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import UserError
from common.labels.target_file import shipped
from experiments.app.main_job import MAIN
from experiments.config import MainConfig, cli
from experiments.tables.skeleton import check
from scene import AssetPool, sample_street, street_params
from scene.attributes import NAMES
from scene.mesh.bombs import MeshError
from scene.mesh.file import SUFFIXES, read_mesh
from scene.proposal import Histogram, default_proposal, describe
from scene.render import __main__ as render
from sdr_jax.tune import __main__ as tune
from sdr_jax.tune import search
from seg.data import LabelReader
from seg.data.images import read_image
from seg.weights import convert
from tests.robustness.conftest import EXAMPLE
from tests.robustness.test_untrusted import bomb
from tests.seg.test_seg_weights import SAVERS

EXAMPLES = int(os.environ.get("ROBUST_EXAMPLES", "15"))
many = settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck), deadline=None)
WORD = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
NUMBER = st.one_of(st.integers(-3, 40), st.integers(-(10**20), 10**20), st.floats())
VALUE = NUMBER.map(str) | st.sampled_from(["True", "False", "None", "all", "../x", "/"]) | WORD


def flags_of(kind: Any, prefix: str = "--") -> Iterator[str]:
    """Every flag of a configuration."""
    for field in fields(kind):
        inner, name = get_type_hints(kind)[field.name], field.name.replace("_", "-")
        if is_dataclass(inner):
            yield from flags_of(inner, f"{prefix}{name}.")
        elif field.name not in ("target", "out"):
            yield f"{prefix}{name}"


FLAG = st.tuples(st.sampled_from([*flags_of(MainConfig)]), VALUE).map("=".join)


@pytest.fixture
def counted(tally):
    return lambda kind: tally(f"made at random: {kind}").attempt()


def ends_well(command: Any, *arguments: Any, **options: Any) -> None:
    """A command ends with code 0, or with 2 and no traceback."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            code = command(*arguments, **options)
        except SystemExit as end:  # of the parser
            code = end.code
    assert code in (0, 2) and "Traceback" not in said.getvalue(), said.getvalue()


@many
@given(flags=st.lists(FLAG, min_size=1, max_size=4))
def test_flags(flags, counted, tmp_path):
    words = ["--preset", "smoke", "--out", str(tmp_path / "run"), *flags]
    with counted("flags"):
        ends_well(cli.command, "cityscapes", words, partial(check, MAIN))


BAD = st.sampled_from([b"9" * 15, b"-1", b"\xff" * 8, b"nan", b"../../x", b"{["])


@st.composite
def damaged(draw_: Any, data: bytes) -> bytes:
    """Bytes with some changed, cut off, doubled, or replaced by a large number."""
    found = bytearray(data)
    for _ in range(draw_(st.integers(1, 4))):
        at = draw_(st.integers(0, max(len(found) - 1, 0)))
        found[at : at + draw_(st.integers(0, 8))] = draw_(st.binary(max_size=8) | BAD)
    return bytes(found[: draw_(st.integers(0, len(found)))] if draw_(st.booleans()) else found)


LINE = st.tuples(
    st.sampled_from(["bins", "low", "high", "log", "values", "groups", "method", "evaluations", "repeats",
                     "datasets_per_update", "relaxation", "minimize", "timeout_seconds", "workers", "x"]),
    st.one_of(NUMBER.map(str), st.sampled_from(["true", '"tpe"', '["a", "b"]', "[]", '[["speed"]]', "{}"])),
)  # fmt: skip
LINES = st.lists(LINE.map("{0[0]} = {0[1]}\n".format), max_size=3).map("".join).map(str.encode)
SPACE = st.just(b'[[attributes]]\nname = "speed"\n') | damaged(
    (EXAMPLE / "space.toml").read_bytes()
)
ANSWER = {"solution": {}, "spread": {}, "evaluations": 1, "method": "", "failed": 0, "mean_score": 0.0,
          "best": {"score": 0.0}}  # fmt: skip


@many
@given(text=st.tuples(LINES, SPACE, LINES).map(b"".join))
def test_spaces(text, counted, tmp_path):
    path = tmp_path / "space.toml"
    path.write_bytes(text)
    only_read = patch.object(search, "tune", lambda read, *_, **__: read.space() and ANSWER)
    with counted("spaces"), only_read:
        words = [str(path), "--out", str(tmp_path / "o"), "--", "true", "{attributes.json}"]
        ends_well(tune.main, words)


@many
@given(st.lists(st.floats(width=32), min_size=22, max_size=24), st.booleans())
def test_attribute_vectors(counted, values, inside):
    units = np.abs(np.nan_to_num(values)) % 1 if inside else np.array(values)
    with counted("attribute vectors"):
        try:
            sample_street(street_params(units), 0, 1, AssetPool(0, 1))
        except ValueError:
            assert not (inside and len(units) == 23)


KEYS = st.sampled_from(["unit", "centre", "width", "share", "attributes", "probabilities"])
ENTRY = st.recursive(
    st.none() | st.booleans() | NUMBER | WORD,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner),
    max_leaves=6,
)
OWN = st.dictionaries(st.sampled_from(NAMES), ENTRY).map(dict.fromkeys(NAMES, 0.5).__or__)
FILE = (OWN | st.fixed_dictionaries({"components": ENTRY})).map(json.dumps).map(str.encode)
EVEN = Histogram(np.full((len(NAMES), 4), 0.25, np.float32))
ROWS, BINS = (json.dumps(describe(own)).encode() for own in (default_proposal(), EVEN))


@many
@given(text=damaged(ROWS) | damaged(BINS) | FILE)
def test_attribute_files(text, counted, tmp_path):
    path = tmp_path / "attributes.json"
    path.write_bytes(text)
    with counted("attributes.json"), patch.object(render, "export_dataset") as made:
        made.return_value = {"images": 1, "streets": []}
        ends_well(render.main, ["--attributes", str(path), "--out", str(tmp_path / "o")])


def pictures() -> list[bytes]:
    grey = np.random.default_rng(0).integers(0, 12, (9, 7)).astype(np.uint8)
    planes = (grey, np.dstack([grey] * 3), grey.astype("u2"))
    encoded = (cv2.imencode(".jpg", grey), *(cv2.imencode(".png", plane) for plane in planes))
    return [bomb(5, 5), *(data.tobytes() for _, data in encoded)]


@many
@given(data=st.one_of(*map(damaged, pictures()), st.binary(max_size=64)))
def test_images_and_labels(data, counted, tmp_path):
    path = tmp_path / "x.png"
    path.write_bytes(data)
    with counted("label files"):
        for read in (read_image, LabelReader(shipped("camvid"))):
            with contextlib.suppress(UserError):
                read(path)


def mesh_bytes(suffix: str) -> bytes:
    box = trimesh.creation.box((4, 1.8, 1.5))
    if suffix == ".gltf":
        return box.scene().export(file_type="gltf", merge_buffers=True)["model.gltf"]
    data = box.export(file_type=suffix[1:])
    return data.encode() if isinstance(data, str) else data


@many
@given(made=st.one_of(*(st.tuples(st.just(s), damaged(mesh_bytes(s))) for s in SUFFIXES)))
def test_meshes(made, counted, tmp_path):
    suffix, data = made
    path = tmp_path / f"x{suffix}"
    path.write_bytes(data)
    with counted("mesh files"), contextlib.suppress(MeshError):
        read_mesh(path)


def weights() -> Iterator[bytes]:
    arrays = {"features.0.weight": np.ones((2, 3), np.float32), "b": np.zeros(3, np.float32)}
    with tempfile.TemporaryDirectory() as folder:
        for name, save in SAVERS.items():
            save(Path(folder, name), arrays)
            yield Path(folder, name).read_bytes()


@many
@given(data=st.one_of(*map(damaged, weights())))
def test_weights(data, counted, tmp_path):
    path = tmp_path / "w"
    path.write_bytes(data)
    with counted("weight files"), pytest.raises(UserError):  # too few layers, if nothing else
        convert(path, tmp_path / "o.npz")
