"""Workers of a Dask cluster on this machine: deaths, newcomers, files, a scheduler that goes away."""

import os
import signal
from pathlib import Path

import pytest

from common.errors import UserError
from common.workers.executors import workers_of
from common.workers.pipeline import Split
from scene.versions import picture_versions
from tests.conftest import refused
from tests.tasks import doubled, fail, gathered, ready_and, told


def test_who_dies_or_comes_changes_nothing_and_files_are_sent_to_all(dask_cluster, tmp_path):
    (tmp_path / "own" / "deep").mkdir(parents=True)
    (tmp_path / "own" / "deep" / "a").write_text("first")
    (tmp_path / "own" / "empty").write_text("")
    with workers_of("dask", 0, dask_cluster.address, {"SCENE_TEST": "yes"}) as cluster:
        assert cluster.workers == 1 and "/status" in cluster.dashboard
        name = cluster.share(str(tmp_path / "own"))
        assert name == cluster.share(str(tmp_path / "own")) and cluster.share("") == ""
        answers_by_index = {}
        for index, answer in cluster.map(told, [(name, 0.3)] * 12):
            if not answers_by_index:  # another comes, and the only one dies
                dask_cluster.start("GPU=1")
                os.kill(answer[-1], signal.SIGKILL)
            answers_by_index[index] = answer
        assert sorted(answers_by_index) == list(range(12))
        texts, roots, values, pids = zip(*answers_by_index.values(), strict=True)
        assert set(map(tuple, texts)) == {("", "first")} and set(values) == {"yes"}
        assert len(set(pids)) == len(set(roots)) == 2 and str(tmp_path / "own") not in roots
        refused(UserError, "cannot do 3", list, cluster.map(fail, [(3,)]))
        assert list(cluster.map(doubled, [(3,)])) == [(0, 6)]
        file = tmp_path / "own" / "deep" / "a"
        names = {cluster.share(str(file)) for _ in range(2)}
        file.write_text("second")  # another file by its content
        assert len(names | {cluster.share(str(file))}) == 2
    kind = "dask", 0, dask_cluster.address
    with workers_of(*kind, versions=picture_versions) as cluster:  # a worker has announced a GPU
        assert cluster.trainers == 1
        split = Split(lambda most, task: [task, task], doubled, lambda task: 0, gathered)
        alone = split._replace(many=None)
        assert dict(cluster.map(ready_and, [(3,), (4,)], net=True, split=alone)) == {
            0: (3, [6, 6]), 1: (4, [8, 8])
        }  # fmt: skip
        answers = dict(cluster.map(ready_and, [(k,) for k in range(6)], net=True, split=split))
        assert {k: answer[:2] for k, answer in answers.items()} == {
            k: (k, [2 * k, 2 * k]) for k in range(6)
        }
        assert list(cluster.map(doubled, [(3,)], net=True)) == [(0, 6)]  # by the trainer alone
        refused(UserError, "cannot do 3", list, cluster.map(ready_and, [(3,)], net=True,
                                                            split=alone._replace(render=fail)))  # fmt: skip


def test_a_scheduler_that_goes_away_ends_the_work_with_one_error(dask_cluster):
    with workers_of("dask", 0, dask_cluster.address) as cluster:
        with pytest.raises(UserError, match=r"scheduler is gone; .* the same command resumes"):
            for _ in cluster.map(told, [(str(Path(__file__).parent / "none"), 0.2)] * 50):
                dask_cluster.scheduler.kill()


@pytest.mark.parametrize(("arguments", "complaint"), [
    (("dask", 1, None), "needs --scheduler ADDRESS"),
    (("dask", 1, "tcp://127.0.0.1:9"), "--scheduler tcp://127.0.0.1:9: no Dask scheduler answers"),
    (("dask", 1, "nonsense://x"), "--scheduler nonsense://x: no Dask scheduler answers"),
    (("dask", 1, "nonsense://x:1"), "--scheduler nonsense://x:1: no Dask scheduler answers"),
    (("dask", 1, "tcp://127.0.0.1"), "--scheduler tcp://127.0.0.1: .* expected an address with a port"),
    (("dask", 1, "127.0.0.1"), "--scheduler 127.0.0.1: .* expected an address with a port"),
    (("dask", 1, "host:99999"), "--scheduler host:99999: .* expected an address with a port"),
    (("processes", 1, "tcp://127.0.0.1:9"), "--scheduler is for --executor dask"),
])  # fmt: skip
def test_what_cannot_be_reached_is_one_error(arguments, complaint, monkeypatch):
    monkeypatch.setattr("common.workers.cluster.PATIENCE", 1.0)
    refused(UserError, complaint, workers_of, *arguments)


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "common.workers.cluster", None)
    with pytest.raises(UserError, match=r"needs the extra dask: pip install 'sdr-jax\[dask\]'"):
        workers_of("dask", 1, "tcp://127.0.0.1:9")


def test_a_worker_that_makes_other_pictures_is_refused():
    cluster = pytest.importorskip("common.workers.cluster")
    versions = picture_versions()
    assert cluster._alone(picture_versions, versions, doubled, 3) == 6
    for name in ("engine", "numba", "numpy"):
        message = f"a worker of the cluster has {name} {versions[name]}, this program 0: install"
        expected = {**versions, name: 0}
        refused(UserError, message, cluster._alone, picture_versions, expected, doubled, 3)
