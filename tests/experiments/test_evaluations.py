"""Evaluations: which are the same, what is remembered of them, and that none is made twice."""

import json
import math
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import Unfinished, UserError
from common.labels.classes import Outline
from common.progress import Progress
from common.workers.pool import WorkerPool
from experiments.app.stores import main
from experiments.attribute_search.loop import search
from experiments.attribute_search.plans import plan_of
from experiments.attribute_search.rewards import Rewards
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.evaluation import job, runner, store
from experiments.evaluation.cost import cost_of, head_cost
from experiments.evaluation.in_worker import attempt, worker_environment
from experiments.evaluation.job import Job, Result
from experiments.evaluation.store import (
    HEADER,
    LOGS,
    Store,
    first_of_each,
    identity,
    read,
    record_of,
    result_of,
)
from experiments.session.session import Session
from experiments.tables.nets import jobs_of
from scene.assets.own_class import OwnClass
from scene.attributes import NAMES
from scene.proposal import Histogram, Proposal, default_proposal, mixture, random_proposal
from seg.classes import CAMVID_11
from seg.data import LabelledImages
from seg.recipes import RECIPES
from tests.tasks import loaded

from .conftest import (
    POOL,
    diverge,
    formula,
    lines,
    main_job,
    never,
    results_of,
    searching,
    target_of,
    untimed,
)

CONFIG = defaults(MainConfig, "camvid", "smoke")
TRUTH = LabelledImages(np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 8), np.uint8))
TARGET = target_of(TRUTH, TRUTH)
SHARED = partial(Store, shared=True)
FAILED = "the loss is nan after 50 of 200 steps"


def record(key: str = "k", reward: float | None = 0.25, **others) -> dict:
    failed = None if reward is not None else "the loss is nan"
    scores = (math.nan, []) if failed else (reward, [0.5, None])
    outcome = Result(*scores, 1.0, 2.0, failed)
    fields = {"config": "c", "engine": 1, "made_with": {"backend": "cpu"}}
    return record_of(key, random_proposal(), 1, outcome) | fields | others


@pytest.fixture
def a_run(tmp_path):
    """Opens runs on the target above, without their folders' guards."""

    def opened(out="run", store=None, pool=POOL, **changes) -> Session[MainConfig]:
        config = replace(CONFIG, out=tmp_path / out, **changes)
        config.out.mkdir(exist_ok=True)
        logs = [Store(config.out / name) for name in LOGS]
        shared = store and Store(store, shared=True)
        return Session(config, TARGET, pool, *logs, shared, Progress(1))

    return opened


def test_a_search_asks_for_its_checkpoints(a_run):
    for checkpoints in (1, 3):
        config = searching(CONFIG, checkpoints=checkpoints)
        run = a_run(search=config.search)
        job = Rewards(run, plan_of(config))._job
        assert job.recipe == run.recipe(CONFIG.reward)._replace(checkpoints=checkpoints)


def evaluate(run: Session[MainConfig], *seeds: int) -> list[Result]:
    """Outcomes of jobs, in their order."""
    recipe = run.recipe(run.config.reward)
    jobs = [Job(recipe, random_proposal(), seed, {"row": f"r{seed}"}, "reward") for seed in seeds]
    return run.runner.run(jobs)


@given(st.integers(0, 2**31 - 1), st.floats(0, 1, width=32))
def test_a_name_tells_seed_attributes_and_images(seed, value):
    units = np.full(23, value, np.float32)
    key = identity("c", Proposal(units, units), seed)
    assert key == identity("c", Proposal(units.tolist(), units.copy()), np.uint32(seed))
    changed = units.copy()
    changed[22] = np.nextafter(changed[22], np.float32(2))
    real = TRUTH._replace(labels=TRUTH.labels + np.uint8(seed % 255 + 1))
    moved, units = Proposal(units, changed), Proposal(units, units)
    others = [identity("d", units, seed), identity("c", units, seed + 1)]
    mixed = [mixture(shares, (units, moved)) for shares in ((0.5, 0.5), (0.25, 0.75))]
    even, half = (Histogram(np.full((23, k), 1 / k, np.float32)) for k in (4, 2))
    mixed += [mixture((0.5, 0.5), (units, other)) for other in (even, half)]
    others += [identity("c", source, seed) for source in (moved, TRUTH, real, even, half, *mixed)]
    same = Histogram(half.probabilities.tolist())
    assert identity("c", same, seed) == identity("c", half, seed)
    assert len(key) == 64 and len({key, *others}) == 1 + len(others)


