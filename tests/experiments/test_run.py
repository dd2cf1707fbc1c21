"""A run as the command line opens it: what its folder says, and which folders are refused."""

import json
import os
import re
import threading
import time
from dataclasses import asdict, replace
from importlib.metadata import EntryPoint
from unittest.mock import Mock

import jax
import numpy as np
import pytest

from common.errors import UserError
from common.folder import as_json
from common.workers.pool import WorkerPool
from experiments.app.main_job import RUN
from experiments.app.stores import main as merge_stores
from experiments.config import MainConfig, trainers
from experiments.config.cli import command as command_line
from experiments.config.presets import defaults
from experiments.config.trainers import trainers_of
from experiments.evaluation import compiling
from experiments.evaluation.devices import (
    Device,
    device,
    out_of_memory,
    refuse_unusable,
)
from experiments.evaluation.in_worker import trained, worker_environment
from experiments.evaluation.job import Recipe
from experiments.evaluation.made_with import made_with
from experiments.evaluation.store import read, write_store
from experiments.session import session
from scene.assets.catalogue import AssetPool
from scene.proposal import random_proposal
from scene.render import RendererError
from seg.data import LabelledImages
from seg.recipes import RECIPES
from tests.conftest import printed, refused

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
    added_fields = {"engine": session.ENGINE, "made_with": dict(made_with())}
    assert stored == as_json({**added_fields, **asdict(tiny_camvid)})


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
    assert "Resuming" not in capsys.readouterr().out
    scored_by(never)
    store = tiny_camvid.out.with_name("store.jsonl")
    assert score(replace(tiny_camvid, workers=1, store=store)) == first
    text = capsys.readouterr().out
    assert (
        "Resuming: 0 rewards and 2 other networks are done" in text and f"{store} holds 0" in text
    )


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
        other_made_with = (("backend", "gpu"), *made_with()[1:])
        monkeypatch.setattr("experiments.evaluation.made_with.made_with", lambda: other_made_with)

    return change


def test_a_run_keeps_to_its_backend_and_versions(tiny_camvid, fails, elsewhere):
    with session.open(tiny_camvid):
        stored = json.loads((tiny_camvid.out / "config.json").read_text())
    recorded = stored["made_with"]
    assert (recorded["backend"], recorded["jax"], recorded["numpy"]) == (
        "cpu",
        jax.__version__,
        np.__version__,
    )
    elsewhere()
    line = fails(tiny_camvid.out)
    assert (
        'a run with made_with.backend = "cpu", not "gpu"; restore that value to resume it' in line
    )
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
    counts = [line for line in capsys.readouterr().out.splitlines() if "holds" in line]
    assert counts[0].endswith("holds 2, 2 of them made with other backends or versions")
    assert counts[1].endswith("holds 4, 2 of them made with other backends or versions")
    runs = [str(tiny_camvid.out.with_name(name)) for name in ("a", "b")]
    merged = store.with_name("merged.jsonl")
    assert merge_stores(["merge", *runs, "--out", str(merged)]) == 0
    output = capsys.readouterr().out.splitlines()
    assert len(read(merged)) == 4 and output == [
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
    with pytest.raises(UserError, match="a worker has backend gpu, the run began with cpu: give"):
        trained(recipe, real, 0)


def test_a_worker_in_which_jax_cannot_start_says_what_helps():
    with WorkerPool(1, {"JAX_PLATFORMS": "tpu"}) as pool:  # stands for a GPU without free memory
        with pytest.raises(
            UserError, match=r"'tpu'.*memory of a GPU is full, give fewer --workers"
        ):
            next(pool.map(made_with, [()], net=True))


GPU = Device("gpu", "NVIDIA H200", 10**9)


def test_the_number_of_trainers_is_that_of_the_gpus_unless_told():
    assert [trainers_of(None, []), trainers_of(3, [])] == [None, 3]  # a CPU: in workers, or apart
    assert [trainers_of(None, ["0", "3"]), trainers_of(1, ["0", "3"])] == [2, 1]
    message = r"--trainers 2: this machine has 1 GPU \(CUDA device 5\), .*; use --trainers 1"
    refused(UserError, message, trainers_of, 2, ["5"])
    refused(UserError, "has 2 GPUs .*0, 1.*; use --trainers 2", trainers_of, 3, ["0", "1"])


def test_a_trainer_without_its_gpu_or_with_too_little_memory_is_refused():
    large = replace(FINAL, width=640, height=480, streets=2000)
    refuse_unusable(GPU, ["0"], {"final": FINAL})
    for larger in (GPU._replace(memory=None), GPU._replace(memory=10**12)):
        refuse_unusable(larger, ["0"], {"final": large})
    refuse_unusable(Device("cpu", "cpu", None), [], {"final": large})
    message = r"--final: training on \d+ images of 640x480 takes at least .* H200 offers 1 GB: use a smaller"
    refused(UserError, message, refuse_unusable, GPU, ["0"], {"reward": FINAL, "final": large})
    refused(UserError, r"cannot start CUDA although the driver lists GPU 0, 1: .*JAX_PLATFORMS=cpu",
            refuse_unusable, Device("cpu", "cpu", None), ["0", "1"], {})  # fmt: skip
    assert re.match(r"NVIDIA H200 ran out of its 1 GB of memory while training compact on images of",
                    str(out_of_memory(GPU, FINAL)))  # fmt: skip
    assert device().backend == "cpu"  # where the tests run


def test_memory_that_runs_out_is_the_users_error(monkeypatch):
    def fail(*_, **__):
        raise jax.errors.JaxRuntimeError(message)

    monkeypatch.setattr("experiments.evaluation.in_worker.train", fail)
    real = LabelledImages(np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 8), np.uint8))
    recipe = Recipe(FINAL, "camvid", "embree", AssetPool())
    message = "RESOURCE_EXHAUSTED: Out of memory while trying to allocate 3.5GiB."
    refused(UserError, "ran out of its memory while training", trained, recipe, real, 0)
    message = "INTERNAL: something else"
    refused(jax.errors.JaxRuntimeError, "something else", trained, recipe, real, 0)


