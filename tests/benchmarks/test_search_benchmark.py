"""The analytic problems are exact, anyone's problem can be searched, and methods are ranked."""

import json
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sdr_jax
from benchmarks.problems import GROUPS, analytic, grouped_space, tabular
from benchmarks.ranking import behind, mean_ranks
from benchmarks.rivals import METHODS
from benchmarks.search import PROBLEMS, Task, batches, evaluate, main, trace
from sdr_jax.bins import random_bins

FOREIGN = ["products", "ridge", "categories", "binary"]
TWO = sdr_jax.space(["a", "b"], bins=[2, 4])


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name != "camvid"])
def test_values_are_means_over_the_intervals_from_0_to_100(name: str) -> None:
    problem = PROBLEMS[name](3)
    size = problem.space.attributes
    assert tuple(map(len, problem.space.groups)) == GROUPS or name in FOREIGN[2:]
    rng = np.random.default_rng(0)
    intervals = rng.uniform(size=size), rng.uniform(0.05, 1, size)
    proposal = sdr_jax.slide(*(jnp.asarray(part, jnp.float32) for part in intervals))
    offsets = rng.uniform(-0.5, 0.5, (4000, size))
    units = jnp.asarray(np.asarray(proposal.centre) + np.asarray(proposal.width) * offsets)
    points = sdr_jax.Proposal(units, jnp.zeros_like(units))
    sampled = np.asarray(problem.reward(jax.random.key(1), points))
    error = (50 if name == "ridge" else 5) * sampled.std() / np.sqrt(len(sampled))  # of 64 points
    assert problem.true_value(proposal) == pytest.approx(sampled.mean(), abs=error)
    problem = PROBLEMS[name](1)
    everything = sdr_jax.relax(problem.space, jnp.full(size, -1))
    assert problem.true_value(everything) == pytest.approx(0, abs=1e-3)
    assert evaluate("random_attributes", problem, 1, 0) == pytest.approx(0, abs=1e-3)
    proposals = sdr_jax.relax(problem.space, random_bins(jax.random.key(0), problem.space, 2000))
    assert float(problem.reward(jax.random.key(0), proposals).max()) < 100.01 + 5 * problem.noise


def test_a_product_by_hand() -> None:
    """v = u_0 u_1 on one pair: the mean of a product of independent values."""
    space, functions = grouped_space(), np.zeros((23, 24, 400))
    i, j = space.groups[1]
    functions[i, 1 + j] = functions[j, 1 + i] = (np.arange(400) + 0.5) / 400
    problem = analytic(space, functions)
    centre = jnp.full(23, 0.5).at[i].set(0.8).at[j].set(0.6)
    value = problem.true_value(sdr_jax.Proposal(centre, jnp.full(23, 0.1)))
    assert value == pytest.approx(100 * (0.8 * 0.6 - 0.25) / (0.95**2 - 0.25), rel=1e-3)


@pytest.mark.parametrize("name", METHODS)
def test_a_problem_of_ones_own_needs_no_jax(name: str) -> None:
    """Two attributes, two and four bins, and a table in NumPy."""
    table = np.asarray([[0, 0, 0, 0], [0, 0, 5, 0]], np.float64)

    def value(proposal: sdr_jax.Proposal) -> float:
        a, b = (int(c * k) for c, k in zip(proposal.centre, table.shape, strict=True))
        return float(table[a, b])

    def reward(rng_key: jax.Array, proposals: sdr_jax.Proposal) -> np.ndarray:
        assert not isinstance(proposals.centre, jax.core.Tracer)
        return np.asarray([value(sdr_jax.Proposal(*p)) for p in zip(*proposals, strict=True)])

    problem = SimpleNamespace(space=TWO, reward=reward, true_value=value)
    reached = evaluate(name, problem, 8, 0)
    assert reached in (0.0, 5.0) and evaluate(name, problem, 8, 0) == reached


