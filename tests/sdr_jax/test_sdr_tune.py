"""Simulators that are programs: how they run, what can fail, and runs that are interrupted."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from signal import SIG_DFL, SIGHUP, SIGINT, SIGKILL, SIGTERM, default_int_handler
from subprocess import PIPE, Popen, TimeoutExpired

import numpy as np
import pytest

from common.files import read_json
from sdr_jax import Proposal, Trial
from sdr_jax.tune import search
from sdr_jax.tune import simulator as simulators
from sdr_jax.tune.__main__ import main
from sdr_jax.tune.search import outage
from sdr_jax.tune.settings import read
from sdr_jax.tune.simulator import PLACEHOLDER, Simulator, parse_score
from sdr_jax.tune.units import Attribute, describe, physical
from tests.conftest import ROOT, gone, wait_for_lines

EXAMPLE = ROOT / "examples" / "tune"
TWO = '[[attributes]]\nname = "a"\n[[attributes]]\nname = "b"\nlow = 2\nhigh = 200\nlog = true\n'
SMALL = 'method = "random_search"\nevaluations = 6\ndatasets_per_update = 3\n' + TWO
SCORED = "import json, sys\nat = json.load(open(sys.argv[1]))\na = at['attributes']['a']\n"
A = '[[attributes]]\nname = "a"\n'
SDR = 'method = "sdr"\nevaluations = 40\ngroups = [["a"], ["b"]]\n' + TWO + "[method_options]\n"
GAUSSIAN = 'method = "gaussian"\n' + TWO + "[method_options]\n"
TRUE = ["--", "true", PLACEHOLDER]
LOG = "evaluations.jsonl"


def program(folder: Path, code: str) -> list[str]:
    path = folder / "simulator.py"
    path.write_text(SCORED + code)
    return [sys.executable, "-S", str(path), PLACEHOLDER]


def toml(folder: Path, text: str = SMALL) -> Path:
    path = folder / "space.toml"
    path.write_text(text, encoding="latin-1")
    return path


class Runs:
    """Runs in this process, in one folder."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture) -> None:
        self.folder, self.out, self._capsys = folder, folder / "run", capsys

    def arguments(self, *options: str, text: str = SMALL, code: str = "print(1)") -> list[str]:
        space = str(toml(self.folder, text))
        return [space, "--out", str(self.out), *options, "--", *program(self.folder, code)]

    def done(self, *options: str, **content: str) -> str:
        """Run to the end, and return what is printed."""
        assert main(self.arguments(*options, **content)) == 0
        return self._capsys.readouterr().out

    def refused(self, *arguments: str, code: int = 2) -> str:
        """Run, and return the one line of the error."""
        try:
            returned = main(arguments)
        except SystemExit as end:  # argparse
            returned = end.code
        error = self._capsys.readouterr().err
        assert returned == code and error.count("\n") == 1
        return error

    def lines(self) -> list[dict]:
        return [json.loads(line) for line in (self.out / LOG).read_text().splitlines()]


@pytest.fixture
def runs(tmp_path: Path, capsys: pytest.CaptureFixture) -> Runs:
    return Runs(tmp_path, capsys)


def test_physical_values_worked_out_by_hand() -> None:
    linear, log = Attribute("a", low=-8.0, high=8.0), Attribute("a", low=0.01, high=100.0, log=True)
    assert physical(linear, 0.25) == -4 and physical(log, 0.5) == 1
    for a in (linear, log):
        assert [physical(a, end) for end in (0.0, 1.0)] == pytest.approx([a.low, a.high])
    road = Attribute("road", 3, values=("dry", "wet", "snow"))
    attributes = (
        Attribute("x", low=10.0, high=30.0),
        Attribute("y"),
        road,
        replace(road, name="all"),
    )
    units = np.float32([0.35, 0.5, 0.5, 0.5]), np.float32([0.1, 1.0, 1 / 3, 1])
    described = describe(attributes, Proposal(*units))
    assert described.pop("road")["values"] == ["wet"]
    assert described == {
        "x": {"unit": {"centre": 0.35, "width": 0.1}, "centre": 17.0, "low": 16.0, "high": 18.0},
        "y": {"unit": {"centre": 0.5, "width": 1.0}, "centre": 0.5, "low": 0.0, "high": 1.0},
        "all": {"unit": {"centre": 0.5, "width": 1.0}, "values": [*road.values]},
    }


