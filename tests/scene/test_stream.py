"""Streams: the images of an export without files, from any index, with any number of workers."""

import os
import subprocess
import sys
from itertools import islice
from pathlib import Path

import msgspec
import numpy as np
import pytest

import scene
from common.labels.target_file import find_target
from common.workers.pool import WorkerError, WorkerPool
from scene import AssetPool, RenderSettings, export_dataset, stream
from scene.dataset.export import read_dataset
from scene.proposal import draw, random_proposal
from tests.scene.conftest import refused
from tests.tasks import die_until

SETTINGS = RenderSettings(width=64, height=48)
OPTIONS = {"shots": 2, "settings": SETTINGS, "pool": AssetPool(0, 3)}
SEED, STREETS = 7, 3
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stream") / "dataset"
    units = draw(random_proposal(), SEED, STREETS)
    export_dataset(units, SEED, folder, format="folders", target="camvid", **OPTIONS)
    return units, read_dataset(folder)


@pytest.mark.parametrize(("start", "workers"), [(0, 0), (0, 1), (3, 0), (4, 1)])
def test_each_image_is_that_of_an_export_with_its_street(start, workers, exported):
    units, dataset = exported
    samples = stream("random", SEED, start=start, workers=workers, target="camvid", **OPTIONS)
    for k, sample in enumerate(islice(samples, 6 - start), start=start):
        np.testing.assert_array_equal(sample.image, dataset.images[k])
        np.testing.assert_array_equal(sample.label, dataset.labels[k])
        np.testing.assert_array_equal(sample.street, units[k // 2])
    samples.close()


def test_without_a_target_labels_are_train_ids_and_a_number_of_images_is_the_end():
    [sample] = scene.stream(random_proposal(), SEED, images=1, **OPTIONS)
    exact = msgspec.structs.replace(find_target("camvid"), outlines={})
    [other] = scene.stream(random_proposal(), SEED, images=1, target=exact, **OPTIONS)
    np.testing.assert_array_equal(np.array(exact.of_engine, np.uint8)[sample.label], other.label)
    assert list(stream("random", images=0, **OPTIONS)) == []


@pytest.mark.parametrize(("changes", "message"), [
    ({"start": -1}, "start must be 0 or more, not -1"), ({"shots": 0}, "shots per street must be 1"),
    ({"streets": "nowhere.json"}, "nowhere.json"), ({"target": "nowhere"}, "no such file"),
    ({"settings": SETTINGS._replace(width=0)}, "too small"), ({"seed": -3}, "seed must lie in 0"),
])  # fmt: skip
def test_bad_arguments_are_refused_before_the_first_image(changes, message):
    refused((ValueError, OSError), message, stream, **{"streets": "random", **OPTIONS, **changes})


def test_streets_are_drawn_from_any_of_them_on():
    dataset = draw(random_proposal(), 3, 9)
    np.testing.assert_array_equal(draw(random_proposal(), 3, 4, start=5), dataset[5:])


def test_endless_tasks_come_in_order_and_one_death_of_a_worker_is_survived(tmp_path):
    def tasks(name, deaths):
        k = 0
        while True:
            yield str(tmp_path / name), deaths, k
            k += 1

    with WorkerPool(2) as pool:
        results = pool.in_order(die_until, tasks("once", 1))
        assert list(islice(results, 8)) == [k * k for k in range(8)]
        results.close()
        refused(WorkerError, "died twice", list, pool.in_order(die_until, tasks("always", 9)))
        assert list(pool.in_order(die_until, [(str(tmp_path / "once"), 1, 4)])) == [16]


UNGUARDED = """
import scene
found = scene.stream("random", 0, images=1, workers=2, settings=scene.RenderSettings(64, 48))
print(len(list(found)))
"""


def test_workers_without_a_main_guard_are_explained_at_once(tmp_path):
    script = tmp_path / "unguarded.py"
    script.write_text(UNGUARDED)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True
    )
    assert ran.returncode == 1 and ran.stdout == ""
    assert ran.stderr.count("Traceback") == 1  # the script's own
    last = ran.stderr.splitlines()[-1]
    assert 'if __name__ == "__main__":' in last and "died" not in ran.stderr