def test_names_of_intervals_and_mixtures_are_those_of_earlier_versions():
    """Else a store would be of no use to a later version."""
    third = Proposal(np.full(23, 1 / 3, np.float32), np.full(23, 0.1, np.float32))
    mixed = mixture((0.25, 0.75), (third, random_proposal()))
    keys = [identity("c", source, 7)[:16] for source in (third, mixed)]
    assert keys == ["3840d4a09e2a3bbe", "80fcb9269a4b1756"]


def test_an_array_is_read_once_and_stays_as_it_was(monkeypatch):
    read, reads = store._read, []
    monkeypatch.setattr(store, "_read", lambda array: reads.append(array.shape) or read(array))
    a, b = np.arange(6, dtype=np.uint8), np.arange(6, dtype=np.uint8)
    assert store.digest_of(a) == store.digest_of(a) == store.digest_of(b)
    assert reads == [(6,), (6,)] and store.digest_of(a, b) == store.digest_of(b, a)
    others = [a.reshape(2, 3), a.view(np.int8), a[::-1]]
    assert len({store.digest_of(x) for x in (a, *others)}) == 4
    with pytest.raises(ValueError, match="read-only"):
        a[0] = 1
    number = id(a)
    del a, others
    assert number not in store._DIGESTS


@pytest.mark.parametrize("few", [(), ("--few", "1")])
def test_a_job_reads_each_of_its_real_images_once(few, camvid, out, counted, monkeypatch):
    read, reads = store._read, []
    monkeypatch.setattr(store, "_read", lambda array: reads.append(read(array)) or reads[-1])
    assert main_job("camvid", "--data", str(camvid), "--out", str(out), *few) == 0
    assert len(reads) == len(set(reads)) == 4 + 4 * bool(few)


def test_a_mixture_is_kept_by_its_components(tmp_path):
    streets = mixture((0.25, 0.75), (default_proposal(), random_proposal()))
    outcome = Result(0.5, [0.5, None], 1.0, 2.0, heads=([0.25, None], [0.75, 0.5]))
    record = record_of("k", streets, 1, outcome) | {"config": "c", "engine": 1}
    Store(tmp_path / "log").add(record)
    (stored,) = Store(tmp_path / "log").records
    assert stored == record and result_of(stored) == outcome._replace(stored=True)
    assert (stored["centre"], stored["width"]) == (None, None)
    assert [row["share"] for row in stored["components"]] == [0.25, 0.75]
    assert stored["components"][1] == {"share": 0.75, "centre": [0.5] * 23, "width": [1.0] * 23}


def test_a_histogram_is_kept_by_its_probabilities(tmp_path):
    histogram = Histogram(np.tile(np.float32([0.1, 0.2, 0.7]), (23, 1)))
    for source in (histogram, mixture((0.25, 0.75), (random_proposal(), histogram))):
        kept = record_of("k", source, 1, Result(0.5, [], 1.0, 2.0)) | {"config": "c", "engine": 1}
        Store(tmp_path / "log").add(kept)
        stored = Store(tmp_path / "log").records[-1]
        assert stored == kept and (stored["centre"], stored["width"]) == (None, None)
        with_probabilities = stored if source is histogram else stored["components"][1]
        assert with_probabilities["probabilities"] == [[0.1, 0.2, 0.7]] * 23


def test_a_class_of_one_s_own_counts_by_its_name_and_the_content_of_its_file(a_run, tmp_path):
    run = a_run()
    recipe = run.recipe(run.config.reward)

    def name(*own_class_fields):
        pool = recipe.pool._replace(
            own_class=OwnClass(*own_class_fields) if own_class_fields else None
        )
        return runner.about(recipe._replace(pool=pool), TARGET, "reward", TRUTH)["config"]

    first, second, copy = (str(tmp_path / f"{k}.glb") for k in "abc")
    for file, content in ((first, "1"), (second, "2"), (copy, "1")):
        (tmp_path / file).write_text(content)
    names = [name(), name("bin", first), name("cone", first), name("bin", second)]
    assert len({*names, name("bin", first, "carriageway")}) == 5
    assert name("bin", copy) == names[1]


