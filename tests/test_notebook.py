"""The notebook runs from top to bottom, in Jupyter's own way, and was committed without outputs."""

import re

import nbformat
import pytest
from nbclient import NotebookClient

from tests.conftest import ROOT


@pytest.mark.slow
def test_the_first_run_ends_with_a_gain():
    notebook = nbformat.read(ROOT / "examples" / "first_run.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": ROOT}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    assert re.search(r"learnt minus random: [+-]\d+\.\d points", outputs[-1]["text"])
