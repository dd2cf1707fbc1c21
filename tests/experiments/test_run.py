"""A run as the command line opens it: what its folder says, and which folders are refused."""

import json
from dataclasses import asdict, replace
from unittest.mock import Mock

import pytest

from experiments.run import context
from experiments.run.nets import score_nets
from scene.proposal import random_proposal
from scene.render import RendererError
from shell.folder import plain

from .conftest import formula, main_job, never


@pytest.fixture
def fails(error_line, camvid):
    """The one line with which the CamVid job refuses a folder."""

    def line(out) -> str:
        assert main_job("camvid", "--data", str(camvid), "--out", str(out)) == 2
        return error_line(begun=True)

    return line


def test_a_folder_says_everything_needed_to_repeat_the_run(tiny_camvid):
    with context.opened(tiny_camvid):
        stored = json.loads((tiny_camvid.out / "config.json").read_text())
    assert set(stored.pop("versions")) >= {"jax", "numpy", "sdr-jax"}
    assert stored == plain({"engine": context.ENGINE, **asdict(tiny_camvid)})


def test_a_run_goes_on_with_other_workers_and_another_store(tiny_camvid, scored_by, capsys):
    def score(config) -> list[float]:
        with context.opened(config) as run:
            run.begin([context.Work.at("final nets", 2, config.final)])
            recipe = run.recipe(config.final)
            found = score_nets(run, "final", {"random": random_proposal()}, recipe, [1, 2])
            return [outcome.reward for outcome in found["random"]]

    scored_by(formula)
    first = score(tiny_camvid)
    assert "Continuing" not in capsys.readouterr().out
    scored_by(never)
    store = tiny_camvid.out.with_name("store.jsonl")
    assert score(replace(tiny_camvid, workers=1, store=store)) == first
    text = capsys.readouterr().out
    assert "Continuing: 0 rewards and 2 other nets are done" in text and f"{store} holds 0" in text


def test_a_folder_in_use_and_a_missing_renderer(fails, tiny_camvid, camvid, monkeypatch, tmp_path):
    assert "is a file; it must be a folder" in fails(camvid / "train" / "A_1.png")
    with context.opened(tiny_camvid):
        assert "in use by another run" in fails(tiny_camvid.out)
    with context.opened(replace(tiny_camvid, out=tiny_camvid.out / "other", seed=4)):
        assert "seed = 4, not 0" in fails(tiny_camvid.out / "other")
    with monkeypatch.context() as patch:
        patch.setattr(context, "ENGINE", 0)
        with context.opened(replace(tiny_camvid, out=tiny_camvid.out / "old")):
            pass
    assert f"engine = 0, not {context.ENGINE}" in fails(tiny_camvid.out / "old")

    missing = RendererError("EGL is missing;\ninstall libegl1")
    monkeypatch.setattr(context, "renderer", Mock(side_effect=missing))
    assert "EGL is missing; install libegl1" in fails(tmp_path / "new")
    assert not (tmp_path / "new").exists()
