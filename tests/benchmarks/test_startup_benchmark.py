"""How long programs take to start, compared with a Python that does nothing."""

import json
import subprocess

import pytest

from benchmarks import startup
from common.command import path_of
from experiments.__main__ import COMMANDS


def test_each_program_is_compared_with_a_python_that_does_nothing(tmp_path, monkeypatch, capsys):
    path, ran = tmp_path / "startup.json", []
    monkeypatch.setattr(startup, "_run", ran.append)
    monkeypatch.setattr(startup, "timed", lambda work: (2.0 + bool(work()) + len(ran), len(ran)))
    assert startup.main(["--only", "seg", "check", "--repeats", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())["rows"]
    assert [row["program"] for row in rows] == [
        startup.NOTHING, "import seg", "import scene.check", "sdr-jax check --help",
    ]  # fmt: skip
    assert len(ran) == 12 and ran[:4] == ran[4:8]  # in turn, once more than is counted
    # The second and third round took 7 and 11 seconds for the first program, 5 and 9 of them of a core.
    assert [row["seconds"] for row in rows] == [9.0, 10.0, 11.0, 12.0]
    assert [row["cpu"] for row in rows] == [7.0, 8.0, 9.0, 10.0]
    assert [row["ratio"] for row in rows] == pytest.approx([1, 8 / 7, 9 / 7, 10 / 7])
    assert "| sdr-jax check --help" in capsys.readouterr().out
    assert startup.main(["--only", "seg", "check", "--repeats", "1", "--texts"]) == 0
    output = capsys.readouterr().out
    assert "| sdr-jax check --help" in output and "import" not in output


def test_every_command_and_library_is_there():
    programs = startup.programs((*startup.LIBRARIES, startup.ALL, *COMMANDS))
    assert len(programs) == 2 + len(startup.LIBRARIES) + 2 * len(COMMANDS)
    assert programs["sdr-jax study table --help"][-3:] == ["study", "table", "--help"]
    for module in COMMANDS.values():
        assert path_of(module).exists() and f"import {module}" in programs


def test_a_program_that_fails_is_named(monkeypatch, capsys):
    failing = {startup.NOTHING: ["-c", "raise SystemExit('no such thing')"]}
    monkeypatch.setattr(startup, "programs", lambda names: failing)
    with pytest.raises(SystemExit, match=r"^2$"):
        startup.main(["--repeats", "1"])
    assert "ended with code 1: no such thing" in capsys.readouterr().err


def test_a_library_is_imported_in_a_process_of_its_own():
    assert startup._run(["-c", "import seg.classes"]) > 0
    with pytest.raises(subprocess.CalledProcessError):
        startup._run(["-c", "import no_such_module"])
