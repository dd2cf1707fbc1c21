"""CamVid, Cityscapes and LabelMeFacade on disk."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from common.errors import UserError
from common.labels.listing import HELD_OUT
from common.labels.target_file import TargetFile, shipped
from experiments.config import Config
from experiments.targets.base import Sides, Target, keep_two_sizes, refuse_overlap, two_sides
from seg.data import Entry, list_split, load, refuse_shared, subset

REPORTED = {"camvid": "test", "cityscapes": "val", "labelmefacade": "test"}
"""The default test split."""
MOST_NAMED = 8
"""The title names up to so many sequences on both sides; otherwise it gives their number."""


def reported_split(target: str, splits: Collection[str]) -> str:
    """Return the split on which a target is tested: its own, or test or val in any case; else ``test``."""
    by_name = {split.lower(): split for split in splits}
    names = (REPORTED.get(target), *HELD_OUT)
    return next((by_name[name] for name in names if name in by_name), HELD_OUT[0])


def real_target(name: str, config: Config, data: Path) -> Target:
    """Read a public data set in the folder ``data``.

    Raises:
        UserError: a side has no images, or an image is on both.
        DataError: the data are wrong.
    """
    files = shipped(name)
    reward, test, tested_on = _sides(files, data, config.test_split or REPORTED[name], config)
    # The same for every --seed, so that a study's searches share their target with the main job's.
    test = subset(test, config.test_images)
    reward = subset(reward, config.reward_images)
    refuse_overlap([e.name for e in reward], [e.name for e in test])

    @keep_two_sizes
    def at(height: int, width: int) -> Sides:
        size = (height, width)
        sides = two_sides(load(reward, files, size), load(test, files, size), str(data))
        refuse_shared(
            {
                "the training images": sides["reward"],
                "the test images": sides["test"],
            }
        )
        return sides

    shared = sorted({e.sequence for e in reward} & {e.sequence for e in test})
    listed = f"sequences {', '.join(shared)}"
    if len(shared) > MOST_NAMED:
        listed = f"{len(shared)} sequences"
    note = f" ({listed} are on both sides)" if shared else ""
    return Target(
        name=name,
        real=True,
        table=name,
        title=f"{name}, {len(reward)} images for the search, {tested_on}, {len(test)} images{note}",
        reward_names=tuple(e.name for e in reward),
        test_names=tuple(e.name for e in test),
        at=at,
        reward_sequences=tuple(e.sequence for e in reward),
    )


def _sides(
    files: TargetFile, data: Path, test_split: str, config: Config
) -> tuple[tuple[Entry, ...], tuple[Entry, ...], str]:
    """Return the validation images of the search, the test images, and the origin of the latter in words."""
    reward = list_split(files, data, "train")
    if config.holdout is None:
        try:
            test = list_split(files, data, test_split)
        except UserError as error:
            raise UserError(
                f"{error}; --test-split or --holdout choose other images to test on"
            ) from None
        return reward, test, f"tested on split {test_split}"
    if config.test_split is not None:
        raise UserError("--holdout and --test-split exclude each other")
    held_out = tuple(e for e in reward if e.sequence == config.holdout)
    rest = tuple(e for e in reward if e.sequence != config.holdout)
    if not held_out or not rest:
        raise UserError(
            f"--holdout {config.holdout!r} must leave images to train on and to test on; the training images "
            f"have the sequences {', '.join(sorted({e.sequence for e in reward}))}"
        )
    return rest, held_out, f"tested on sequence {config.holdout}"