def test_a_configuration_is_all_that_decides_a_reward(a_run, tmp_path, monkeypatch):
    (tmp_path / "own" / "car").mkdir(parents=True)

    def name(target=TARGET, side="reward", truth=TRUTH, table="camvid", checkpoints=1, **changes):
        run = a_run(**changes)
        recipe = run.recipe(run.config.reward)._replace(table=table, checkpoints=checkpoints)
        return runner.about(recipe, target, side, truth)["config"]

    reward = CONFIG.reward
    assets_field = {"assets": tmp_path / "own"}
    train, other_names = reward.train, TARGET._replace(reward_names=("a", "x"))
    others = [
        *(name(reward=replace(reward, **k)) for k in ({"shots": 3}, {"samples": 2})),
        *(name(reward=replace(reward, train=replace(train, **k))) for k in ({"steps": 13}, {"lr": 0.5})),
        name(renderer="opengl"), name(asset_fraction=0.5), name(asset_count=5), name(**assets_field),
        name(table="cityscapes"), name(checkpoints=2),
        name(target=TARGET._replace(name="twin")), name(target=other_names),
        name(side="test"), name(truth=TRUTH._replace(labels=TRUTH.labels + 1)),
    ]  # fmt: skip
    for corner in ("v 0 0 0", "v 0 0 1"):
        (tmp_path / "own" / "car" / "a.obj").write_text(corner)
        others += [name(**assets_field)]
    assert len({name(), *others}) == 1 + len(others)
    (tmp_path / "own").rename(tmp_path / "moved")
    assert name(assets=tmp_path / "moved") == others[-1]

    def weighing(file):
        vgg = replace(train, net="fcn8s", weights=str(tmp_path / file))
        return name(reward=replace(reward, train=vgg))

    for content in (b"one", b"two"):
        (tmp_path / "weights").write_bytes(content)
        others += [weighing("weights")]
    (tmp_path / "weights").rename(tmp_path / "elsewhere")
    assert weighing("elsewhere") == others[-1] != others[-2]
    free = {"seed": 5, "workers": 7, "seeds": 9, "store": tmp_path / "s", "twin_seed": 3}
    assert name(**free, final=reward) == name() == name(target=TARGET._replace(test_names=("x",)))
    others += [name()]
    with monkeypatch.context() as patch:  # as if the package's file had outlines
        for share in (0.02, 0.03):
            table = replace(CAMVID_11, outlines=(Outline((8, 9), share),))
            patch.setattr(job, "class_table", lambda _, table=table: table)
            assert name() not in others
            others += [name()]
    monkeypatch.setattr(runner, "ENGINE", runner.ENGINE + 1)
    assert name() not in others


def test_lines_come_back_behind_a_header(tmp_path):
    path = tmp_path / "new" / "store.jsonl"
    store, other = Store(path, shared=True), Store(path, shared=True)
    assert len(store) == 0 and not path.exists()
    assert store.add(record()) == record()
    assert other.get("k") is None and other.add(record(reward=0.5)) == record()  # the first stands
    store.add(record("failed", None))
    assert lines(path) == [HEADER, record(), record("failed", None)]
    other.refresh()
    again = Store(path, shared=True)
    assert again.records == store.records == other.records
    assert again.get("other") is None and again.placed[1][1] == f"{path}: line 3"


def test_two_runs_may_write_at_once(tmp_path):
    path = tmp_path / "store.jsonl"

    def add_many(name: str) -> None:
        written(path, *(record(f"{who}{k}") for k in range(20) for who in (name, "both")))

    with ThreadPoolExecutor(2) as writers:  # the lock belongs to the open file, not to the process
        list(writers.map(add_many, "xy"))
    assert len(lines(path)) == 61 and len(Store(path, shared=True)) == 60