@pytest.mark.parametrize("log", [False, True])
def test_rounding_leaves_no_value_outside_its_range(log: bool) -> None:
    for low, high in ((np.pi / 4, np.pi), (np.e, 10 / 3), (1 / 3, 2 / 3)):
        ends = Attribute("x", low=low, high=high, log=log)
        assert all(low <= physical(ends, unit) <= high for unit in np.linspace(0, 1, 21))


@pytest.mark.parametrize(
    "line",
    ["", "nan", "inf", "-inf", "1e300", "done", "[1]", '{"score": "1"}', '{"score": true}']
    + ['{"score": NaN}', '{"score": 1e999}', '{"result": 1}', "1,5", "{" * 10000],
)
def test_any_score_survives_printing_and_other_lines_are_refused(line: str) -> None:
    for score in (0.1, -3, 1e-30, -1e15, 0):
        both = parse_score(str(score)), parse_score(json.dumps({"score": score, "other": []}))
        assert both == (score, score) and all(type(read) is float for read in both)
    with pytest.raises(simulators._Failed):
        parse_score(line)


def run_one(folder: Path, code: str, **options):
    options = {"timeout": 20.0, "retries": 0, "repeats": 1} | options
    out = folder / "evaluations"
    simulator = Simulator(program(folder, code), (Attribute("a"),), out, **options)
    proposal = Proposal(np.float32([0.5]), np.float32([0.1]))
    try:
        return simulator.evaluate(Trial(7, proposal, 123)), out / "000007"
    finally:
        simulator.stop()


def test_the_last_line_is_the_score_and_each_run_has_a_folder_and_a_seed(tmp_path: Path) -> None:
    code = "print('hello')\nprint(a['centre'], end='\\n\\n  \\n')"
    outcome, folder = run_one(tmp_path, code, repeats=2)
    assert (outcome.score, outcome.scores, outcome.failures) == (0.5, [0.5, 0.5], [])
    one, two = (read_json(folder / f"run-{k}-0/attributes.json") for k in range(2))
    assert one["evaluation"] == 7 and 0 <= one["seed"] != two["seed"] < 2**32
    # So has a retry.
    code = f"print(5) if at['seed'] != {one['seed']} else sys.exit('no')"
    outcome, _ = run_one(tmp_path, code, retries=1)
    assert (outcome.score, outcome.failures) == (5.0, ["exit code 1: no"])


@pytest.mark.parametrize(("code", "reason"), [
    ("sys.exit('the lamp\\nis broken')", "exit code 1: is broken"),
    ("print(1); sys.exit(3)", "exit code 3"),
    ("import os; os.kill(os.getpid(), 11)", "killed by SIGSEGV"),
    ("pass", "printed nothing"),
    ("print('done')", "the last line printed is 'done', but must be a number"),
    ("print(float('nan'))", "must be finite"),
    ("print(-1e31)", "printed is '-1e+31', but a score must be finite, within +-1e+15"),
])  # fmt: skip
def test_a_failed_run_says_why(tmp_path: Path, code: str, reason: str) -> None:
    outcome, _ = run_one(tmp_path, code, retries=1)
    assert outcome.score is None and len(outcome.failures) == 2 and reason in outcome.failures[0]


