"""How long programs take to start, beside a Python that does nothing."""

import json
import subprocess

import pytest

from benchmarks import startup
from experiments.__main__ import COMMANDS, path_of


def test_each_program_is_compared_with_a_python_that_does_nothing(tmp_path, monkeypatch, capsys):
    path, ran = tmp_path / "startup.json", []
    monkeypatch.setattr(startup, "_run", ran.append)
    monkeypatch.setattr(startup, "timed", lambda work: (2.0 + bool(work()) + len(ran), None))
    assert startup.main(["--only", "seg", "check", "--repeats", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())["rows"]
    assert [row["program"] for row in rows] == [
        startup.NOTHING, "import seg", "import scene.check", "sdr-jax check --help",
    ]  # fmt: skip
    assert len(ran) == 12 and ran[:4] == ran[4:8]  # in turn, once more than is counted
    # The second and third round took 7 and 11 seconds for the first program.
    assert [row["seconds"] for row in rows] == [9.0, 10.0, 11.0, 12.0]
    assert [row["ratio"] for row in rows] == pytest.approx([1, 10 / 9, 11 / 9, 12 / 9])
    assert "| sdr-jax check --help" in capsys.readouterr().out


def test_every_command_and_library_is_there():
    programs = startup.programs((*startup.LIBRARIES, *COMMANDS))
    assert len(programs) == 1 + len(startup.LIBRARIES) + 2 * len(COMMANDS)
    for module in COMMANDS.values():
        assert path_of(module).exists() and f"import {module}" in programs


def test_a_program_that_fails_is_named(monkeypatch, capsys):
    failing = {startup.NOTHING: ["-c", "raise SystemExit('no such thing')"]}
    monkeypatch.setattr(startup, "programs", lambda names: failing)
    with pytest.raises(SystemExit, match=r"^2$"):
        startup.main(["--repeats", "1"])
    assert "ended with code 1: no such thing" in capsys.readouterr().err


def test_a_library_is_imported_in_a_process_of_its_own():
    for name in startup.LIBRARIES[:2]:  # the third loads JAX
        startup._run(["-c", startup.IMPORT.format(name + ".classes")])
    with pytest.raises(subprocess.CalledProcessError):
        startup._run(["-c", startup.IMPORT.format("no_such_module")])
