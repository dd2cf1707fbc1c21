"""`scripts.renders19`: a net of renders alone, from exported datasets to a model that predicts."""

import numpy as np

from scene.dataset.formats.png import encode
from scene.render.__main__ import main as render
from scripts.renders19 import main
from seg.classes import CITYSCAPES_19
from seg.model import load_model

SIZE = "64x48"


def streets(out, size=SIZE, seed=0) -> str:
    flags = ["--images", "2", "--shots", "1", "--samples", "1", "--size", size, "--seed", str(seed)]
    assert render([*flags, "--workers", "0", "--asset-count", "4", "--out", str(out)]) == 0
    return str(out)


def test_a_model_of_two_datasets(tmp_path, capsys):
    sets = [streets(tmp_path / str(seed), seed=seed) for seed in (0, 1)]
    assert main([*sets, "--steps", "2", "--out", str(tmp_path / "model")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "model")
    model = load_model(tmp_path / "model")
    assert model.size == (48, 64) and model.names == CITYSCAPES_19.classes
    assert model.classes[0].id == 7  # road, as label files of Cityscapes have it
    assert model.notes["trained_on"].startswith("4 renders of engine ")
    (labels,) = model.predict([np.zeros((70, 90, 3), np.uint8)])
    assert labels.shape == (70, 90) and encode(model.painted(labels))


def test_what_cannot_be_trained_on_is_refused(tmp_path, capsys):
    words = ["--steps", "2", "--out", str(tmp_path / "model")]
    assert main([str(tmp_path), *words]) == 2
    sets = [streets(tmp_path / size, size) for size in (SIZE, "80x48")]
    assert main([*sets, *words]) == 2
    assert main([sets[0], "--steps", "0", "--out", str(tmp_path / "model")]) == 2
    lines = capsys.readouterr().err.splitlines()
    expected = ("not a dataset, since it has no dataset.json", "80x48: 80x48 pixels, but", "steps")
    assert len(lines) == 3 and all(part in line for part, line in zip(expected, lines, strict=True))
    assert not (tmp_path / "model").exists()