@pytest.mark.parametrize(("then", "failures"), [
    ("child.wait()", ["no score after 1.5 s"]), ("print(1)", []), ("sys.exit(3)", ["exit code 3"]),
])  # fmt: skip
def test_however_a_run_ends_its_children_end_too(tmp_path: Path, then, failures) -> None:
    pid = tmp_path / "pid"
    code = (
        "import subprocess\nchild = subprocess.Popen(['sleep', '300'])\n"
        f"open({str(pid)!r}, 'w').write(str(child.pid))\n{then}"
    )
    outcome, _ = run_one(tmp_path, code, timeout=1.5)
    assert outcome.failures == failures
    assert gone(int(pid.read_text()))


@pytest.mark.parametrize(("writes", "messages"), [(b"", 3), (b"at work", 0)])
def test_a_simulator_that_prints_nothing_is_reported(tmp_path: Path, writes, messages) -> None:
    class Process(Popen):
        """Ends at the fourth poll."""

        polls = 0

        def __init__(self) -> None:
            pass

        def wait(self, seconds: float) -> int:
            self.polls += 1
            output.write(writes)
            if self.polls > 3:
                return 0
            raise TimeoutExpired("simulator", seconds)

    printed: list[str] = []
    simulator = Simulator([], [], tmp_path, 1000.0, 0, 1, say=printed.append)
    with open(tmp_path / "output", "wb", buffering=0) as output:
        assert simulator._wait(Process(), 7, [output.fileno()]) == 0
    simulator.stop()
    assert (
        printed == ["evaluation 7 has run for 0 s and printed nothing in the last 60 s"] * messages
    )


def test_silence_is_a_line_of_progress(runs: Runs, monkeypatch) -> None:
    monkeypatch.setattr(simulators, "SILENCE", 0.2)
    printed = runs.done(code="import time; time.sleep(0.5); print(1)")
    line = r"^evaluation 0 has run for \d+ s and printed nothing in the last 0 s$"
    assert re.search(line, printed, re.MULTILINE)


def test_a_run_leaves_its_answer_and_is_done_when_called_again(runs: Runs) -> None:
    options = dict(text="minimize = true\n" + SMALL, code="print((a['centre'] - 0.3) ** 2)")
    printed = runs.done("--workers", "2", **options)
    assert "[100 %] update 2/2 | mean" in printed and "attribute" in printed
    answer, before = read_json(runs.out / "answer.json"), (runs.out / LOG).read_bytes()
    scores = {line["id"]: line["score"] for line in runs.lines()}
    assert sorted(scores) == list(range(6)) and answer["best"]["score"] == min(scores.values())
    best = runs.out / f"evaluations/{answer['best']['evaluation']:06d}/run-0-0/attributes.json"
    assert read_json(best)["attributes"] == answer["solution"]  # of random search
    assert (answer["evaluations"], answer["failed"]) == (6, 0)
    # A second call changes nothing; more evaluations continue the run.
    runs.done(**options)
    assert (runs.out / LOG).read_bytes() == before
    assert "resuming" in runs.done("--evaluations", "9", **options)
    assert len(runs.lines()) == 9
    assert "already has 9 evaluations" in runs.refused(*runs.arguments(**options))


def test_the_table_has_the_values_of_attributes_without_an_order(runs: Runs) -> None:
    text = SMALL + '[[attributes]]\nname = "road"\nvalues = ["dry", "wet", "snow"]\n'
    printed = runs.done(text=text, code="print(len(at['attributes']['road']['values']))")
    (line,) = [line.split() for line in printed.splitlines() if line.startswith("road ")]
    answer = read_json(runs.out / "answer.json")
    both = (answer[key]["road"]["values"] for key in ("solution", "spread"))
    assert line == ["road", *map("|".join, both)]


def test_evaluations_without_a_score_are_data_however_many_there_are(runs: Runs) -> None:
    code = "print(a['centre'] if at['evaluation'] % 3 == 0 else 'nonsense')"
    printed = runs.done("--evaluations", "30", "--retries", "0", code=code)
    assert "30 evaluations by random_search, 20 failed" in printed
    assert read_json(runs.out / "answer.json")["failed"] == 20
    assert {line["id"]: line["reward"] is None for line in runs.lines()} == {
        k: k % 3 > 0 for k in range(30)
    }
    runs.out = runs.folder / "other"
    code = "print(1 if at['evaluation'] else 'nonsense')"
    printed = runs.done("--retries", "1", code=code)
    assert "evaluation 0 failed after 2 attempts: the last line printed is 'nonsense'" in printed


