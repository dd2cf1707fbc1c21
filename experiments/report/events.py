"""A run's figures as TensorBoard events, through tensorboardX: ``pip install -e '.[tensorboard]'``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from experiments.main.pictures import PICTURES
from experiments.report.kept import Kept, label_of
from shell.errors import UserError
from shell.files import naming
from shell.folder import CONFIG


def writer(runs: Sequence[Kept], folder: Path) -> Callable[[], list[Path]]:
    """What writes the events of runs, each into a folder of its own name; nothing is written before.

    Raises:
        UserError: tensorboardX is not installed, or a folder holds events already, to which these would add.
    """
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        raise UserError(
            "--tensorboard needs tensorboardX: pip install -e '.[tensorboard]'"
        ) from None
    places = {folder / label_of(run, runs).replace("/", "-"): run for run in runs}
    for place in places:
        if any(place.glob("events.out.tfevents.*")):
            raise UserError(f"--tensorboard: {place} holds events already; name another folder")

    def work() -> list[Path]:
        for place, run in places.items():
            with naming(place), SummaryWriter(str(place)) as events:
                _search(events, run)
                _result(events, run)
        return list(places)

    return work


def _search(events: Any, run: Kept) -> None:
    """Rewards, the best so far, what the model expected, and where the policy lies in physical units."""
    began = (run.path / CONFIG).stat().st_mtime
    times = [began + float(line.get("elapsed", 0)) for line in run.evaluations]
    rewards = run.rewards
    best = np.fmax.accumulate(rewards) if len(rewards) else rewards
    curves = {"search/reward": rewards, "search/best": best}
    if run.expected is not None:
        curves["search/expected"] = run.expected[..., 0].ravel() * (100 if run.percent else 1)
    for tag, values in curves.items():
        for step, (value, time) in enumerate(zip(values, times, strict=False), 1):
            if np.isfinite(value):
                events.add_scalar(tag, float(value), step, walltime=time)
    if run.probabilities is None:
        return
    bins = run.probabilities.shape[2]
    middles = (np.arange(bins) + 0.5) / bins
    for attribute, own in zip(run.attributes, np.moveaxis(run.probabilities, 1, 0), strict=False):
        for step, unit in enumerate(own @ middles, 1):
            events.add_scalar(f"policy/{attribute.name}", attribute.physical(float(unit)), step)


def _result(events: Any, run: Kept) -> None:
    """Every net's mIoU, by seed; mean IoU of classes; pictures of streets."""
    for row, entry in run.summary["rows"].items():
        tag = row.replace("+", "_")
        for seed, value in enumerate(entry["miou"]):
            if value is not None:
                events.add_scalar(f"miou/{tag}", value, seed)
        for index, value in enumerate(entry["per_class"].values()):
            if value is not None:
                events.add_scalar(f"iou/{tag}", value, index)
    for row, shown in (run.seen or {"streets": {}})["streets"].items():
        for step, entry in enumerate(shown):
            for kind, name in entry.items():
                file = run.path / PICTURES / name
                if file.exists():
                    pixels = np.asarray(Image.open(file).convert("RGB"))
                    events.add_image(f"{row}/{kind}", pixels, step, dataformats="HWC")
