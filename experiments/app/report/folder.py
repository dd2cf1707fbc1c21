"""The files of a finished run, for its report."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

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
"""Files of a run folder: what it ends with, and the page."""


class RunFolder(NamedTuple):
    """The files of a run; files that an older run did not write are None."""

    path: Path
    summary: Report  # derived
    config: dict[str, Any]
    evaluations: list[Record]  # rewards of the search
    finals: list[Record]  # all other nets
    seen: dict[str, Any] | None  # what `experiments.app.report.pictures` shows
    probabilities: np.ndarray | None  # f32[updates, attributes, bins]
    expected: np.ndarray | None  # f32[updates, datasets, 2], what the model expected of each reward
    matters: Report | None  # see `experiments.app.report.matters`

    @property
    def attributes(self) -> tuple[Attribute, ...]:
        """The attributes that were searched: all that were not held."""
        known = self.summary.get("components")
        rows = (
            SPACES[self.config["space"]]
            if known is None
            else map(BY_NAME.get, known[0]["attributes"])
        )
        return tuple(row for row in rows if row is not None and row.name not in self.held)

    @property
    def held(self) -> dict[str, float]:
        """The unit values of the held attributes, by name."""
        return read_fixed(self.config.get("fix", ()), self.config.get("space", "scenex"))

    @property
    def percent(self) -> bool:
        """Whether rewards are mIoU, which is shown in percent."""
        return bool(self.config.get("reward_kind", "miou") == "miou")

    @property
    def rewards(self) -> np.ndarray:
        """The rewards of the search, f64[n] in order, in percent if they are mIoU; NaN if one failed."""
        found = [line["reward"] for line in self.evaluations]
        values = np.array([np.nan if v is None else v for v in found], float)
        return values * (100 if self.percent else 1)


def read(path: Path, report: Report | None = None) -> RunFolder:
    """Read a run folder.

    Args:
        path: the folder.
        report: the derived report of a run that has not written its ``summary.json``, the last file.

    Raises:
        UserError: it is not the folder of a finished run; the message says what it is.
    """
    config = read_config(path) if (path / CONFIG).is_file() else None
    if config is None:
        what = "no such folder" if not path.is_dir() else f"no run folder; it holds no {CONFIG}"
        raise UserError(f"{path}: {what}; name the --out of a run")
    if report is None:
        report = _summary(path, config)
    _check_answer(path, report)
    index, matters = path / PICTURES / INDEX, path / PICTURES / FILE
    evaluations, finals = (JsonLines(path / name).lines for name in LOGS)
    run = RunFolder(
        path,
        report,
        config,
        evaluations,
        finals,
        _object(index) if index.exists() else None,
        _array(path / PICTURES / "probabilities.npy", 3),
        _array(path / PICTURES / "expected.npy", 3),
        _object(matters) if matters.exists() else None,
    )
    shares = run.probabilities
    if shares is not None and shares.shape[1] != len(run.attributes):
        run = run._replace(probabilities=None)  # from a search of some attributes only
    return run


def _check_answer(path: Path, report: Report) -> None:
    """Raise UserError for the answer of a method that is gone: bins, or several kinds of streets."""
    found = report.get("components", [])
    bins = [
        row for own in found for row in own["attributes"].values() if "probabilities" in row["unit"]
    ]
    if len(found) > 1 or bins:
        raise UserError(f"{path}: its answer is no intervals; the version that made it can show it")


def _summary(path: Path, config: dict[str, Any]) -> Report:
    """The derived report of a run; older runs have their seed in the configuration."""
    file = path / SUMMARY
    if not file.exists():
        for other in sorted(path.glob("*.json")):
            study = _object(other).get("study")
            if study:
                raise UserError(
                    f"{path} is a run of the study {study}, whose report is {study}.md; name one of "
                    "sdr-jax fit, camvid, cityscapes or labelmefacade"
                )
        raise UserError(
            f"{path} holds no {SUMMARY}: that run is not finished; its command continues it"
        )
    try:
        report = {"seed": config.get("seed"), **_object(file)}
        return (fit_table if fit_table.is_fit(report) else summary).derive(report)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UserError(f"{file} does not hold what a run writes ({error!r})") from None


def _object(path: Path) -> dict[str, Any]:
    found = read_json(path)
    if not isinstance(found, dict):
        raise UserError(f"{path} is no JSON object")
    return found


def _array(path: Path, axes: int) -> np.ndarray | None:
    """The array in a file; None if the file is missing or holds something else."""
    try:
        found = np.load(path)
    except (OSError, ValueError, EOFError):
        return None
    return found if isinstance(found, np.ndarray) and found.ndim == axes else None
