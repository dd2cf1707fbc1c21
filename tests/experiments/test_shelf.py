"""Files that a run's processes share: the same outcomes with them, whole or not there, nobody else's."""

import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from experiments.config import Fidelity
from experiments.reward import shelf
from experiments.reward.evaluator import Evaluator, Job, Memory, about
from experiments.reward.miou import Recipe, evaluate_miou, worker_environment
from experiments.reward.shelf import ABOUT, FOLDER, Shelf
from experiments.reward.store import Log, outcome_of
from experiments.reward.truth import loaded, part_of
from scene.assets.catalogue import AssetPool
from scene.proposal import default_proposal
from scene.workers import WorkerPool
from seg import pyramid
from seg.data import LabelledImages
from seg.recipes import RECIPES
from seg.views import view_images
from shell.errors import UserError
from shell.files import read_json, write_json

from .conftest import POOL, Counted, Killed, never, target_of

TRAIN = replace(RECIPES["lite0-frozen"], steps=2, batch=2, scale=True)
RECIPE = Recipe(Fidelity(64, 48, 1, 2, samples=1, train=TRAIN), "camvid", "embree", AssetPool(0, 2))
COUNT = 25  # two tasks, of 16 and 9


def noise(count: int, seed: int) -> LabelledImages:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (count, 48, 64, 3), dtype=np.uint8)
    return LabelledImages(images, rng.integers(0, 11, (count, 48, 64), dtype=np.uint8))


REAL, TEST = noise(COUNT, 0), noise(3, 1)
TARGET = target_of(REAL, TEST)


def outcomes(held: Shelf, log: Path, recipe: Recipe = RECIPE) -> list[tuple]:
    """Keys and scores of two nets that are trained on the reward images."""
    scorer = Evaluator(recipe, TARGET, "test", TEST, held)
    found = dict(scorer.map([Job(REAL, 5, {}), Job(REAL, 6, {})], Memory(Log(log), None, float)))
    return [(scorer.key(REAL, 5 + k), found[k].reward, found[k].class_iou) for k in range(2)]


@pytest.fixture
def opened(tmp_path):
    """Opens the run's files, as a new run does."""
    return lambda: Shelf(POOL, tmp_path / "run")


def same(ours, theirs) -> bool:
    return all(map(np.array_equal, ours, theirs))


def test_parts_are_scored_each_for_itself(opened, tmp_path):
    def scorer(*parts):
        return Evaluator(RECIPE, TARGET, "test", TEST, opened(), *parts)

    log, jobs = Log(tmp_path / "log"), [Job(REAL, 5, {})]
    ((_, found),) = scorer(((0, 2), (2, 3))).map(jobs, Memory(log, None, float))
    whole = evaluate_miou(RECIPE, REAL, 5, TEST)
    each = [evaluate_miou(RECIPE, REAL, 5, TEST.between(*part)).reward for part in ((0, 2), (2, 3))]
    assert (found.reward, found.class_iou) == (whole.reward, whole.class_iou)
    assert found.parts == pytest.approx(each) and whole.parts == () and each[0] != each[1]
    key = scorer().key(REAL, 5)  # parts are only reported: they do not name the evaluation
    assert scorer(((0, 2), (2, 3))).key(REAL, 5) == scorer(((0, 3),)).key(REAL, 5) == key
    assert outcome_of(log.get(key)) == found._replace(stored=True)


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_outcomes_and_keys_are_those_of_arrays(workers, tmp_path):
    plain, told = outcomes(Shelf(POOL), tmp_path / "plain"), []
    assert plain[0][1] == evaluate_miou(RECIPE, REAL, 5, TEST).reward != plain[1][1]
    with WorkerPool(workers, worker_environment()) as pool:
        held = Shelf(pool, tmp_path / "run", told.append)
        assert outcomes(held, tmp_path / "log") == plain
        # A single set is rendered by all workers, and the same.
        streets, two = default_proposal(), replace(RECIPE.fidelity, streets=2)
        recipe = RECIPE._replace(fidelity=two)
        scorer = Evaluator(recipe, TARGET, "test", TEST, held)
        memory = Memory(Log(tmp_path / "log"), None, float)
        ((_, found),) = scorer.map([Job(streets, 5, {})], memory)
        alone = evaluate_miou(recipe, streets, 5, TEST)
        assert (found.reward, found.class_iou) == (alone.reward, alone.class_iou)
    done = [line.rpartition(": ")[2] for line in told]
    assert done[0] == "3 of 3" and done[2:] == ["25 of 25"]


