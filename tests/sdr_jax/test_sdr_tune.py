"""Simulators that are programs: how they are run, what goes wrong, and runs that are cut short."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Proposal
from sdr_jax.ask_tell import Trial
from sdr_jax.tune import simulator as simulators
from sdr_jax.tune.__main__ import main as command_line
from sdr_jax.tune.settings import read
from sdr_jax.tune.simulator import PLACEHOLDER, Simulator, parse_score
from sdr_jax.tune.units import Attribute, describe, physical
from shell.errors import UserError

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "tune"
TWO = '[[attributes]]\nname = "a"\n[[attributes]]\nname = "b"\nlow = 2\nhigh = 200\nlog = true\n'
SMALL = 'method = "random_search"\nevaluations = 6\ndatasets_per_update = 3\n' + TWO
SCORED = "import json, sys\nat = json.load(open(sys.argv[1]))\na = at['attributes']['a']\n"


def main(arguments: list[str]) -> int:
    try:
        return command_line(arguments)
    except SystemExit as end:  # argparse
        return int(end.code)


def program(folder: Path, code: str) -> list[str]:
    path = folder / "simulator.py"
    path.write_text(SCORED + code)
    return [sys.executable, "-S", str(path), PLACEHOLDER]


def toml(folder: Path, text: str = SMALL) -> Path:
    path = folder / "space.toml"
    path.write_text(text)
    return path


def lines(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "evaluations.jsonl").read_text().splitlines()]


# ---- units and the file that the simulator reads


def test_physical_values_worked_out_by_hand() -> None:
    assert physical(Attribute("a", low=-8.0, high=8.0), 0.25) == -4
    assert physical(Attribute("a", low=0.01, high=100.0, log=True), 0.5) == 1
    both = (Attribute("x", low=10.0, high=30.0), Attribute("y"))
    told = describe(both, Proposal(np.float32([0.35, 0.5]), np.float32([0.1, 1.0])))
    assert told == {
        "x": {"unit": {"centre": 0.35, "width": 0.1}, "centre": 17.0, "low": 16.0, "high": 18.0},
        "y": {"unit": {"centre": 0.5, "width": 1.0}, "centre": 0.5, "low": 0.0, "high": 1.0},
    }


@given(st.floats(1e-6, 1e6), st.floats(1.01, 1e6), st.booleans(), st.floats(0, 1), st.floats(0, 1))
def test_physical_values_rise_and_stay_in_the_range(low, factor, log, one, other) -> None:
    attribute = Attribute("a", low=low, high=low * factor, log=log)
    first, second = (physical(attribute, unit) for unit in sorted((one, other)))
    slack = 1 + 1e-9
    assert attribute.low / slack <= first <= second <= attribute.high * slack


# ---- scores


@pytest.mark.parametrize(
    ("line", "score"),
    [("0.5", 0.5), ("-3", -3.0), ("1e3", 1000.0), ('{"score": 2, "other": []}', 2.0)],
)
def test_scores_are_read(line: str, score: float) -> None:
    assert parse_score(line) == score


@given(st.floats(-1e30, 1e30))
def test_any_score_survives_printing(score: float) -> None:
    assert parse_score(str(score)) == parse_score(json.dumps({"score": score})) == score


@pytest.mark.parametrize(
    "line",
    ["", "nan", "inf", "-inf", "1e300", "done", "[1]", '{"score": "1"}', '{"score": true}']
    + ['{"score": NaN}', '{"score": 1e999}', '{"result": 1}', "1,5", "{" * 10000],
)
def test_rubbish_is_no_score(line: str) -> None:
    with pytest.raises(simulators._Failed):
        parse_score(line)


# ---- the program


def run_one(folder: Path, code: str, **options):
    options = {"timeout": 20.0, "retries": 0, "repeats": 1} | options
    out = folder / "evaluations"
    simulator = Simulator(program(folder, code), (Attribute("a"),), out, **options)
    proposal = Proposal(np.float32([0.5]), np.float32([0.1]))
    return simulator.evaluate(Trial(7, proposal, 123)), out / "000007"


def test_the_last_line_is_the_score_and_each_run_has_a_folder(tmp_path: Path) -> None:
    code = "print('hello')\nprint(a['centre'], end='\\n\\n  \\n')"
    outcome, folder = run_one(tmp_path, code, repeats=2)
    assert (outcome.score, outcome.scores, outcome.failures) == (0.5, [0.5, 0.5], [])
    tasks = [json.loads((folder / f"run-{k}-0/attributes.json").read_text()) for k in range(2)]
    assert tasks[0]["evaluation"] == 7 and tasks[0]["seed"] != tasks[1]["seed"]
    assert all(0 <= task["seed"] < 2**32 for task in tasks)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("sys.exit('the lamp\\nis broken')", "exit code 1: is broken"),
        ("print(1); sys.exit(3)", "exit code 3"),
        ("import os; os.kill(os.getpid(), 11)", "killed by SIGSEGV"),
        ("pass", "printed nothing"),
        ("print('done')", "the last line printed is 'done', but must be a number"),
        ("print(float('nan'))", "must be finite"),
    ],
)
def test_a_failed_run_says_why(tmp_path: Path, code: str, reason: str) -> None:
    outcome, _ = run_one(tmp_path, code, retries=1)
    assert outcome.score is None
    assert len(outcome.failures) == 2 and reason in outcome.failures[0]


def test_a_retry_has_another_seed(tmp_path: Path) -> None:
    first, folder = run_one(tmp_path, "sys.exit(1)", retries=1)
    seed = json.loads((folder / "run-0-0/attributes.json").read_text())["seed"]
    code = f"print(5) if at['seed'] != {seed} else sys.exit('no')"
    outcome, _ = run_one(tmp_path, code, retries=1)
    assert (first.score, outcome.score, outcome.failures) == (None, 5.0, ["exit code 1: no"])


def test_a_time_out_ends_the_children_too(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    code = (
        "import subprocess\nchild = subprocess.Popen(['sleep', '300'])\n"
        f"open({str(pid)!r}, 'w').write(str(child.pid))\nchild.wait()"
    )
    outcome, _ = run_one(tmp_path, code, timeout=1.5)
    assert outcome.score is None and outcome.failures == ["no score after 1.5 s"]
    assert gone(int(pid.read_text()))


def gone(pid: int) -> bool:
    for _ in range(100):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":  # dead; whoever should know has not asked yet
            return True
        time.sleep(0.05)
    return False


# ---- whole runs, in this process


def test_a_run_leaves_its_answer_and_is_done_when_called_again(tmp_path: Path, capsys) -> None:
    command = program(tmp_path, "print((a['centre'] - 0.3) ** 2)")
    out = tmp_path / "run"
    arguments = [str(toml(tmp_path, "minimize = true\n" + SMALL)), "--out", str(out)]
    assert main([*arguments, "--workers", "2", "--", *command]) == 0
    printed = capsys.readouterr().out
    assert "[100 %] update 2/2 | mean" in printed and "attribute" in printed
    answer = json.loads((out / "answer.json").read_text())
    scores = {line["id"]: line["score"] for line in lines(out)}
    assert sorted(scores) == list(range(6))
    assert answer["best"]["score"] == min(scores.values())
    best = json.loads((out / f"evaluations/{answer['best']['evaluation']:06d}/run-0-0/attributes.json")
        .read_text())  # fmt: skip
    assert best["attributes"] == answer["solution"]  # of random search
    assert (answer["evaluations"], answer["failed"]) == (6, 0)
    # Once more changes nothing; more evaluations go on.
    before = (out / "evaluations.jsonl").read_bytes()
    assert main([*arguments, "--", *command]) == 0
    assert (out / "evaluations.jsonl").read_bytes() == before
    assert main([*arguments, "--evaluations", "9", "--", *command]) == 0
    assert len(lines(out)) == 9
    assert "continuing" in capsys.readouterr().out
    assert main([*arguments, "--", *command]) == 2
    assert "holds 9 evaluations already" in capsys.readouterr().err


def test_failed_evaluations_are_recorded_and_passed_by(tmp_path: Path, capsys) -> None:
    command = program(tmp_path, "print(1 if at['evaluation'] else 'rubbish')")
    out = tmp_path / "run"
    assert main([str(toml(tmp_path)), "--out", str(out), "--retries", "1", "--", *command]) == 0
    assert json.loads((out / "answer.json").read_text())["failed"] == 1
    rewards = {line["id"]: line["reward"] for line in lines(out)}
    assert rewards == {0: None} | dict.fromkeys(range(1, 6), 1.0)
    printed = capsys.readouterr().out
    assert "evaluation 0 failed after 2 attempts: the last line printed is 'rubbish'" in printed


def test_more_than_a_tenth_failed_is_one_error(tmp_path: Path, capsys) -> None:
    command = program(tmp_path, "print(1 if at['evaluation'] > 1 else 'rubbish')")
    out = tmp_path / "run"
    arguments = [str(toml(tmp_path)), "--out", str(out), "--retries", "0"]
    assert main([*arguments, "--", *command]) == 2
    error = capsys.readouterr().err
    assert "2 of 6 evaluations failed" in error and "'rubbish'" in error
    assert error.count("\n") == 1 and len(lines(out)) == 3
    assert main([*arguments, "--evaluations", "30", "--", *command]) == 0


@pytest.mark.parametrize(
    ("code", "timeout", "reason"),
    [
        ("sys.exit('no licence')", "60", "exit code 1: no licence"),
        ("import time; time.sleep(60)", "0.5", "no score after 0.5 s"),
    ],
)
def test_a_simulator_that_never_works_is_one_error(tmp_path, capsys, code, timeout, reason) -> None:
    out, command = tmp_path / "run", program(tmp_path, code)
    arguments = [str(toml(tmp_path)), "--out", str(out), "--retries", "0", "--workers", "3"]
    assert main([*arguments, "--timeout", timeout, "--", *command]) == 2
    error = capsys.readouterr().err
    assert "all 3 evaluations of the first update failed" in error
    assert reason in error and command[2] in error and error.count("\n") == 1
    assert not (out / "evaluations.jsonl").exists() and not (out / "answer.json").exists()
    # Put right, the same command works.
    program(tmp_path, "print(1)")
    assert main([*arguments, "--timeout", "60", "--", *command]) == 0


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (("high = 200", "high = 100"), "attributes.b.high = 200.0, not 100.0"),
        (('"random_search"', '"pbil"'), 'method = "random_search", not "pbil"'),
        (("evaluations = 6", "evaluations = 6\nseed = 4"), "seed = 0, not 4"),
        (("log = true", 'log = true\n[[attributes]]\nname = "c"'), "attributes ="),
    ],
)
def test_the_folder_of_another_run_is_refused(tmp_path, capsys, change, field) -> None:
    out, command = tmp_path / "run", program(tmp_path, "print(1)")
    assert main([str(toml(tmp_path)), "--out", str(out), "--", *command]) == 0
    before = {p: p.read_bytes() for p in out.iterdir() if p.is_file()}
    other = toml(tmp_path, SMALL.replace(*change))
    assert main([str(other), "--out", str(out), "--", *command]) == 2
    error = capsys.readouterr().err
    assert f"--out {out} holds a run with {field}" in error and error.count("\n") == 1
    assert {p: p.read_bytes() for p in out.iterdir() if p.is_file()} == before
    assert main([str(toml(tmp_path)), "--out", str(out), "--", *command, "--more"]) == 2
    assert "holds a run with command" in capsys.readouterr().err


def test_folders_that_are_no_run_are_refused(tmp_path: Path, capsys) -> None:
    command = program(tmp_path, "print(1)")
    assert main([str(toml(tmp_path)), "--out", str(tmp_path), "--", *command]) == 2
    assert "holds other files and no run" in capsys.readouterr().err
    assert main([str(toml(tmp_path)), "--out", str(tmp_path / "space.toml"), "--", *command]) == 2
    assert "is a file; it must be a folder" in capsys.readouterr().err


# ---- what a user can get wrong


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "there are no attributes"),
        ("attributes = 3", "must be tables"),
        ("[[attributes]]\n", "attribute 1 has no name"),
        ('[[attributes]]\nname = ""', "attribute 1 has an empty name"),
        ('[[attributes]]\nname = "a"\n' * 2, "given more than once: 'a'"),
        ('[[attributes]]\nname = "a"\nbins = 1', "'a': bins is 1, but must be at least 2"),
        ('[[attributes]]\nname = "a"\nbins = 2.5', "'a': bins is 2.5, but must be a whole number"),
        ('[[attributes]]\nname = "a"\nbins = true', "bins is True, but must be a whole number"),
        ('[[attributes]]\nname = "a"\nlow = 1', "'a' has a low, but no high"),
        ('[[attributes]]\nname = "a"\nlow = 3\nhigh = 3', "low is 3 and high is 3, but low must"),
        ('[[attributes]]\nname = "a"\nlow = nan\nhigh = 3', "low is nan, but must be a number"),
        (
            '[[attributes]]\nname = "a"\nlow = 0\nhigh = 3\nlog = true',
            "low is 0, but must be above",
        ),
        ('[[attributes]]\nname = "a"\nmax = 1', "'a': key 'max' is unknown; known: name, bins"),
        ('groups = [["a"]]\n' + TWO, "in no group: 'b'"),
        ('groups = [["a", "b"], ["a"]]\n' + TWO, "given more than once: 'a'"),
        ('groups = [["a", "b", "c"]]\n' + TWO, "unknown attribute(s) in the groups: 'c'"),
        ('groups = ["a", "b"]\n' + TWO, "groups must be lists of names"),
        ('method = "magic"\n' + TWO, "method 'magic' is unknown; known: actor_critic"),
        ("evaluation = 5\n" + TWO, "key 'evaluation' is unknown; known: attributes"),
        ("evaluations = 20\n" + TWO, "multiple of datasets_per_update = 8, such as 16 or 24"),
        ("evaluations = 0\n" + TWO, "evaluations is 0, but must be at least 1"),
        ("relaxation = 2\n" + TWO, "relaxation is 2, but must lie in [0, 1]"),
        ("timeout_seconds = 0\n" + TWO, "timeout_seconds is 0, but must be above 0"),
        ("seed = -1\n" + TWO, "seed is -1, but must be at least 0"),
        ("retries = 'x'\n" + TWO, "retries is 'x', but must be a whole number"),
        ("method = 'pbil'\n" + TWO + "[method_options]\nspeed = 1", "option of pbil 'speed' is"),
        ("method = 'pbil'\n" + TWO + "[method_options]\nrate = 'x'", "rate is 'x', but must be a"),
        ("method = 'pbil'\n" + TWO + "[method_options]\nrate = 7", "method pbil: rate is 7"),
        ("method = 'cma_es'\n[[attributes]]\nname = 'a'", "needs at least 2 attributes"),
        ("name = ", "is no TOML"),
    ],
)
def test_a_bad_file_is_one_error_and_nothing_is_written(tmp_path, capsys, text, complaint) -> None:
    out, command = tmp_path / "run", program(tmp_path, "print(1)")
    assert main([str(toml(tmp_path, text)), "--out", str(out), "--", *command]) == 2
    error = capsys.readouterr().err
    assert complaint in error and "error: " in error and error.count("\n") == 1
    assert "space.toml" in error or "method " in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--", "true"], "no argument of the simulator holds {attributes.json}"),
        ([], "say what to run at the end"),
        (["--", "./absent", PLACEHOLDER], "the simulator ./absent does not exist"),
        (["--", "./space.toml", PLACEHOLDER], "is not executable; try chmod +x"),
        (
            ["--evaluations", "7", "--", "true", PLACEHOLDER],
            "--evaluations is 7, but must be a mul",
        ),
        (["--timeout", "-1", "--", "true", PLACEHOLDER], "--timeout is -1, but must be above 0"),
        (["--seed", "x", "--", "true", PLACEHOLDER], "argument --seed: invalid int value: 'x'"),
        (["--method", "x", "--", "true", PLACEHOLDER], "--method 'x' is unknown"),
        (["--sed", "1", "--", "true", PLACEHOLDER], "unrecognized arguments: --sed"),
    ],
)
def test_a_bad_command_line_is_one_error(tmp_path, capsys, monkeypatch, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    toml(tmp_path)
    assert main(["space.toml", *arguments]) == 2
    error = capsys.readouterr().err
    assert complaint in error and error.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["space.toml"]


def test_files_that_are_not_there_or_no_text(tmp_path: Path, capsys) -> None:
    assert main([str(tmp_path / "absent.toml"), "--", "true", PLACEHOLDER]) == 2
    assert "absent.toml: No such file" in capsys.readouterr().err
    (tmp_path / "space.toml").write_bytes(b"\xff\xfe")
    assert main([str(tmp_path / "space.toml"), "--", "true", PLACEHOLDER]) == 2
    assert "space.toml is no TOML" in capsys.readouterr().err


def test_sdr_gets_the_updates_that_its_evaluations_suffice_for(tmp_path: Path) -> None:
    groups = 'method = "sdr"\ngroups = [["a"], ["b"]]\n'
    settings = read(toml(tmp_path, groups + TWO), {"evaluations": 40})
    assert settings.method_options["updates_per_group"] == 3  # five updates, two groups
    table = "[method_options]\nupdates_per_group = 2\n"
    with pytest.raises(UserError, match=r"evaluations is 40, but sdr .* = 32"):
        read(toml(tmp_path, groups + TWO + table), {"evaluations": 40})


def test_a_method_that_needs_more_data_sets_is_refused_before_any_is_simulated(tmp_path, capsys):
    text = "method = 'gaussian'\ndatasets_per_update = 1\n" + TWO
    out, command = tmp_path / "run", program(tmp_path, "print(1)")
    assert main([str(toml(tmp_path, text)), "--out", str(out), "--", *command]) == 2
    assert "method gaussian: leave_one_out needs at least 2" in capsys.readouterr().err
    assert not out.exists()


# ---- runs that are cut short


def start(arguments: list[str]) -> subprocess.Popen:
    # Shells start background jobs with SIGINT ignored, and children would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "sdr_jax.tune", *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "JAX_PLATFORMS": "cpu"},
        )
    finally:
        signal.signal(signal.SIGINT, before)


def wait_for_lines(process: subprocess.Popen, out: Path, count: int) -> None:
    path = out / "evaluations.jsonl"
    for _ in range(3000):
        if path.exists() and path.read_bytes().count(b"\n") >= count:
            return
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    raise AssertionError(f"{path} has too few lines")


@pytest.mark.slow
def test_the_example_killed_and_continued_ends_with_the_same_answer(tmp_path: Path) -> None:
    def arguments(out: Path, workers: int) -> list[str]:
        options = ["--out", str(out), "--method", "pbil", "--evaluations", "32"]
        simulator = [sys.executable, str(EXAMPLE / "simulator.py"), PLACEHOLDER]
        return [str(EXAMPLE / "space.toml"), *options, "--workers", str(workers), "--", *simulator]

    killed = tmp_path / "killed"
    for count in (3, 18):
        process = start(arguments(killed, 2))
        wait_for_lines(process, killed, count)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert 18 <= len(lines(killed)) < 32
    with open(killed / "evaluations.jsonl", "ab") as file:
        file.write(b'{"id": 31, "upd')  # what a kill may leave
    for out, workers in ((killed, 2), (tmp_path / "unbroken", 1)):
        process = start(arguments(out, workers))
        printed, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        assert "32 evaluations by pbil, 0 failed" in printed
    ours, theirs = (tmp_path / name / "answer.json" for name in ("killed", "unbroken"))
    assert ours.read_bytes() == theirs.read_bytes()


def test_ctrl_c_ends_the_simulators_and_the_folder_is_locked_until_then(tmp_path, capsys) -> None:
    pids = tmp_path / "pids"
    code = (
        "import os, time\nif at['evaluation'] == 0: print(1); sys.exit()\n"
        f"open({str(pids)!r}, 'a').write(f'{{os.getpid()}}\\n')\ntime.sleep(300)"
    )
    out = tmp_path / "run"
    arguments = [str(toml(tmp_path)), "--out", str(out), "--workers", "3", "--"]
    arguments += program(tmp_path, code)
    process = start(arguments)
    wait_for_lines(process, out, 1)
    while not (pids.exists() and pids.read_text().count("\n") == 2):
        time.sleep(0.02)
    assert main(arguments) == 2
    assert "is in use by another run" in capsys.readouterr().err
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert error.strip() == "stopped; the same command goes on where it was"
    assert all(gone(int(pid)) for pid in pids.read_text().split())
    assert len(lines(out)) == 1