# Lines by update, in order: s has a score, f has none.
@pytest.mark.parametrize(("updates", "kept"), [
    ("sss sff fff", 3),  # over several updates
    ("sss sss sf", 6),  # a part of an update
    ("fff fff", 0), ("f", 0), ("sf", 0), ("ssf fff", 0),  # from the first on
    ("sfs sss ffs", 6),  # the last line has a score, and another failed long before
    ("fff sfs fff f", 6),
    ("", None), ("s", None), ("sff sss", None), ("fff s", None),
])  # fmt: skip
def test_a_history_is_cut_where_its_last_failures_begin(updates: str, kept: int | None) -> None:
    history = [
        {"update": update, "reward": {"s": 1.0, "f": None}[letter]}
        for update, letters in enumerate(updates.split())
        for letter in letters
    ]
    assert outage(history) == kept


def failing(down: Path) -> str:
    """A simulator that, while a file exists, fails from the evaluation on whose number is in it."""
    return (
        f"import os\nif os.path.exists({str(down)!r}):\n"
        f"    if at['evaluation'] >= int(open({str(down)!r}).read()): sys.exit('down')\n"
        "print(a['centre'])"
    )


def test_after_an_outage_failures_are_repeated_and_their_lines_are_kept(runs, monkeypatch) -> None:
    monkeypatch.setattr(search, "OUTAGE", 5)
    down = runs.folder / "down"
    code = failing(down)
    options = ["--evaluations", "30"]
    command, again = runs.arguments(*options, code=code), ["--retry-failed", *options]
    assert "no evaluations to repeat; remove --retry-failed" in runs.refused(*again, *command)
    assert not runs.out.exists()
    whole = (runs.done(*options, code=code), (runs.out / "answer.json").read_bytes())[1]
    before = {path: path.read_bytes() for path in runs.out.iterdir() if path.is_file()}
    assert "do not end in failures" in runs.refused(*runs.arguments(*again, code=code))
    assert {path: path.read_bytes() for path in before} == before
    shutil.rmtree(runs.out)

    down.write_text("7")
    assert "the last 8 evaluations failed" in (error := runs.refused(*command, code=1))
    assert "exit code 1: down" in error and "--retry-failed" in error
    failed = (runs.out / LOG).read_bytes().splitlines(keepends=True)[6:]
    assert len(failed) == 9
    # The simulator is still down: the same error, and nothing is lost.
    assert runs.refused(*runs.arguments(*again, code=code), code=1) == error
    down.unlink()
    assert "repeats 9 evaluations" in runs.done(*again, code=code)
    assert (runs.out / "answer.json").read_bytes() == whole
    assert [line["id"] for line in runs.lines()] == list(range(30))
    retried = (runs.out / "retried.jsonl").read_bytes().splitlines(keepends=True)
    assert retried[:9] == failed and len(retried) == 18
    # Its folder of the failed attempt is gone.
    assert [path.name for path in (runs.out / "evaluations/000007").iterdir()] == ["run-0-0"]


def test_the_same_command_resumes_after_many_failures_in_a_row(runs: Runs, monkeypatch) -> None:
    monkeypatch.setattr(search, "OUTAGE", 9)
    code = "print(1) if at['evaluation'] in (0, 22) else sys.exit('infeasible')"
    arguments = runs.arguments("--evaluations", "24", "--retries", "0", code=code)
    assert "infeasible" in runs.refused(*arguments, code=1) and len(runs.lines()) == 12
    assert "infeasible" in runs.refused(*arguments, code=1) and len(runs.lines()) == 21
    assert main(arguments) == 0 and read_json(runs.out / "answer.json")["failed"] == 22


