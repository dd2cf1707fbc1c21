"""The files of a finished run, for its report."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from common.errors import UserError
from common.files import read_json
from common.folder import CONFIG, read_config
from common.lines import JsonLines, Record
from experiments.app.report import fit_table, summary
from experiments.app.report.matters import FILE
from experiments.app.report.pictures import INDEX, PICTURES
from experiments.evaluation.store import LOGS
from experiments.tables.form import Report
from scene.attributes import BY_NAME, SPACES, Attribute
from scene.held import read_fixed

SUMMARY, NAME = "summary.json", "report.html"
"""Files of a run folder: the result, written last, and the page."""


class RunFolder(NamedTuple):
    """The files of a run; those that it did not write are None."""

    path: Path
    summary: Report  # derived
    config: dict[str, Any]
    evaluations: list[
        Record
    ]  # rewards of the search, in its order, not that in which workers finished
    finals: list[Record]  # all other networks
    images: dict[str, Any] | None  # the index of `experiments.app.report.pictures`
    probabilities: np.ndarray | None  # f32[updates, attributes, bins]
    expected: np.ndarray | None
    """Predicted mean and deviation of the rewards, f32[updates, datasets, 2]."""
    matters: Report | None  # see `experiments.app.report.matters`

    @property
    def attributes(self) -> tuple[Attribute, ...]:
        """The attributes that were searched: all that were not held."""
        components = self.summary.get("components")
        rows = (
            SPACES[self.config["space"]]
            if components is None
            else map(BY_NAME.get, components[0]["attributes"])
        )
        return tuple(row for row in rows if row is not None and row.name not in self.held)

    @property
    def held(self) -> dict[str, float]:
        """The unit values of the held attributes, by name."""
        return read_fixed(self.config.get("fix", ()), self.config.get("space", "scenex"))

    @property
    def rewards(self) -> np.ndarray:
        """The rewards of the search, f64[n] in order, in percent; NaN if one failed."""
        rewards = [line["reward"] for line in self.evaluations]
        return 100 * np.array([np.nan if reward is None else reward for reward in rewards], float)


def read(path: Path, report: Report | None = None) -> RunFolder:
    """Read a run folder.

    Args:
        path: the folder.
        report: the derived report of a run that has not written its ``summary.json``, the last file.

    Raises:
        UserError: it is not the folder of a finished run.
    """
    config = read_config(path) if (path / CONFIG).is_file() else None
    if config is None:
        raise UserError(f"{path} {_not_a_run(path)}; pass the --out folder of a run")
    if report is None:
        report = _summary(path)
    index_file, matters_file = path / PICTURES / INDEX, path / PICTURES / FILE
    evaluations, finals = (JsonLines(path / name).lines for name in LOGS)
    evaluations.sort(key=lambda line: (line.get("update", 0), line.get("dataset", 0)))
    run = RunFolder(
        path,
        report,
        config,
        evaluations,
        finals,
        _object(index_file) if index_file.exists() else None,
        _array(path / PICTURES / "probabilities.npy", 3),
        _array(path / PICTURES / "expected.npy", 3),
        _object(matters_file) if matters_file.exists() else None,
    )
    probabilities = run.probabilities
    if probabilities is not None and probabilities.shape[1] != len(run.attributes):
        run = run._replace(probabilities=None)  # from a search of some attributes only
    return run


def _not_a_run(path: Path) -> str:
    if path.is_dir():
        return f"is not the folder of a run: it has no {CONFIG}"
    return "is a file" if path.exists() else "does not exist"


def _summary(path: Path) -> Report:
    """The derived report of a run."""
    file = path / SUMMARY
    if not file.exists():
        for other in sorted(path.glob("*.json")):
            study = _object(other).get("study")
            if study:
                raise UserError(
                    f"{path} is a run of the study {study}; read its report in {path / study}.md"
                )
        raise UserError(
            f"{path} has no {SUMMARY}: the run is not finished; run its command again to resume it"
        )
    try:
        report = _object(file)
        return (fit_table if fit_table.is_fit(report) else summary).derive(report)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UserError(f"{file} is not the result of a run ({error!r})") from None


def _object(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise UserError(f"{path} must be a JSON object")
    return content


def _array(path: Path, axes: int) -> np.ndarray | None:
    """The array in a file; None if the file is missing or holds something else."""
    try:
        with path.open("rb") as file:  # NumPy leaves a damaged archive open
            array = np.load(file)
    except (OSError, ValueError, EOFError, BadZipFile):
        return None
    return array if isinstance(array, np.ndarray) and array.ndim == axes else None