@pytest.mark.parametrize(("platforms", "plugins", "expected"), [
    ("", ["xla_cuda12"], ["0"]), ("cuda,cpu", ["xla_cuda12"], ["0"]), ("cpu", ["xla_cuda12"], []),
    ("", ["rocm"], []), ("", [], []),
])  # fmt: skip
def test_gpus_count_if_jax_is_to_use_them(platforms, plugins, expected, monkeypatch):
    installed = [EntryPoint(name, "", "jax_plugins") for name in plugins]
    monkeypatch.setattr(trainers, "entry_points", lambda group: installed)
    monkeypatch.setattr(trainers, "gpus", lambda: ["0"])
    monkeypatch.setenv("JAX_PLATFORMS", platforms)
    assert trainers.usable_gpus() == expected


def test_one_process_compiles_for_a_gpu_and_others_wait(tmp_path, monkeypatch):
    environment = {compiling.VARIABLE: str(tmp_path / "xla")}
    monkeypatch.setenv(*next(iter(environment.items())))
    cpu = Recipe(FINAL, "camvid", "embree", AssetPool(), made_with=made_with())
    gpu = cpu._replace(made_with=(("backend", "gpu"), *made_with()[1:]))
    assert compiling.marker(cpu, environment) is compiling.announcement(cpu, environment) is None
    assert compiling.announcement(gpu, {}) is None
    with compiling.compiled_once(cpu):
        assert not (tmp_path / "xla").exists()
    assert compiling.announcement(gpu, environment) == (
        "Compiling compact for the GPU (once): about 25 s"
    )
    order, started, others = [], threading.Barrier(3), []

    def compile_and_train(name):
        started.wait()
        with compiling.compiled_once(gpu):
            order.append(f"{name} begins")
            time.sleep(0.2)
            order.append(f"{name} ends")

    for name in "abc":
        others.append(threading.Thread(target=compile_and_train, args=(name,)))
        others[-1].start()
    for thread in others:
        thread.join()
    first = order[0][0]
    assert order[1] == f"{first} ends"  # no other has begun
    assert compiling.announcement(gpu, environment) is None
    tuned = replace(FINAL, train=replace(RECIPES["lite0-tuned"]))
    assert "lite0 for the GPU (once): about 140 s" in compiling.announcement(
        gpu._replace(fidelity=tuned), environment
    )
    failed = gpu._replace(table="cityscapes")
    with pytest.raises(ZeroDivisionError), compiling.compiled_once(failed):
        _ = 1 / 0
    assert compiling.announcement(failed, environment) is not None  # the next compiles
    with compiling.compiled_once(failed):
        pass
    assert compiling.announcement(failed, environment) is None


@pytest.mark.parametrize(("flags", "complaint"), [
    (("--trainers", "0"), "--trainers must be 1 or more, not 0"),
    (("--trainers", "2"), "--trainers 2: this machine has 1 GPU (CUDA device 7)"),
    (("--trainers", "1", "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9"),
     "--trainers is for --executor processes; on a cluster start trainers with"),
])  # fmt: skip
def test_trainers_that_cannot_be_are_one_line(flags, complaint, out, error_line, monkeypatch):
    for module in (session, trainers):
        monkeypatch.setattr(module, "usable_gpus", lambda: ["7"])
    words = ("--preset", "smoke", "--out", str(out), *flags)
    assert command_line("cityscapes", words) == 2
    assert complaint in error_line() and not out.exists()