def test_failures_of_an_unfinished_update_say_nothing_of_the_first(runs: Runs) -> None:
    code = "print(1) if at['evaluation'] in (0, 4, 5) else sys.exit('infeasible')"
    options = "--retries", "0"
    runs.done(*options, code=code)
    whole = (runs.out / "answer.json").read_bytes()
    # Interrupted in update 1: as many evaluations have failed (1, 2, 3) as an update has.
    (runs.out / "answer.json").unlink()
    lines = (runs.out / LOG).read_text().splitlines(keepends=True)
    of_second = [line for line in lines if json.loads(line)["id"] == 3]
    (runs.out / LOG).write_text("".join([*lines[:3], *of_second]))
    runs.done(*options, code=code)
    assert (runs.out / "answer.json").read_bytes() == whole


def test_a_folder_can_be_used_after_a_retry_without_a_score(runs: Runs, monkeypatch) -> None:
    monkeypatch.setattr(search, "OUTAGE", 5)
    (down := runs.folder / "down").write_text("1")
    code = failing(down)
    assert "the last 8 evaluations failed" in runs.refused(
        *runs.arguments("--evaluations", "30", code=code), code=1
    )
    down.write_text("0")
    again = runs.arguments("--retry-failed", "--evaluations", "30", code=code)
    assert "all of the first 3 evaluations failed" in runs.refused(*again)
    assert len((runs.out / "retried.jsonl").read_bytes().splitlines()) == 9
    down.unlink()
    runs.done("--evaluations", "6", code=code)


@pytest.mark.parametrize(("code", "timeout", "reason"), [
    ("sys.exit('no licence')", "60", "exit code 1: no licence"),
    ("import time; time.sleep(60)", "0.5", "no score after 0.5 s"),
])  # fmt: skip
def test_a_simulator_that_never_works_is_one_error(runs, code, timeout, reason) -> None:
    options = ["--retries", "0", "--workers", "3", "--timeout"]
    arguments = runs.arguments(*options, timeout, code=code)
    error = runs.refused(*arguments)
    assert "all of the first 3 evaluations failed" in error
    assert reason in error and arguments[-2] in error
    assert not {path.name for path in runs.out.iterdir()} & {LOG, "answer.json"}
    runs.done(*options, "60")  # once the simulator works, so does the same command


@pytest.mark.parametrize(("change", "field"), [
    (("high = 200", "high = 100"), "attributes.b.high = 200.0, not 100.0"),
    (('"random_search"', '"gaussian"'), 'method = "random_search", not "gaussian"'),
    (("evaluations = 6", "evaluations = 6\nseed = 4"), "seed = 0, not 4"),
    (("log = true", 'log = true\n[[attributes]]\nname = "c"'), "attributes ="),
    (None, "command"),
])  # fmt: skip
def test_the_folder_of_another_run_is_refused(runs, change, field) -> None:
    runs.done()
    before = {p: p.read_bytes() for p in runs.out.iterdir() if p.is_file()}
    arguments = runs.arguments(text=SMALL.replace(*change)) if change else [*runs.arguments(), "-x"]
    assert f"--out {runs.out} holds a run with {field}" in runs.refused(*arguments)
    assert {p: p.read_bytes() for p in runs.out.iterdir() if p.is_file()} == before


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path) -> None:
    path = tmp_path / "space.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TWO.encode())
    assert [attribute.name for attribute in read(path, {}).attributes] == ["a", "b"]


