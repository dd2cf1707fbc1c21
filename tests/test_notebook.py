"""The notebook runs from top to bottom, in Jupyter's own way, and was committed without outputs; its toy."""

import re

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from common.labels.target_file import find_target
from scripts.make_toy import SPLITS
from seg.classes import IGNORE_LABEL
from seg.data import list_split, load
from tests.conftest import ROOT


@pytest.mark.slow
def test_the_first_run_ends_with_what_labels_and_renders_were_worth(tmp_path, monkeypatch):
    notebook = nbformat.read(ROOT / "examples" / "first_run.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    said = "".join(output.get("text", "") for output in outputs)
    assert re.search(r"14 labels alone +\d+\.\d %", said)
    assert re.search(r"renders add [+-]\d+\.\d points to the labels", said)


def test_the_toy_is_what_its_file_says():
    toy = ROOT / "experiments" / "toy"
    target = find_target(str(toy / "target.yaml"))
    for split, count in SPLITS.items():
        data = load(list_split(target, toy, split), target, (270, 480))
        assert len(data.images) == len({*data.names}) == count
        assert {*np.unique(data.labels)} - {IGNORE_LABEL} == {*range(len(target.classes))}
    assert sum(path.stat().st_size for path in toy.rglob("*.*")) < 1_000_000
