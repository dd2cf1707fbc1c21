"""The target that a configuration names."""

from __future__ import annotations

from common.errors import UserError
from common.workers.pool import Workers
from experiments.config import Config
from experiments.config.presets import VARIABLES
from experiments.targets.base import Sides, Target, keep_two_sizes, two_sides
from experiments.targets.few import with_few
from experiments.targets.real import real_target
from experiments.targets.twin import ASSETS, FIRST_ASSET, TABLE, twin_names, twin_split, twin_world


def named_target(config: Config, workers: Workers) -> Target:
    """Find the target of ``--target``, ``--data`` and ``--few``.

    Raises:
        UserError: data are missing, or named for the twin, or a flag does not fit the target.
        DataError: the data are wrong.
    """
    if config.target == "twin":
        if config.data is not None:
            raise UserError("--data has no effect with --target twin, which needs none")
        return with_few(_twin(config, workers), config)
    if config.data is None:
        if variable := VARIABLES.get(config.target):
            raise UserError(
                f"{config.target} needs its folder: --data DIR (or the variable {variable})"
            )
        raise UserError("Cityscapes needs its folder: --data DIR; or use --target twin")
    return with_few(real_target(config.target, config, config.data), config)


def _twin(config: Config, workers: Workers) -> Target:
    """Make the stand-in for real data; see ``twin``."""
    if config.holdout or config.test_split:
        raise UserError("--holdout and --test-split need --data: the twin has no such names")
    if config.asset_count is not None and config.asset_count >= FIRST_ASSET:
        raise UserError(
            f"--asset-count must be less than {FIRST_ASSET}, the twin's first asset, "
            f"not {config.asset_count}"
        )
    world, name = twin_world(config.twin_seed, config.twin), config.target_name
    counts = {"train": config.reward_images, "test": config.test_images}
    pairs = {split: twin_names(split, n, world.shots) for split, n in counts.items()}
    names, sequences = (
        {split: tuple(row[k] for row in rows) for split, rows in pairs.items()} for k in (0, 1)
    )

    @keep_two_sizes
    def at(height: int, width: int) -> Sides:
        reward, test = (
            twin_split(
                world,
                split,
                (height, width),
                images=count,
                renderer=config.renderer,
                workers=workers,
                assets=min(ASSETS, config.asset_count or ASSETS),
            )
            for split, count in counts.items()
        )
        return two_sides(reward, test, f"the {name}")

    return Target(
        name=name,
        real=False,
        table=TABLE,
        title=f"the {name} {config.twin_seed}, rendered by our own engine: NOT real data",
        reward_names=names["train"],
        reward_sequences=sequences["train"],
        test_names=names["test"],
        at=at,
        twin=world,
    )
