"""Pictures of a run: what it trains on beside what it must be good on, rewards, distributions."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from experiments.config import RewardKind
from experiments.run.context import REWARD_NAMES
from experiments.run.search import Found
from experiments.study.figure import plt, png
from experiments.target.base import Target
from scene.attributes import SPACES, space_of
from scene.dataset.render import Dataset
from seg.classes import ClassTable, class_table
from seg.data import RealSet
from shell.files import naming, write

COLUMNS = 6


def _save(figure: Figure, folder: Path, name: str) -> None:
    _write(folder, name, png(figure, tight=True))


def _write(folder: Path, name: str, data: bytes) -> None:
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write(folder / name, data)


def colorize(labels: np.ndarray, table: ClassTable) -> np.ndarray:
    """Labels u8[..., h, w] of a class table as RGB; void is black."""
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(table.colors)] = table.colors
    return palette[labels]


def samples(folder: Path, target: Target, test: RealSet, datasets: dict[str, Dataset]) -> None:
    """Target, random and learnt images, their labels below each, in one picture."""
    table = class_table(target.table)
    pairs = [("target", test.images, test.labels)]
    pairs += [(name, d.images, table.from_train_id[d.labels]) for name, d in datasets.items()]
    tall = test.images.shape[1] / test.images.shape[2]
    figure, axes = plt.subplots(
        len(pairs), 1, figsize=(2.2 * COLUMNS, len(pairs) * (4.4 * tall + 0.3)), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis, (name, images, labels) in zip(axes[:, 0], pairs, strict=True):
        pick = np.linspace(0, len(images) - 1, min(COLUMNS, len(images))).astype(int)
        rows = [
            np.concatenate(list(row), axis=1)
            for row in (images[pick], colorize(labels[pick], table))
        ]
        axis.imshow(_enlarge(np.concatenate(rows)))
        axis.set_axis_off()
        axis.set_title(name, loc="left")
    figure.suptitle(target.title)
    _save(figure, folder, "images.png")


def _enlarge(image: np.ndarray) -> np.ndarray:
    scale = max(1, 1600 // image.shape[1])
    return cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)


def rewards(folder: Path, found: Found, title: str, kind: RewardKind = "miou") -> None:
    """Reward of every evaluation, the baseline, and where one group ends and the next begins."""
    n = found.rewards.shape[1]
    scale, unit = (100, ", %") if kind == "miou" else (1, "")
    every = scale * found.rewards.ravel()
    figure, axis = plt.subplots(figsize=(9, 4))
    axis.plot(np.arange(len(every)), every, ".", ms=4, color="0.6", label="reward")
    axis.plot(np.fmax.accumulate(every), color="tab:green", lw=1, label="best so far")
    middles = np.arange(len(found.rewards)) * n + (n - 1) / 2
    axis.plot(
        middles,
        scale * np.nanmean(found.rewards, axis=1),
        color="tab:blue",
        lw=1,
        label="update's mean",
    )
    if np.isfinite(found.baselines).any() and np.nanmax(found.baselines) <= 1:
        axis.plot(middles, scale * found.baselines, color="tab:orange", lw=1.5, label="baseline")
    for border in np.flatnonzero(np.diff(found.groups)) + 1:
        axis.axvline(border * n - 0.5, color="0.8", lw=0.8)
    named = f"{REWARD_NAMES[kind]} on the reward images{unit}"
    axis.set(xlabel="evaluation", ylabel=named, title=title)
    axis.legend(loc="lower right", fontsize=8)
    _save(figure, folder, "reward.png")


def distributions(folder: Path, found: Found, title: str) -> None:
    """The policy's distribution over the bins of each attribute, update by update.

    The numbers are kept beside the picture, f32[updates, attributes, bins].
    """
    data = io.BytesIO()
    np.save(data, found.probabilities)
    _write(folder, "probabilities.npy", data.getvalue())
    attributes = SPACES[space_of(found.probabilities.shape[1])]
    rows = -(-len(attributes) // 6)
    figure, axes = plt.subplots(rows, 6, figsize=(16, 2.25 * rows), sharex=True)
    for index, axis in enumerate(axes.flat):
        if index >= len(attributes):
            axis.set_axis_off()
            continue
        attribute = attributes[index]
        image = found.probabilities[:, index].T
        axis.imshow(image, aspect="auto", origin="lower", vmin=0, vmax=1, cmap="viridis",
                    extent=(0, len(found.rewards), 0, 1))  # fmt: skip
        axis.set_title(attribute.name.replace("_", " "), fontsize=8)
        ticks = (0.0, 0.5, 1.0)
        axis.set_yticks(ticks, [f"{attribute.physical(t):.3g}" for t in ticks], fontsize=6)
        axis.tick_params(axis="x", labelsize=6)
    figure.supxlabel("policy update", fontsize=9)
    figure.suptitle(title, fontsize=10)
    figure.tight_layout()
    _save(figure, folder, "attributes.png")
