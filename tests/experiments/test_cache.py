"""Files that a run's processes share: the same outcomes with them, whole or not there, nobody else's."""

import shutil
import time
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.errors import UserError
from common.files import read_json, write_json
from common.labels.target_file import shipped
from common.workers.pool import WorkerPool
from experiments.config import Fidelity
from experiments.config.limits import training_bytes
from experiments.evaluation import cache, in_worker, renders
from experiments.evaluation.cache import ABOUT, FOLDER, Cache
from experiments.evaluation.cached import loaded
from experiments.evaluation.cost import head_cost
from experiments.evaluation.in_worker import attempt, evaluate_miou, parts_of, worker_environment
from experiments.evaluation.job import Job, Recipe, Result
from experiments.evaluation.renders import render_part
from experiments.evaluation.runner import Runner, about
from scene.assets.catalogue import AssetPool
from scene.proposal import default_proposal, draw
from seg import pyramid
from seg.classes import table_text
from seg.data import LabelledImages
from seg.mixing import TrainingSet
from seg.recipes import RECIPES
from seg.train import TrainingError
from seg.views import view_images

from .conftest import POOL, Counted, Killed, never, runner_of, target_of

TRAIN = replace(RECIPES["lite0-frozen"], steps=2, warmup=1, batch=2, scale=True)
RECIPE = Recipe(Fidelity(64, 48, 1, 2, samples=1, train=TRAIN), "camvid", "embree", AssetPool(0, 2))
OUTLINED = table_text(msgspec.structs.replace(shipped("camvid"), outlines={"tree": 0.1}))
COUNT = 25  # two tasks, of 16 and 9


def noise(count: int, seed: int) -> LabelledImages:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (count, 48, 64, 3), dtype=np.uint8)
    return LabelledImages(images, rng.integers(0, 11, (count, 48, 64), dtype=np.uint8))


REAL, TEST = noise(COUNT, 0), noise(3, 1)
TARGET = target_of(REAL, TEST)


def made(runner: Runner, recipe: Recipe = RECIPE) -> list[tuple]:
    """Keys and results of two nets that are trained on the reward images."""
    jobs = [Job(recipe, REAL, 5 + k, {}) for k in range(2)]
    results = runner.run(jobs)
    return [(runner.key(job), r.reward, r.class_iou) for job, r in zip(jobs, results, strict=True)]


def test_the_reward_is_that_of_the_best_checkpoint(monkeypatch):
    def train(*_, checkpoints, at_checkpoint, **__):
        for number in range(checkpoints):
            at_checkpoint(number)

    def tested(recipe, number, *_):
        return Result((0.2, 0.7, 0.4)[number], [number], 0.0, 0.0)

    monkeypatch.setattr(in_worker, "train", train)
    monkeypatch.setattr(in_worker, "tested", tested)
    result = evaluate_miou(RECIPE._replace(checkpoints=3), REAL, 5, TEST)
    assert (result.reward, result.class_iou) == (0.7, [1]) and result.train_seconds > 0


def test_cost_is_cpu_time(monkeypatch):
    def waiting(*arguments, **kept):
        time.sleep(1)
        return images_and_labels(*arguments, **kept)

    def diverging(*_):
        time.sleep(1)
        raise TrainingError("diverged")

    images_and_labels = renders.images_and_labels
    monkeypatch.setattr(renders, "images_and_labels", waiting)
    ((part,),) = parts_of(RECIPE, draw(default_proposal(), 3, 1), 3, 1, None)
    render_part(part)  # compiled and with its assets
    assert render_part(part).seconds < 1
    assert attempt(diverging).train_seconds < 1


def plain(recipe: Recipe = RECIPE) -> list[tuple]:
    """The same results, of nets that are given arrays."""
    results = [evaluate_miou(recipe, REAL, 5 + k, TEST) for k in range(2)]
    return [(result.reward, result.class_iou) for result in results]


@pytest.fixture
def opened(tmp_path):
    """Opens the run's files, as a new run does."""
    return lambda: Cache(POOL, tmp_path / "run")


@pytest.fixture
def runner(tmp_path):
    """Opens a run on the target above, which goes on where an earlier one was."""
    return lambda: runner_of(TARGET, tmp_path / "run")