def test_features_are_computed_once_for_all_nets_of_a_run(opened, tmp_path, monkeypatch):
    plain = outcomes(Shelf(POOL), tmp_path / "plain")
    opened().put(TEST, TRAIN)
    real = loaded(opened().put(REAL, TRAIN, training=True))
    assert same(real.features, pyramid.features(view_images(REAL.images, TRAIN)))
    part = part_of(real, np.array([3, 17, 24]))
    assert same(part.features, pyramid.features(view_images(part.images, TRAIN)))
    for module in (pyramid, shelf):
        monkeypatch.setattr(module, "features", never)
    assert outcomes(opened(), tmp_path / "log") == plain
    with pytest.raises(AssertionError, match="known"):
        outcomes(Shelf(POOL), tmp_path / "other")


def test_a_killed_run_leaves_nothing_that_is_trusted(opened, tmp_path, full_disk, monkeypatch):
    folder, whole = tmp_path / "run" / FOLDER, pyramid.features(REAL.images)
    with pytest.raises(OSError, match="No space left") as caught:
        opened().put(REAL, TRAIN)
    assert Path(caught.value.filename).parent == folder and not list(folder.iterdir())
    monkeypatch.undo()
    with monkeypatch.context() as patch:
        patch.setattr(shelf, "_features_of", Counted(shelf._features_of, 1))
        with pytest.raises(Killed):
            opened().put(REAL, TRAIN)
    (images,) = folder.iterdir()
    first = opened().put(REAL, TRAIN)
    assert first.images == str(images) and same(first.load().features, whole)
    # Half of a folder after a kill that nothing catches; files that a user has removed.
    shutil.copytree(first.features, first.features + ".part")
    for name in ("images.npy", ABOUT):
        (images / name).unlink()
        assert opened().put(REAL, TRAIN) == first and (images / name).exists()
    (Path(first.features) / "eighth.npy").unlink()
    assert opened().put(REAL, TRAIN) == first and len(list(folder.iterdir())) == 2
    assert np.array_equal(np.load(Path(first.features) / "eighth.npy"), whole.eighth)


@pytest.mark.parametrize(("part", "name", "change", "complaint"), [
    ("features", ABOUT, {"trunk": "0" * 64}, "is of other trunk, '000"),
    ("features", ABOUT, {"images": "ff"}, "is of other images, 'ff' and not"),
    ("images", ABOUT, {"files": 1}, "is damaged"),
    ("features", "sixteenth.npy", b"\x01", "is damaged"),
    ("images", "labels.npy", b"", "is damaged"),
])  # fmt: skip
def test_files_of_others_and_damaged_ones_are_refused(part, name, change, complaint, opened):
    path = Path(getattr(opened().put(TEST, TRAIN), part)) / name
    if name == ABOUT:
        write_json(path, read_json(path) | change)
    else:
        path.write_bytes(path.read_bytes()[:-1] + change)
    with pytest.raises(UserError) as caught:
        opened().put(TEST, TRAIN)
    said = str(caught.value)
    assert str(path) in said and complaint in said and f"remove {path.parent}" in said


def test_a_command_ends_with_exit_code_2(command, learnt_file, tmp_path, error_line):
    run = tmp_path / "run"
    asked = ("table", run, "--learnt", str(learnt_file), "--nets", "lite0")
    assert command(*asked) == 0
    for path in (run / FOLDER).glob(f"*-*/{ABOUT}"):
        write_json(path, read_json(path) | {"trunk": "0"})
    (run / "finals.jsonl").unlink()
    assert command(*asked) == 2 and "is of other trunk" in error_line(begun=True)


def test_heads_may_normalise_by_the_images_that_give_the_reward(opened, tmp_path):
    train = replace(TRAIN, head_statistics="target")
    own = RECIPE._replace(fidelity=replace(RECIPE.fidelity, train=train))
    targets = TARGET, target_of(noise(COUNT, 2), TEST)
    names = [about(r, t, "test", TEST)["config"] for r, t in product((RECIPE, own), targets)]
    assert names[0] == names[1] and len(set(names)) == 3
    found = outcomes(opened(), tmp_path / "files", own)
    assert found == outcomes(Shelf(POOL), tmp_path / "arrays", own)
    own = own._replace(statistics=pyramid.channel_statistics(pyramid.features(REAL.images)))
    assert found[0][1] == evaluate_miou(own, REAL, 5, TEST).reward
