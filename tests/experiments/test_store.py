"""The store of evaluations: what is the same, what is refused, and that nothing is scored twice."""

import io
import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from experiments.evaluator import Evaluator, Job, about
from experiments.finals import draw_units, random_proposal
from experiments.folder import RunFolder
from experiments.keys import digest, engine, evaluation_key, folder_digest
from experiments.outcome import attempt
from experiments.progress import Progress
from experiments.targets import Target
from hypothesis import given
from hypothesis import strategies as st

import sdr_jax
from experiments import search as search_module
from experiments.config import camvid_config
from experiments.reward import Evaluation, Truth
from experiments.store import HEADER, Store, main
from scene.attributes import NAMES
from scene.workers import WorkerPool
from seg.train import TrainingError

from .conftest import lines

TARGET = Target("camvid", True, "camvid", "", ("a", "b"), ("c",), lambda height, width: None)
TRUTH = Truth(np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 8), np.uint8))


def record(key: str = "k", reward: float | None = 0.25, **others) -> dict:
    return {
        "key": key,
        "config": "c",
        "centre": [0.5] * len(NAMES),
        "width": [1.0] * len(NAMES),
        "seed": 1,
        "reward": reward,
        "class_iou": [] if reward is None else [0.5, None],
        "render_seconds": 1.0,
        "train_seconds": 2.0,
        "failed": "the loss is nan" if reward is None else None,
        **others,
    }


def scored(*task) -> Evaluation:
    return Evaluation(np.array([[3, 1], [1, 3]]), 0.1, 0.2)


def diverge(*task) -> Evaluation:
    raise TrainingError("the loss is nan")


def never(*task) -> Evaluation:
    raise AssertionError("this was known")


def jobs(*seeds: int) -> list[Job]:
    proposal = random_proposal()
    return [Job(proposal, draw_units(proposal, seed, 2), seed) for seed in seeds]


def evaluator(store: Store | None, config=None) -> Evaluator:
    config = config or camvid_config("smoke")
    return Evaluator(config, config.reward, TARGET, "reward", TRUTH, WorkerPool(0), store)


def test_lines_come_back_behind_a_header(tmp_path):
    path = tmp_path / "new" / "store.jsonl"
    store = Store(path)
    assert len(store) == 0 and not path.exists()
    assert store.add(record()) == record()
    store.add(record("failed", None))
    assert lines(path) == [HEADER, record(), record("failed", None)]
    again = Store(path)
    assert again.records == store.records and again.get("failed")["reward"] is None
    assert again.get("other") is None and again.line("failed") == 3


@given(st.data())
def test_a_kill_while_writing_loses_at_most_the_last_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("store") / "store.jsonl"
    store = Store(path)
    for key in "abc":
        store.add(record(key))
    whole = path.read_bytes()
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    kept = max(path.read_bytes().count(b"\n") - 1, 0)
    again = Store(path)
    assert [r["key"] for r in again.records] == list("abc")[:kept]
    for key in list("abc")[kept:] + ["d"]:
        again.add(record(key))
    assert [r["key"] for r in Store(path).records] == list("abcd")


def test_what_another_run_adds_is_seen_and_stands(tmp_path):
    path = tmp_path / "store.jsonl"
    one, other = Store(path), Store(path)
    one.add(record("a", 0.25))
    assert other.get("a") is None
    assert other.add(record("a", 0.5))["reward"] == 0.25
    one.add(record("b"))
    other.refresh()
    assert other.get("b") == record("b") and len(lines(path)) == 3


def add_many(path: Path, name: str) -> None:
    store = Store(path)
    for k in range(20):
        store.add(record(f"{name}{k}"))
        store.add(record(f"both{k}"))


def test_two_runs_may_write_at_once(tmp_path):
    path = tmp_path / "store.jsonl"
    with ThreadPoolExecutor(2) as writers:  # the lock belongs to the open file, not to the process
        for done in [writers.submit(add_many, path, name) for name in "xy"]:
            done.result()
    assert len(lines(path)) == 61 and len(Store(path)) == 60


@given(st.integers(0, 2**32 - 1), st.floats(0, 1, width=32))
def test_a_key_tells_seed_and_attributes(seed, value):
    units = np.full((2, 23), value, np.float32)
    key = evaluation_key("c", units, seed)
    assert key == evaluation_key("c", units.copy(), np.uint32(seed)) and len(key) == 64
    assert key != evaluation_key("d", units, seed) and key != evaluation_key("c", units, seed + 1)
    changed = units.copy()
    changed[1, 22] = np.nextafter(changed[1, 22], np.float32(2))
    assert key != evaluation_key("c", changed, seed)
    assert key != evaluation_key("c", units.reshape(1, 46), seed)