def flat(images: LabelledImages) -> list:
    return [images.images, images.labels, *images.features]


def same(first, second) -> bool:
    return all(map(np.array_equal, first, second))


@pytest.mark.parametrize(("workers", "trainers"), [
    (0, None), pytest.param(2, None, marks=pytest.mark.slow), pytest.param(2, 1, marks=pytest.mark.slow),
])  # fmt: skip
def test_results_are_those_of_arrays(workers, trainers, tmp_path):
    progress: list[str] = []
    with WorkerPool(workers, worker_environment(), trainers) as pool:
        opened_runner = runner_of(TARGET, tmp_path / "run", pool, progress.append)
        results = made(opened_runner)
        assert [result for _, *result in results] == [list(result) for result in plain()]
        assert results[0][0] != results[1][0] and results[0][1] != results[1][1]
        # A single set is rendered by all workers, and the same.
        streets, two = default_proposal(), replace(RECIPE.fidelity, streets=2)
        recipe = RECIPE._replace(fidelity=two)
        (result,) = opened_runner.run([Job(recipe, streets, 5, {})])
        alone = evaluate_miou(recipe, streets, 5, TEST)
        assert (result.reward, result.class_iou) == (alone.reward, alone.class_iou)
        assert result.render_seconds > 0 and not list((tmp_path / "run").glob("**/renders/*"))
        # The streets of a pool are rendered by some and get their features from others.
        units = draw(streets, 3, 5)
        pooled = [
            loaded(Cache(workers, tmp_path / name).streets("a" * 64, RECIPE, units, 3, max))
            for workers, name in ((pool, "run"), (POOL, "alone"))
        ]
        assert all(same(kept, made) for kept, made in zip(*map(flat, pooled), strict=True))
    done = [line.rpartition(": ")[2] for line in progress]
    assert done[0] == "3 of 3" and done[2:] == ["25 of 25"]


@pytest.mark.slow
@pytest.mark.parametrize(("recipe", "keeps"), [("lite0-frozen", "confusion"), ("compact", None)])
def test_networks_of_a_trainer_may_be_made_at_once(recipe, keeps, opened, tmp_path, monkeypatch):
    """As on a GPU, where it is much faster; sets come from renderers, and from files."""
    train = replace(RECIPES[recipe], steps=2, warmup=1, batch=2)
    rendering = RECIPE._replace(fidelity=replace(RECIPE.fidelity, train=train))
    real = opened().put(TEST, train, "test")
    few = opened().put(noise(2, 3), train, "labelled", training=True)
    counts, units, many = [], [], in_worker.train_many

    def counted(seeds, *arguments, **options):
        counts.append(len(seeds))
        return many(seeds, *arguments, **options)

    monkeypatch.setattr(in_worker, "train_many", counted)
    monkeypatch.setattr(in_worker, "AT_ONCE", (2, 1))
    monkeypatch.setattr(in_worker, "report", units.append)
    source, evaluate = default_proposal(), evaluate_miou
    if keeps is not None:
        source = TrainingSet((source, few), (0.5, 0.5))
        evaluate = partial(evaluate, keeps=keeps)
    tasks = [(evaluate, rendering, source, 5 + k, real) for k in range(3)]
    parts = parts_of(rendering, draw(default_proposal(), 5, 1), 5, 1, str(tmp_path / "renders"))
    one_by_one, at_once = (
        in_worker.attempt_all(
            tasks, [[render_part(*part) for part in parts] for _ in tasks], forced
        )
        for forced in (None, True)
    )
    assert counts == [2, 1] and not list((tmp_path / "renders").iterdir())
    assert units == pytest.approx(head_cost(rendering.fidelity) * np.array([1, 1, 1, 2, 1]))
    for ours, theirs in zip(at_once, one_by_one, strict=True):
        assert ours.reward == pytest.approx(theirs.reward, abs=0.02)
        assert ours.render_seconds > 0 and ours.train_seconds > 0 and ours.failed is None
        assert (ours.predictions is None) == (theirs.predictions is None) == (keeps is None)
        if keeps is not None:
            assert ours.predictions.by_image.shape == theirs.predictions.by_image.shape
            assert ours.predictions.confusion.sum() == theirs.predictions.confusion.sum()
    diverging = rendering._replace(
        fidelity=replace(rendering.fidelity, train=replace(train, lr=1e30))
    )
    tasks = [(evaluate_miou, diverging, REAL.take([0, 1]), 5, real)]
    (ours,), (theirs,) = (in_worker.attempt_all(tasks, [[]], forced) for forced in (True, False))
    assert ours.failed == theirs.failed and "loss is" in ours.failed
    counts.clear()
    kept = partial(evaluate_miou, keeps="predictions")
    (whole,) = in_worker.attempt_all([(kept, rendering, REAL.take([0, 1]), 5, real)], [[]], True)
    assert whole.predictions.predictions is not None and not counts
    monkeypatch.setattr(in_worker, "memory", lambda: 3 * training_bytes(rendering.fidelity))
    assert in_worker._most_at_once(rendering) == 1