def test_a_log_names_what_is_not_its_own(tmp_path):
    log = Store(tmp_path / "finals.jsonl")
    log.add(record(row="random"))
    log.add(record(row="learnt"))
    assert Store(log.path).records == log.records and len(log.records) == 2
    assert Store(log.path).get("k")["row"] == "random" and log.get("other") is None
    with log.path.open("a") as file:
        file.write('{"key": "a"}\n')
    with pytest.raises(UserError, match=f"{log.path}: line 3: config must be of type str"):
        Store(log.path)


def test_known_evaluations_are_not_made_again(a_run, tmp_path, scored_by):
    store = tmp_path / "store.jsonl"
    scored_by(formula)
    first = evaluate(a_run(store=store), 1, 2, 1)
    assert [o.stored for o in first] == [False, False, True] and first[0].reward == first[2].reward
    scored_by(never)
    for run in (a_run(), a_run("other", store=store)):
        again = evaluate(run, 2, 1)
        assert [o.reward for o in again] == [first[1].reward, first[0].reward]
        assert all(o.stored and o.seconds == 2.0 and len(o.class_iou) == 11 for o in again)
    # Each run's log has its own notes, beside all that the store knows.
    stored = Store(store, shared=True).records
    assert len(stored) == 2 and "row" not in stored[0]
    first_lines, second_lines = (lines(tmp_path / name / LOGS[1]) for name in ("run", "other"))
    assert [line["row"] for line in first_lines] == ["r1", "r2"]
    assert untimed(second_lines) == untimed(first_lines[::-1])
    assert stored[0] == {k: v for k, v in first_lines[0].items() if k not in ("row", "elapsed")}
    assert stored[0]["centre"] == [0.5] * 23 and stored[0]["width"] == [1.0] * 23
    assert (stored[0]["seed"], stored[0]["side"], stored[0]["size"]) == (1, "reward", "64x48")


def test_the_log_has_a_line_for_each_row_of_a_net_that_is_known_already(a_run, scored_by, capsys):
    scored_by(formula)
    run = a_run()
    recipe = run.recipe(run.config.final)
    for names in (("default",), ("default", "learnt"), ("default", "learnt")):
        results = results_of(run, "final", dict.fromkeys(names, default_proposal()), recipe, [0, 1])
    for opened in (run, a_run()):  # nor does it grow when a run goes on
        results_of(opened, "final", dict.fromkeys(names, default_proposal()), recipe, [0, 1])
    assert [(line["row"], line["seed"]) for line in opened.finals.records] == [
        ("default", 0), ("default", 1), ("learnt", 0), ("learnt", 1),
    ]  # fmt: skip
    assert len(first_of_each(opened.finals.records)) == 2 and results["learnt"][0].stored


def test_what_the_store_holds_stands(a_run, tmp_path, scored_by):
    def slow(*task) -> Result:
        scored_by(lambda *task: formula(*task)._replace(reward=0.125))
        evaluate(a_run("quicker", store=run.store.path), 1)
        return formula(*task)

    run = a_run(store=tmp_path / "store.jsonl")
    scored_by(slow)
    (outcome,) = evaluate(run, 1)
    assert outcome.reward == 0.125 and not outcome.stored
    assert [line["reward"] for line in lines(run.finals.path)] == [0.125]


def test_a_failed_evaluation_is_kept_as_failed(a_run, tmp_path, scored_by):
    for out in ("run", "other"):
        scored_by(diverge if out == "run" else never)
        (outcome,) = evaluate(a_run(out, store=tmp_path / "store.jsonl"), 3)
        assert math.isnan(outcome.reward) and outcome.failed == FAILED
    assert Store(tmp_path / "store.jsonl", shared=True).records[0]["reward"] is None
    with pytest.raises(AssertionError, match="known"):
        attempt(never)  # other errors are passed on


def test_a_score_that_is_no_number_is_the_images_fault(a_run, tmp_path, scored_by):
    scored_by(lambda *task: formula(*task)._replace(reward=math.nan))
    run = a_run(store=tmp_path / "store.jsonl")
    with pytest.raises(UserError, match=r"reward is nan: .* at least one labelled class"):
        evaluate(run, 3)
    assert not run.finals.records and not run.store.records


