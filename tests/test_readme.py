"""What the README shows must work as it stands there."""

import re
from pathlib import Path

import numpy as np

from tests.conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_example_of_asking_and_telling_runs_and_goes_on(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```py\n(.*?)```", README, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    histories = set()
    for _ in range(2):
        exec(compile(code, "README.md", "exec"), {})
        histories.add(Path("history.jsonl").read_text())
    assert len(histories) == len(set(capsys.readouterr().out.splitlines())) == 1


def test_the_example_of_the_optimiser_runs_and_learns(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    scope: dict = {}
    exec(compile(code, "README.md", "exec"), scope)
    centre = np.asarray(scope["method"].solution(scope["state"]).centre)
    assert np.abs(centre - [0.85, 0.25, 0.45]).max() < 0.25
    assert capsys.readouterr().out.strip().startswith("[")


def test_files_and_modules_it_names_exist_and_no_placeholder_is_left():
    for path in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / path).exists(), path
    for module in re.findall(r"python -m ([\w.]+)", README):
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), module
    assert not re.findall(r"RESULTS_|LIMITS$|TODO", README, flags=re.MULTILINE)