def test_features_are_computed_once_for_all_nets_of_a_run(opened, runner, tmp_path, monkeypatch):
    expected = plain()
    opened().put(TEST, TRAIN, "test")
    real = loaded(opened().put(REAL, TRAIN, "reward", training=True))
    assert same(real.features, pyramid.features(view_images(REAL.images, TRAIN), TRAIN))
    part = real.take(np.array([3, 17, 24]))
    assert same(part.features, pyramid.features(view_images(part.images, TRAIN), TRAIN))
    monkeypatch.setattr(pyramid, "features", never)
    assert [tuple(result) for _, *result in made(runner())] == expected
    with pytest.raises(AssertionError, match="known"):
        made(runner_of(TARGET, tmp_path / "other"))


def test_a_killed_run_leaves_nothing_that_is_trusted(opened, tmp_path, full_disk, monkeypatch):
    folder, whole = tmp_path / "run" / FOLDER, pyramid.features(REAL.images, TRAIN)
    with pytest.raises(OSError, match="No space left") as caught:
        opened().put(REAL, TRAIN, "reward")
    assert Path(caught.value.filename).parent == folder and not list(folder.iterdir())
    monkeypatch.undo()
    with monkeypatch.context() as patch:
        patch.setattr(cache, "_features_of", Counted(cache._features_of, 1))
        with pytest.raises(Killed):
            opened().put(REAL, TRAIN, "reward")
    (images,) = folder.iterdir()
    first = opened().put(REAL, TRAIN, "reward")
    assert first.images == str(images) and same(first.load().features, whole)
    # Half of a folder after a kill that nothing catches; files that a user has removed.
    features = Path(first.features)
    shutil.copytree(features, features.with_name(f".{features.name}.sdr-jax-part"))
    for name in ("images.npy", ABOUT):
        (images / name).unlink()
        assert opened().put(REAL, TRAIN, "reward") == first and (images / name).exists()
    (Path(first.features) / "map0.npy").unlink()
    assert opened().put(REAL, TRAIN, "reward") == first and len(list(folder.iterdir())) == 2
    assert np.array_equal(np.load(Path(first.features) / "map0.npy"), whole[0])


def test_streets_are_rendered_once_and_whole_pieces_outlive_a_kill(opened, monkeypatch):
    monkeypatch.setattr(cache, "CHUNK", 3)
    units, counts = draw(default_proposal(), 0, 7), []

    def count(streets: int, replayed: bool) -> None:
        counts.append((streets, replayed))

    def made(**stubs):
        with monkeypatch.context() as patch:
            for name, stub in stubs.items():
                patch.setattr(renders if name == "images_and_labels" else cache, name, stub)
            streets = loaded(opened().streets("a" * 64, RECIPE, units, 3, count))
        return flat(streets)

    whole = made()
    assert len(whole[0]) == 7 and counts == [(0, True), (3, False), (3, False), (1, False)]
    assert same(made(images_and_labels=never), whole)
    assert counts[4:] == [(7, True)]  # rendered by an earlier call
    # The same streets with other classes have other labels.
    other = loaded(opened().streets("a" * 64, RECIPE._replace(table="cityscapes"), units, 3, max))
    assert same([other.images], whole[:1]) and not same([other.labels], whole[1:2])
    outlined, fresh = RECIPE._replace(table=OUTLINED), draw(default_proposal(), 3, 4)
    other = loaded(opened().streets("b" * 64, outlined, fresh, 3, max))
    fidelity = replace(RECIPE.fidelity, streets=4, shots=1)
    exact, again = (
        in_worker.rendered_set(recipe._replace(fidelity=fidelity), default_proposal(), 3)
        for recipe in (RECIPE, outlined)
    )
    assert same([again.images, again.labels], [other.images, other.labels])
    assert same([exact.images], [again.images]) and not same([exact.labels], [again.labels])
    for limit, missing in ((4, 4), (7, 0)):
        opened().forget("a" * 64, RECIPE)
        with pytest.raises(Killed):
            made(
                images_and_labels=Counted(renders.images_and_labels, limit),
                _assemble=Counted(never, 0),
            )
        rendered = Counted(renders.images_and_labels)
        assert same(made(images_and_labels=rendered), whole) and len(rendered.calls) == missing