def test_a_table_gives_the_mean_of_the_entries_that_intervals_cover() -> None:
    table = np.arange(8.0).reshape(2, 4)
    problem = tabular(TWO, table)
    for place in np.ndindex(2, 4):
        assert problem.true_value(sdr_jax.relax(problem.space, np.asarray(place))) == table[place]
    wide = sdr_jax.Proposal(jnp.asarray([0.5, 0.25]), jnp.asarray([1.0, 0.5]))
    assert problem.true_value(wide) == (0 + 1 + 4 + 5) / 4
    both = sdr_jax.relax(problem.space, np.asarray([[0, 3], [1, 0]]))
    assert problem.reward(jax.random.key(0), both).tolist() == [3.0, 4.0]
    assert evaluate("surrogate", problem, 20, 0) == 7.0


def test_recommendations_on_the_way_are_those_of_shorter_searches() -> None:
    problem = PROBLEMS["smooth"](0)
    course = trace("gaussian", problem, 20, 3, (10, 15, 20))
    assert set(course.values) == {10, 15, 20}
    for evaluations, value in course.values.items():
        assert value == evaluate("gaussian", problem, evaluations, 3)


def test_the_command_line_writes_rows(tmp_path, capsys) -> None:
    path, plot = tmp_path / "search.json", tmp_path / "search.png"
    flags = "--seeds 2 --evaluations 10 --problems smooth --workers 0".split()
    flags += ["--methods", "random_search", "gaussian"]
    assert main([*flags, "--json", str(path), "--plot", str(plot)]) == 0
    assert plot.read_bytes().startswith(b"\x89PNG")
    written = json.loads(path.read_text())
    assert written["default"] in METHODS
    assert [row["method"] for row in written["rows"]] == ["random_search", "gaussian"]
    columns = {"method", "problem", "evaluations", "mean", "se", "seconds_per_update"}
    assert set(written["rows"][0]) == columns
    assert list(written["mean_rank"].values()) == sorted(written["mean_rank"].values())
    assert "| gaussian" in capsys.readouterr().out


@pytest.mark.parametrize(("call", "culprit"), [
    (("simulated_annealing", 50), "unknown method 'simulated_annealing'"),
    (("gaussian", 1), "at least 2 data sets per update"), (("random_search", 0), "evaluations is 0"),
])  # fmt: skip
def test_bad_calls_are_refused(call: tuple, culprit: str) -> None:
    with pytest.raises(ValueError, match=culprit):
        evaluate(call[0], PROBLEMS["smooth"](0), call[1], 0)


VALUES = {
    ("random_search", "p"): np.asarray([[1.0, 3.0], [4.0, 4.0]]),
    ("ours", "p"): np.asarray([[3.0, 5.0], [4.0, 4.0]]),
    ("tpe", "p"): np.asarray([[0.0, 2.0], [6.0, 8.0]]),
}


def test_ranks_and_differences_to_the_best_rival_by_hand() -> None:
    # First column: ours 4, random 2, tpe 1; second: tpe 7, the others 4 each.
    assert mean_ranks(VALUES) == {"ours": 1.75, "tpe": 2.0, "random_search": 2.25}
    first, second = behind(VALUES, "ours", (50, 100))
    assert (first["best rival"], first["difference"], first["se"]) == ("random_search", 2.0, 0.0)
    assert first["in se"] is None  # no spread to measure by
    assert (second["best rival"], second["difference"]) == ("tpe", -3.0)
    assert second["in se"] == pytest.approx(-3.0)
    assert behind(VALUES, "nobody", (50, 100)) == []


def test_one_process_has_all_problems_of_a_method_that_compiles() -> None:
    tasks = [Task(m, p, (4,), 1) for m in ("sdr", "tpe") for p in ("smooth", "ridge")]
    batch_tasks = [[(task.method, task.problem) for task in batch] for batch in batches(tasks)]
    assert batch_tasks == [
        [("tpe", "smooth")], [("tpe", "ridge")], [("sdr", "smooth"), ("sdr", "ridge")],
    ]  # fmt: skip


def test_a_plot_that_cannot_be_written_is_refused_first(capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        main(["--plot", "/no/such/folder/x.png"])
    assert "must be a file in an existing folder" in capsys.readouterr().err