def test_a_second_search_takes_its_rewards_from_the_store(a_run, tmp_path, scored_by):
    results = []
    for out in ("one", "two"):
        scored_by(formula if out == "one" else never)
        options = searching(CONFIG, method="random_search").search
        run = a_run(out, store=tmp_path / "store.jsonl", search=options)
        results.append(search(run, plan_of(run.config)))
    one, two = ([result.reward for result in found.results] for found in results)
    assert one == two
    logs = [lines(tmp_path / out / LOGS[0]) for out in ("one", "two")]
    assert untimed(logs[0]) == untimed(logs[1])
    # The store tells what was proposed: a bin's interval for each attribute.
    stored = Store(tmp_path / "store.jsonl", shared=True).records
    assert len(stored) == 12 and stored[0]["width"] == [0.2] * 23
    bins = np.array(logs[0][0]["actions"])
    np.testing.assert_allclose(stored[0]["centre"], (bins + 0.5) / 5, atol=1e-6)


def nets(run: Session[MainConfig]) -> dict[str, list[Result]]:
    sources = {"random": random_proposal(), "default": default_proposal(), "real": TRUTH}
    recipe = run.recipe(run.config.final)
    return results_of(run, "final", sources, recipe, [5, 6, 7], once=["default"])


def test_rows_are_paired_and_scored_once_on_the_test_images(a_run, scored_by, capsys):
    scored_by(formula)
    run = a_run()
    results = nets(run)
    rows = [(r["nets"], r["side"], r["row"], r["seed"]) for r in run.finals.records]
    names = ["random", "default", "random", "random", "real", "real", "real"]
    seeds = [5, 5, 6, 7, 5, 6, 7]  # the longest first
    assert rows == [("final", "test", *row) for row in zip(names, seeds, strict=True)]
    rewards = [formula(run.recipe(CONFIG.final), TRUTH, seed, TRUTH).reward for seed in (5, 6, 7)]
    assert [outcome.reward for outcome in results["real"]] == rewards
    lines_shown = capsys.readouterr().out.splitlines()
    assert (
        len(lines_shown) == 7
        and f"final: real, seed 6 | mIoU {100 * rewards[1]:.1f}" in lines_shown[5]
    )
    scored_by(never)
    again = nets(a_run())
    for name, row_results in again.items():
        assert [o.reward for o in row_results] == [o.reward for o in results[name]]
    assert [len(row_results) for row_results in again.values()] == [
        3,
        1,
        3,
    ] and capsys.readouterr().out == ""


@pytest.mark.parametrize(("killed", "trainers"), [(False, None), (True, None), (False, 1)])
def test_prefetched_nets_are_made_once_with_the_same_values(
    killed, trainers, a_run, scored_by, monkeypatch
):
    scored_by(formula)
    expected = nets(a_run())
    monkeypatch.setattr("experiments.evaluation.runner.LEAST", 0.0)
    with WorkerPool(1, worker_environment(), trainers) as pool:
        run = a_run("ahead", pool=pool)
        sets = {"random": random_proposal(), "real": TRUTH}
        run.runner.prefetch(jobs_of("final", sets, run.recipe(CONFIG.final), [5, 6]))
        while "behind" not in pool._executors:  # a thread of its own renders ahead
            time.sleep(0.01)
        behind = list(pool._executors["behind"]._processes)
        if killed:
            os.kill(behind[0], signal.SIGKILL)
        evaluate(run, 1, 2)  # urgent
        results_by_row = nets(run)
        if trainers:
            libraries = "numba", "jax", "jaxlib", "flax", "optax"
            assert [*pool.map(loaded, [libraries])] == [(0, {"numba"})]
            assert pool._submit(loaded, libraries, behind=True).result() == {"numba"}
            ((_, of_trainer),) = pool.map(loaded, [libraries], net=True)
            assert "jax" in of_trainer
            rendered = [
                r for results in results_by_row.values() for r in results if r.render_seconds != 0.5
            ]
            assert len(rendered) == 4  # on renderers: the others have real images
            assert not list(run.config.out.glob("shared/renders/*"))
    assert results_by_row.keys() == expected.keys()
    for name, row_results in results_by_row.items():
        assert [o.reward for o in row_results] == [o.reward for o in expected[name]]
    kept = [line for line in run.finals.records if "nets" in line]
    assert len(kept) == len({(line["nets"], line["row"], line["seed"]) for line in kept}) == 7
    full, real = cost_of(CONFIG.final), head_cost(CONFIG.final)
    costs = sum(real if line["row"] == "real" else full for line in kept)
    costs += 2 * cost_of(CONFIG.reward)
    assert run.progress._done == pytest.approx(costs)