def test_a_damaged_piece_of_streets_is_made_anew(opened, monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "CHUNK", 5)
    units = draw(default_proposal(), 0, 12)
    with monkeypatch.context() as patch, pytest.raises(AssertionError):
        patch.setattr(cache, "_assemble", never)
        opened().streets("a" * 64, RECIPE, units, 3, max)
    pieces = sorted((tmp_path / "run" / FOLDER).glob("pool-*.pieces/*.npz"))
    assert [piece.name for piece in pieces] == ["000000.npz", "000005.npz", "000010.npz"]
    pieces[1].write_bytes(pieces[1].read_bytes()[:-100])
    rendered = Counted(renders.images_and_labels)
    monkeypatch.setattr(renders, "images_and_labels", rendered)
    opened().streets("a" * 64, RECIPE, units, 3, max)
    assert [index for _, _, _, index, *_ in rendered.calls] == [*range(5, 10)]


@pytest.mark.parametrize(("part", "name", "change", "complaint"), [
    ("features", ABOUT, {"backbone": "0" * 64}, "is of other backbone, '000"),
    ("features", ABOUT, {"images": "ff"}, "is of other images, 'ff' and not"),
    ("images", ABOUT, {"files": 1}, "is damaged"),
    ("features", "map1.npy", b"\x01", "is damaged"),
    ("images", "labels.npy", b"", "is damaged"),
])  # fmt: skip
def test_files_of_others_and_damaged_ones_are_refused(part, name, change, complaint, opened):
    path = Path(getattr(opened().put(TEST, TRAIN, "test"), part)) / name
    if name == ABOUT:
        write_json(path, read_json(path) | change)
    else:
        path.write_bytes(path.read_bytes()[:-1] + change)
    with pytest.raises(UserError) as caught:
        opened().put(TEST, TRAIN, "test")
    message = str(caught.value)
    assert str(path) in message and complaint in message and f"remove {path.parent}" in message


def test_a_command_ends_with_exit_code_2(command, learnt_file, tmp_path, error_line):
    run = tmp_path / "run"
    arguments = ("table", run, "--learnt", str(learnt_file), "--nets", "lite0")
    assert command(*arguments) == 0
    for path in (run / FOLDER).glob(f"*-*/{ABOUT}"):
        write_json(path, read_json(path) | {"backbone": "0"})
    (run / "finals.jsonl").unlink()
    assert command(*arguments) == 2 and "is of other backbone" in error_line(begun=True)


def test_heads_may_normalise_by_the_images_that_give_the_reward(runner):
    train = replace(TRAIN, head_statistics="target")
    by_target = RECIPE._replace(fidelity=replace(RECIPE.fidelity, train=train))
    targets = TARGET, target_of(noise(COUNT, 2), TEST)
    names = [about(r, t, "test", TEST)["config"] for r, t in product((RECIPE, by_target), targets)]
    assert names[0] == names[1] and len(set(names)) == 3
    results = made(runner(), by_target)
    by_target = by_target._replace(
        statistics=pyramid.channel_statistics(pyramid.features(REAL.images, TRAIN))
    )
    assert [tuple(result) for _, *result in results] == plain(by_target)