@pytest.mark.parametrize(("text", "complaint"), [
    ("", "there are no attributes"), ("attributes = 3", "must be tables"),
    ("[[attributes]]\n", "attribute 1 has no name"),
    ('[[attributes]]\nname = ""', "attribute 1 has an empty name"),
    (A * 2, "given more than once: 'a'"),
    (A + f"high = 1{400 * '0'}", "but must be a number"),
    (A + "bins = 1", "'a': bins is 1, but must lie in 2..1000"),
    (f"evaluations = {10**14}\n" + A, "evaluations 100000000000000 would take 100 PB of memory"),
    (A + "bins = 2.5", "'a': bins is 2.5, but must be a whole number"),
    (A + "bins = true", "bins is True, but must be a whole number"),
    (A + "low = 1", "'a' has low, but not high"),
    (A + "low = 3\nhigh = 3", "low is 3 and high is 3, but low must"),
    (A + "low = nan\nhigh = 3", "low is nan, but must be a number"),
    (A + "low = 0\nhigh = 3\nlog = true", "low is 0, but must be above"),
    (A + 'values = ["dry"]', "'a': values is ['dry'], but must be two or more strings"),
    (A + f"values = {[str(k) for k in range(1001)]}", "has 1001 values, but at most 1000"),
    (A + "values = [1, 2]", "values is [1, 2], but must be two or more strings"),
    (A + "values = 3", "values is 3, but must be a list"),
    (A + 'values = ["x", "x"]', "'a': values has a string twice"),
    ('method = "intervals"\n' + TWO + "[method_options]\nstart = 3", "'start' is unknown"),
    (A + 'values = ["x", "y"]\nbins = 2', "have no order, so bins has no meaning"),
    (A + "max = 1", "'a': key 'max' is unknown; known: name, bins"),
    ('groups = [["a", "b", "c"]]\n' + TWO, "unknown attribute(s) in the groups: 'c'"),
    ('groups = ["a", "b"]\n' + TWO, "groups must be lists of names"),
    ('method = "magic"\n' + TWO, "method 'magic' is unknown; known: surrogate"),
    ("evaluation = 5\n" + TWO, "key 'evaluation' is unknown; known: attributes"),
    ("evaluations = 20\n" + TWO, "multiple of datasets_per_update = 8, such as 16 or 24"),
    ("evaluations = 0\n" + TWO, "evaluations is 0, but must be at least 1"),
    ("relaxation = 2\n" + TWO, "relaxation is 2, but must lie in [0, 1]"),
    (SDR + "updates_per_group = 2", "evaluations is 40, but sdr with updates_per_group = 2 takes"),
    (SDR + "updates_per_group = 5", "the last of 2 groups; use more than 40, or a smaller updates_"),
    (SDR.replace("40", "8"), "evaluations is 8, with which sdr never reaches the last of 2 groups; use 16"),
    (GAUSSIAN + "speed = 1", "option of gaussian 'speed' is"),
    (GAUSSIAN + "std = 'x'", "std is 'x', but must be a"),
    (GAUSSIAN + "std = -7", "method gaussian: std is -7"),
    ('method = "tpe"\n' + TWO, "method 'tpe' is unknown; known: surrogate"),
    ('method = "gaussian"\ndatasets_per_update = 1\n' + TWO, "leave_one_out needs at least 2"),
    ("name = ", "is not TOML"), ("\xff\xfe", "is not TOML"), ("a = " + "[" * 5000, "is not TOML"),
    ("#" * 1_000_001, "space.toml has more than 1,000,000 bytes"),
])  # fmt: skip
def test_a_bad_file_is_one_error_and_nothing_is_written(runs: Runs, text, complaint) -> None:
    error = runs.refused(*runs.arguments(text=text))
    assert complaint in error and "error: " in error
    assert "space.toml" in error or "method " in error
    assert not runs.out.exists()