def test_more_than_a_tenth_failed_ends_it(a_run, scored_by, capsys):
    def first_fail(end, recipe, source, seed, truth):
        fails = isinstance(source, LabelledImages) and seed < end
        return (diverge if fails else formula)(recipe, source, seed, truth)

    scored_by(partial(first_fail, 6))  # one may
    assert [o.failed for o in nets(a_run())["real"]] == [FAILED, None, None]
    assert "final: real, seed 5 | failed" in capsys.readouterr().out
    scored_by(partial(first_fail, 7))
    with pytest.raises(UserError, match=r"2 of 7 evaluations failed.*the loss is nan"):
        nets(a_run("other"))


@pytest.fixture
def refused(error_line):
    """The one line with which the command line refuses its arguments."""

    def line(*arguments) -> str:
        assert main([str(a) for a in arguments]) == 2
        return error_line()

    return line


def written(path, *records: dict, make=SHARED):
    path.parent.mkdir(exist_ok=True)
    kept = make(path)
    for r in records:
        kept.add(r)
    return path


def test_show_counts_by_configuration(tmp_path, capsys):
    records = [record("a", 0.1), record("b", 0.3), record("c", None), record("d", 0.5, config="o")]
    store = written(tmp_path / "s.jsonl", *records)
    log = written(tmp_path / "run" / LOGS[1], *records[:1], make=Store)
    assert main(["show", str(store), str(log.parent)]) == 0
    first, one, other, run, own = capsys.readouterr().out.splitlines()
    assert first.endswith("4 evaluations")
    assert "3 evaluations, 1 failed" in one and "mIoU best 30.0, mean 20.0" in one
    assert "1 evaluation, 0 failed" in other and "best 50.0" in other
    assert run.endswith(f"{log.parent}: 1 evaluation") and "best 10.0" in own


@pytest.mark.parametrize(("most", "total"), [(1, 1), (1, 8), (3, 30), (7, 70)])
def test_a_tenth_of_the_evaluations_may_fail(most, total):
    failed = [Result(math.nan, [], 0.0, 0.0, "why")] * most
    runner.refuse_failed(failed, total)
    with pytest.raises(Unfinished, match=f"{most + 1} of {total} evaluations failed.*: why"):
        runner.refuse_failed([*failed, failed[0]], total)


def test_merge_folds_duplicates(tmp_path, capsys, refused):
    a = written(tmp_path / "a.jsonl", record("x"), record("y"))
    run = tmp_path / "run"
    written(run / LOGS[0], record("y", train_seconds=9.0), record("z", None), make=Store)
    written(run / LOGS[1], record("z", None), record("w", centre=None, width=None), make=Store)
    own = [f"{run / LOGS[k]}: line {line}" for k, line in ((0, 1), (0, 2), (1, 2))]
    assert [where for _, where in read(run).values()] == own
    out = tmp_path / "c.jsonl"
    assert main(["merge", str(a), str(run), "--out", str(out)]) == 0
    assert "4 evaluations" in capsys.readouterr().out
    assert [r["key"] for r in Store(out, shared=True).records] == ["x", "y", "z", "w"]
    assert "exists already" in refused("merge", a, "--out", out)


def test_merge_leaves_out_what_only_a_run_says(a_run, tmp_path, scored_by):
    scored_by(lambda *_: Result(0.25, [0.5, None], 1.0, 2.0))
    run = a_run(store=tmp_path / "shared.jsonl")
    evaluate(run, 1, 2)
    assert main(["merge", str(tmp_path / "run"), "--out", str(tmp_path / "merged.jsonl")]) == 0
    shared, merged = (lines(tmp_path / f"{name}.jsonl") for name in ("shared", "merged"))
    assert len(merged) == 3 and merged == shared