def test_canonical_json_by_hand():
    # printf '{"a":[1,null],"b":0.5}' | sha256sum
    wanted = "e538351ae63f53e363c30268d420c1326bbb521f9654b990125d44fa23340bdc"
    assert digest({"b": 0.5, "a": [1, None]}) == wanted
    assert len(engine()) == 16


def test_a_configuration_is_all_that_decides_a_reward(tmp_path):
    config = camvid_config("smoke")

    def name(config=config, target=TARGET, side="reward", truth=TRUTH):
        return about(config, config.reward, target, side, truth)["config"]

    stage = config.reward
    others = [
        name(replace(config, reward=replace(stage, shots=3))),
        name(replace(config, reward=replace(stage, train=replace(stage.train, steps=13)))),
        name(replace(config, renderer="opengl")),
        name(replace(config, asset_fraction=0.5)),
        name(target=TARGET._replace(table="cityscapes")),
        name(target=TARGET._replace(reward_names=("a", "x"))),
        name(side="test"),
        name(truth=TRUTH._replace(labels=TRUTH.labels + 1)),
    ]
    assert len({name(), *others}) == 1 + len(others)
    free = replace(config, seed=5, out=tmp_path, workers=7, seeds=9, store=tmp_path / "s")
    assert name(free) == name()


def test_own_assets_are_told_by_their_files(tmp_path):
    (tmp_path / "car").mkdir()
    (tmp_path / "car" / "a.obj").write_text("v 0 0 0")
    before = folder_digest(tmp_path)
    assert before == folder_digest(tmp_path) != folder_digest(tmp_path, pattern="*.py")
    (tmp_path / "car" / "a.obj").write_text("v 0 0 1")
    assert folder_digest(tmp_path) != before


def test_known_evaluations_are_not_made_again(tmp_path):
    store = Store(tmp_path / "store.jsonl")
    first = dict(evaluator(store).map(scored, jobs(1, 2, 1)))
    assert len(store) == 2 and {o.reward for o in first.values()} == {0.6}
    assert [first[k].stored for k in range(3)] == [False, False, True]
    again = dict(evaluator(Store(store.path)).map(never, jobs(2, 1)))
    assert all(o.stored and o.reward == 0.6 and o.class_iou == [0.6, 0.6] for o in again.values())
    kept = store.records[0]
    assert kept["centre"] == [0.5] * 23 and kept["width"] == [1.0] * 23 and kept["seed"] == 1
    assert (kept["side"], kept["size"], kept["render_seconds"]) == ("reward", "64x48", 0.1)


def test_without_a_store_everything_is_evaluated():
    found = dict(evaluator(None).map(scored, jobs(1, 1)))
    assert [found[k].stored for k in range(2)] == [False, False]


def test_a_failed_evaluation_is_kept_as_failed(tmp_path):
    store = Store(tmp_path / "store.jsonl")
    for evaluate in (diverge, never):
        ((_, outcome),) = evaluator(store).map(evaluate, jobs(3))
        assert math.isnan(outcome.reward) and outcome.failed == "the loss is nan"
    assert store.records[0]["reward"] is None


def test_a_nan_reward_is_no_evaluation(tmp_path):
    store = Store(tmp_path / "store.jsonl")
    nothing = SimpleNamespace(reward=math.nan)
    ((_, outcome),) = evaluator(store).map(lambda *task: nothing, jobs(3))
    assert math.isnan(outcome.reward) and outcome.failed is None and len(store) == 0


def test_an_attempt_passes_other_errors_on():
    with pytest.raises(AssertionError, match="known"):
        attempt(never)