@pytest.mark.parametrize(("arguments", "complaint"), [
    (["--", "true"], "no argument of the simulator contains {attributes.json}"),
    ([], "add the simulator at the end"),
    (["--", "./absent", PLACEHOLDER], "the simulator ./absent does not exist"),
    (["--", "./space.toml", PLACEHOLDER], "is not executable; try chmod +x"),
    (["--evaluations", "7", *TRUE], "--evaluations is 7, but must be a mul"),
    (["--timeout", "-1", *TRUE], "--timeout is -1, but must be above 0"),
    (["--seed", "x", *TRUE], "argument --seed: invalid int value: 'x'"),
    (["--sed", "1", *TRUE], "no option --sed; did you mean --seed?"),
    (["absent.toml", *TRUE], "absent.toml: No such file or directory; expected a TOML file with"),
])  # fmt: skip
def test_a_bad_command_line_is_one_error(runs: Runs, monkeypatch, arguments, complaint) -> None:
    monkeypatch.chdir(runs.folder)
    toml(runs.folder)
    space = [] if "absent.toml" in arguments else ["space.toml"]
    assert complaint in runs.refused(*space, *arguments)
    assert [p.name for p in runs.folder.iterdir()] == ["space.toml"]
    # 40 evaluations are five updates of two groups.
    assert read(toml(runs.folder, SDR), {}).method_options["updates_per_group"] == 3


def test_the_example_killed_and_continued_ends_with_the_same_answer(runs: Runs) -> None:
    answer, log = runs.out / "answer.json", runs.out / LOG
    options = [
        "--out",
        str(runs.out),
        "--method",
        "gaussian",
        "--evaluations",
        "16",
        "--workers",
        "2",
    ]
    simulator = [sys.executable, str(EXAMPLE / "simulator.py"), PLACEHOLDER]
    command = [str(EXAMPLE / "space.toml"), *options, "--", *simulator]
    assert main(command) == 0
    whole = answer.read_bytes()
    answer.unlink()
    log.write_bytes(log.read_bytes()[: 2 * log.stat().st_size // 3])  # as a kill may leave it
    assert main(command) == 0
    assert answer.read_bytes() == whole and len(runs.lines()) == 16


# What a shell runs in the background is in its group.
WAITING = """grep -q '"evaluation": 0' "$1" && echo 1 && exit
sleep 300 & echo $! $$ >> PIDS; wait"""


@pytest.mark.parametrize("number", [SIGINT, SIGTERM, SIGHUP, SIGKILL], ids=lambda s: s.name)
def test_no_signal_leaves_a_simulator_and_the_folder_is_locked_until_then(
    runs: Runs, number
) -> None:
    pids = runs.folder / "pids"
    simulator = ["sh", "-c", WAITING.replace("PIDS", str(pids)), "sh", PLACEHOLDER]
    options = ["--out", str(runs.out), "--workers", "3"]
    arguments = [str(toml(runs.folder)), *options, "--", *simulator]
    # Shells start background jobs with SIGINT ignored, `nohup` with SIGHUP, and children inherit that.
    before = {s: signal.signal(s, d) for s, d in ((SIGINT, default_int_handler), (SIGHUP, SIG_DFL))}
    command = [sys.executable, "-m", "sdr_jax.tune", *arguments]
    process = Popen(command, cwd=ROOT, stdout=PIPE, stderr=PIPE, text=True)
    for s, handler in before.items():
        signal.signal(s, handler)
    wait_for_lines(process, runs.out / LOG, 1)
    wait_for_lines(process, pids, 2)
    assert "is in use by another run" in runs.refused(*arguments)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert process.returncode == (130 if number in (SIGINT, SIGTERM) else -number), error
    if process.returncode == 130:
        assert error.strip() == "stopped; the same command resumes"
    assert all(gone(int(pid)) for pid in pids.read_text().split()) and len(runs.lines()) == 1


def test_without_process_groups_there_is_no_supervisor(runs, monkeypatch) -> None:
    """As on Windows, where a simulator that a kill leaves running is not ended."""
    monkeypatch.delattr(os, "killpg")
    started, popen = [], subprocess.Popen
    monkeypatch.setattr(
        subprocess,
        "Popen",
        lambda command, **options: started.append(command) or popen(command, **options),
    )
    runs.done()
    assert len(started) >= 6 and not any(simulators.SUPERVISOR in command for command in started)
