"""A run as the command line opens it: what its folder says, and which folders are refused."""

import json
import os
from dataclasses import asdict, replace
from functools import partial
from unittest.mock import Mock

import jax
import numpy as np
import pytest

from common.errors import UserError
from common.folder import plain
from common.workers.pool import WorkerPool
from experiments.app.main_job import RUN
from experiments.app.stores import main as merge_stores
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.in_worker import trained, worker_environment
from experiments.evaluation.job import Recipe
from experiments.evaluation.made_with import made_with
from experiments.evaluation.mmd import train_features
from experiments.evaluation.store import read, write_store
from experiments.session import session
from scene.assets.catalogue import AssetPool
from scene.proposal import random_proposal
from scene.render import RendererError
from seg.data import LabelledImages
from tests.conftest import printed

from .conftest import formula, main_job, never, results_of
from .tasks import gradient

FINAL = defaults(MainConfig, "camvid", "smoke").final


@pytest.fixture
def fails(error_line, camvid):
    """The one line with which the CamVid job refuses a folder."""

    def line(out) -> str:
        assert main_job("camvid", "--data", str(camvid), "--out", str(out)) == 2
        return error_line(begun=True)

    return line


def test_a_folder_says_everything_needed_to_repeat_the_run(tiny_camvid):
    with session.open(tiny_camvid):
        stored = json.loads((tiny_camvid.out / "config.json").read_text())
    assert set(stored.pop("versions")) >= {"sdr-jax"} and stored.pop("version") == 1
    own = {"engine": session.ENGINE, "made_with": dict(made_with())}
    assert stored == plain({**own, **asdict(tiny_camvid)})


def test_jobs_called_from_python_set_up_their_process_like_commands(tiny_camvid, monkeypatch):
    for name in ("NPROC", "XLA_PYTHON_CLIENT_PREALLOCATE"):
        monkeypatch.setenv(name, "7")
        monkeypatch.delenv(name)
    with session.open(tiny_camvid):
        environment = worker_environment()
        for name in ("NPROC", "XLA_PYTHON_CLIENT_PREALLOCATE"):
            assert os.environ[name] == environment[name]
    monkeypatch.delenv("NPROC")
    with pytest.raises(UserError, match="--seeds"):  # before any check can start JAX
        RUN(replace(tiny_camvid, out=tiny_camvid.out / "none", seeds=0))
    assert os.environ["NPROC"] == "1"


def test_a_run_goes_on_with_other_workers_and_another_store(tiny_camvid, scored_by, capsys):
    def score(config) -> list[float]:
        with session.open(config) as run:
            run.begin([session.Work.at("final nets", 2, config.final)])
            recipe = run.recipe(config.final)
            found = results_of(run, "final", {"random": random_proposal()}, recipe, [1, 2])
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
    with session.open(tiny_camvid):
        assert "in use by another run" in fails(tiny_camvid.out)
    with session.open(replace(tiny_camvid, out=tiny_camvid.out / "other", seed=4)):
        assert "seed = 4, not 0" in fails(tiny_camvid.out / "other")
    with monkeypatch.context() as patch:
        patch.setattr(session, "ENGINE", 0)
        with session.open(replace(tiny_camvid, out=tiny_camvid.out / "old")):
            pass
    assert f"engine = 0, not {session.ENGINE}" in fails(tiny_camvid.out / "old")

    missing = RendererError("EGL is missing;\ninstall libegl1")
    monkeypatch.setattr(session, "renderer", Mock(side_effect=missing))
    assert "EGL is missing; install libegl1" in fails(tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_nets_are_the_same_in_a_worker_and_in_the_main_process():
    # Where there is more than one core.
    code = (
        "from experiments.config.cli import command\n"
        "def work(config):\n"
        "    from tests.experiments.tasks import gradient  # starts JAX\n"
        "    print(gradient())\n"
        "command('camvid', (), work)\n"
    )
    with WorkerPool(1, worker_environment()) as pool:
        ((_, found),) = pool.map(gradient, [()])
    assert printed(code)[-1] == found


@pytest.fixture
def elsewhere(monkeypatch):
    """From here on nets are made by another backend."""

    def change() -> None:
        found = (("backend", "gpu"), *made_with()[1:])
        monkeypatch.setattr("experiments.evaluation.made_with.made_with", lambda: found)

    return change


def test_a_run_keeps_to_its_backend_and_versions(tiny_camvid, fails, elsewhere):
    with session.open(tiny_camvid):
        stored = json.loads((tiny_camvid.out / "config.json").read_text())
    ours = stored["made_with"]
    assert (ours["backend"], ours["jax"], ours["numpy"]) == ("cpu", jax.__version__, np.__version__)
    elsewhere()
    line = fails(tiny_camvid.out)
    assert 'a run with made_with.backend = "cpu", not "gpu"; put that back to continue it' in line
    assert json.loads((tiny_camvid.out / "config.json").read_text()) == stored


def test_a_store_keeps_two_backends_apart(tiny_camvid, counted, elsewhere, capsys):
    store = tiny_camvid.out.with_name("store.jsonl")

    def score(out: str) -> int:
        counted.calls.clear()
        config = replace(tiny_camvid, out=tiny_camvid.out.with_name(out), store=store)
        with session.open(config) as run:
            run.begin([session.Work.at("final nets", 2, config.final)])
            recipe = run.recipe(config.final)
            results_of(run, "final", {"random": random_proposal()}, recipe, [1, 2])
        return len(counted.calls)

    assert (score("a"), score("again")) == (2, 0)
    elsewhere()
    capsys.readouterr()
    assert (score("b"), score("more")) == (2, 0)
    said = [line for line in capsys.readouterr().out.splitlines() if "holds" in line]
    assert said[0].endswith("holds 2, 2 of them made with other backends or versions")
    assert said[1].endswith("holds 4, 2 of them made with other backends or versions")
    runs = [str(tiny_camvid.out.with_name(name)) for name in ("a", "b")]
    merged = store.with_name("merged.jsonl")
    assert merge_stores(["merge", *runs, "--out", str(merged)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert len(read(merged)) == 4 and told == [
        f"{merged}: 4 evaluations",
        "Runs take only what their own backend and versions made: 2 with backend cpu; 2 with backend gpu",
    ]
    # As it was before a record said so.
    old = [record for record, _ in read(merged).values()]
    del old[0]["made_with"]
    write_store(store.with_name("old.jsonl"), old)
    assert merge_stores(["show", str(store.with_name("old.jsonl"))]) == 0
    assert "own backend and versions made: 1 with no record; 1 with" in capsys.readouterr().out


def test_a_worker_of_another_backend_is_refused(elsewhere):
    recipe = Recipe(FINAL, "camvid", "embree", AssetPool(), made_with=made_with())
    elsewhere()
    real = LabelledImages(np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 8), np.uint8))
    for work in (partial(trained, recipe, real, 0), partial(train_features, recipe)):
        with pytest.raises(
            UserError, match="a worker has backend gpu, the run began with cpu: give"
        ):
            work()


def test_a_worker_in_which_jax_cannot_start_says_what_helps():
    with WorkerPool(1, {"JAX_PLATFORMS": "tpu"}) as pool:  # stands for a GPU without free memory
        with pytest.raises(
            UserError, match=r"'tpu'.*memory of a GPU is full, give fewer --workers"
        ):
            next(pool.map(made_with, [()], net=True))