def test_a_second_search_takes_its_rewards_from_the_store(tmp_path, monkeypatch):
    config = camvid_config("smoke")
    search = replace(config.search, method="random_search")
    results = []
    for run, evaluate in (("one", scored), ("two", never)):
        monkeypatch.setattr(search_module, "evaluate", evaluate)
        folder = RunFolder(replace(config, search=search, out=tmp_path / run), "camvid")
        results.append(
            search_module.search(
                replace(config, search=search), TARGET, TRUTH, folder, WorkerPool(0),
                Progress(1, stream=io.StringIO()), 1.0, Store(tmp_path / "store.jsonl"),
            )
        )  # fmt: skip
        folder.close()
    np.testing.assert_array_equal(*(result.rewards for result in results))
    logs = [lines(tmp_path / run / "evaluations.jsonl") for run in ("one", "two")]
    assert [{**r, "elapsed": 0} for r in logs[0]] == [{**r, "elapsed": 0} for r in logs[1]]
    # The store tells what was proposed: a bin's interval for each attribute.
    stored = Store(tmp_path / "store.jsonl").records
    assert len(stored) == 12 and stored[0]["width"] == [0.2] * 23
    bins = np.array(logs[0][0]["actions"])
    np.testing.assert_allclose(stored[0]["centre"], (bins + 0.5) / 5, atol=1e-6)
    assert isinstance(results[0].argmax, sdr_jax.Proposal)


def refused(capsys, *arguments) -> str:
    with pytest.raises(SystemExit) as ended:
        main([str(a) for a in arguments])
    captured = capsys.readouterr()
    assert ended.value.code == 2 and captured.err.count("\n") == 1 and captured.out == ""
    return captured.err


def written(path: Path, *records: dict) -> Path:
    store = Store(path)
    for r in records:
        store.add(r)
    return path


def test_show_counts_by_configuration(tmp_path, capsys):
    path = written(
        tmp_path / "s.jsonl", record("a", 0.1), record("b", 0.3), record("c", None),
        record("d", 0.5, config="other"),
    )  # fmt: skip
    assert main(["show", str(path)]) == 0
    first, one, other = capsys.readouterr().out.splitlines()
    assert "4 evaluations of 23 attributes" in first
    assert "3 evaluations, 1 failed" in one and "best 30.00, mean 20.00" in one
    assert "1 evaluations, 0 failed" in other and "best 50.00" in other


def test_merge_folds_duplicates(tmp_path, capsys):
    a = written(tmp_path / "a.jsonl", record("x"), record("y"))
    (tmp_path / "run").mkdir()
    written(tmp_path / "run" / "store.jsonl", record("y", train_seconds=9.0), record("z", None))
    out = tmp_path / "c.jsonl"
    assert main(["merge", str(a), str(tmp_path / "run"), "--out", str(out)]) == 0
    assert "3 evaluations" in capsys.readouterr().out
    assert [r["key"] for r in Store(out).records] == ["x", "y", "z"]
    assert "exists already" in refused(capsys, "merge", a, "--out", out)


def test_merge_refuses_two_values_for_one_key_and_names_both(tmp_path, capsys):
    a = written(tmp_path / "a.jsonl", record("x", 0.25))
    b = written(tmp_path / "b.jsonl", record("w"), record("x", 0.75))
    error = refused(capsys, "merge", a, b, "--out", tmp_path / "c.jsonl")
    assert f"{a}: line 2 and {b}: line 3" in error and "0.250000 and 0.750000" in error
    assert not (tmp_path / "c.jsonl").exists()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (json.dumps({**HEADER, "attributes": ["light", "fog"]}), "another space: 2 attributes"),
        (json.dumps({**HEADER, "attributes": list(reversed(NAMES))}), "in another order"),
        (json.dumps({"update": 0}), "is no store of evaluations"),
        (json.dumps(HEADER) + "\nno JSON", "line 2 is not JSON"),
        (json.dumps(HEADER) + "\n[1]", "line 2 is no JSON object"),
        (json.dumps(HEADER) + '\n{"key": 1}', "line 2: key must be of type str"),
        (json.dumps(HEADER) + "\n" + json.dumps(record(reward=None, failed=None)), "one of the"),
        (json.dumps(HEADER) + "\n" + json.dumps(record(centre=[0.5])), "centre must hold 23"),
    ],
)
def test_other_files_are_refused_in_one_line(text, complaint, tmp_path, capsys):
    path = tmp_path / "other.jsonl"
    path.write_text(text + "\n")
    error = refused(capsys, "show", path)
    assert str(path) in error and complaint in error
    assert path.read_text() == text + "\n"


def test_files_that_are_not_there_are_refused(tmp_path, capsys):
    assert "no such store" in refused(capsys, "show", tmp_path / "none.jsonl")
    assert "only if --store named it" in refused(capsys, "show", tmp_path)
    assert "merge needs --out" in refused(capsys, "merge", tmp_path)