@pytest.mark.parametrize("make", [SHARED, Store])
def test_merge_refuses_two_values_for_one_key_and_names_both(make, tmp_path, refused):
    a = written(tmp_path / "a.jsonl", record("x", 0.25))
    b = tmp_path / "run" / LOGS[1]
    written(b, record("w"), record("x", 0.75), make=make)
    error = refused("merge", a, b if make is SHARED else b.parent, "--out", tmp_path / "c.jsonl")
    assert f"{a}: line 2 and {b}: line {3 if make is SHARED else 2}" in error
    assert "0.250000 and 0.750000" in error and not (tmp_path / "c.jsonl").exists()


@pytest.mark.parametrize(("found", "complaint"), [
    ([{**HEADER, "attributes": ["light", "fog"]}], "another space: 2 attributes"),
    ([{**HEADER, "attributes": list(reversed(NAMES))}], "in another order"),
    ([{**HEADER, "store": "sdr-jax evaluations, 1"}], "of another version"),
    ([record()], "is no store of evaluations"),
    ([HEADER, [1]], "line 2 is not a JSON object"),
    ([HEADER, math.nan], "line 2 is not JSON"),
    ([HEADER, {"key": 1}], "line 2: key must be of type str"),
    ([HEADER, record(reward=None, failed=None)], "one of the two"),
    ([HEADER, record(centre=[0.5])], "centre must hold 23"),
    ([HEADER, record(width=["0.5"] * 23)], "width must hold 23"),
    ([HEADER, record(width=None)], "both a centre and a width, or neither"),
    ([HEADER, record(class_iou=["a"])], "class_iou and heads must hold numbers or null"),
    ([HEADER, record(heads=[0.5])], "class_iou and heads must hold numbers or null"),
    ([HEADER, record(made_with="jax")], "made_with must be a table of versions by name"),
    ([HEADER, record(made_with={"jax": [1]})], "made_with must be a table of versions by name"),
    ([HEADER, record(), record(reward=0.5)], "line 3 hold the same evaluation with different"),
])  # fmt: skip
def test_other_files_are_refused_in_one_line(found, complaint, tmp_path, refused):
    path = tmp_path / "other.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in found))
    before = path.read_bytes()
    error = refused("show", path)
    assert str(path) in error and complaint in error and path.read_bytes() == before


@pytest.mark.parametrize(
    "content", [b'{"road": 0, "sky": 1}', b"a word", b"\xff\xd8\xff\xe0 a photograph\n"]
)
def test_a_file_of_another_program_is_left_as_it_is(content, tmp_path, refused):
    """One line without an end is not taken for a store that a kill has cut short."""
    path = tmp_path / "classes.json"
    path.write_bytes(content)
    assert "is no store of evaluations" in refused("show", path)
    with pytest.raises(UserError, match="is no store of evaluations"):
        Store(path, shared=True).add(record())
    assert path.read_bytes() == content
    path.write_bytes(b'{"store": "sdr')  # a kill
    Store(path, shared=True).add(record())
    assert len(Store(path, shared=True)) == 1


def test_files_that_are_not_there_are_refused(tmp_path, refused):
    assert "none.jsonl does not exist; pass a store" in refused("show", tmp_path / "none.jsonl")
    assert "is not a run folder" in refused("show", tmp_path)
    assert "merge needs --out" in refused("merge", tmp_path)
    with pytest.raises(UserError, match="is a folder; a store is a file"):
        Store(tmp_path)


def test_a_head_costs_more_per_pixel_where_its_batch_no_longer_fits_the_cache():
    def of_pixel(recipe, width, height):
        fidelity = replace(CONFIG.final, width=width, height=height, train=RECIPES[recipe])
        return head_cost(fidelity) / (width * height)

    for recipe, spill in (("lite0-frozen", 1.8), ("lite0-heads", 1.0)):
        small, large = of_pixel(recipe, 240, 176), of_pixel(recipe, 480, 360)
        assert large / small == pytest.approx(spill)
