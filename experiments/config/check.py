"""Refuse fields out of bounds, sizes that do not fit into memory, and fields that contradict each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from common.bounds import check_bounds
from common.errors import UserError, flagged
from experiments.config.config import (
    Config,
    FewConfig,
    GroupsConfig,
    SearchConfig,
    fidelities,
)
from experiments.config.limits import refuse_too_large
from experiments.config.method import make_method, make_space
from experiments.config.options import Fidelity
from scene.assets.catalogue import check_pool
from scene.render import check_settings
from seg.check import check_settings as check_train_settings
from seg.mixing import extra_count
from seg.nets.backbones import backbone_of
from seg.settings import FILELESS_NETS, VGG_NETS, TrainSettings
from seg.weights import check as check_weights


def check(config: Config) -> None:
    """Refuse a configuration that no job can use; the only files that it reads are those of weights.

    Raises:
        UserError: a field is out of bounds, a size needs too much memory, or fields contradict each other;
            the message names the flag.
    """
    check_bounds(config, "--")
    refuse_too_large(config)
    for kind, refuse in _RELATIONS:
        if isinstance(config, kind):
            refuse(config)


def _check_target(config: Config) -> None:
    if config.twin == "far" and config.target != "twin":
        raise UserError(
            f"--twin far is for the twin (sdr-jax cityscapes without --data), not {config.target}"
        )
    _ = config.held  # refuses values outside an attribute's range
    with flagged("--assets", "--asset"):
        check_pool(config.pool, "--asset-")
    for name, fidelity in fidelities(config).items():
        _check_fidelity(f"--{name}", fidelity)


def _check_weights(config: Config) -> None:
    if config.from_scratch and config.weights is not None:
        raise UserError("--weights and --from-scratch exclude each other")
    if config.from_scratch and config.preset != "paper":
        raise UserError(f"--from-scratch is for --preset paper, not {config.preset}")
    if config.weights is not None and set(config.nets_trained) <= set(FILELESS_NETS):
        nets = ", ".join(dict.fromkeys(config.nets_trained))
        raise UserError(f"--weights is for VGG networks and dinov2; this job trains {nets}")
    for name, fidelity in fidelities(config).items():
        if name in ("reward", "final") and config.nets_trained:
            refuse_unstarted(config, f"--{name}.train", fidelity.train)


def refuse_unstarted(config: Config, flag: str, train: TrainSettings) -> None:
    """Raise UserError for a VGG network of ``--preset paper`` without weights or ``--from-scratch``."""
    if config.preset != "paper" or config.from_scratch:
        return
    if train.net in VGG_NETS and train.weights is None:
        raise UserError(
            f"--preset paper starts {train.net} ({flag}) from ImageNet weights, without which it hardly "
            "learns: pass --weights vgg16.npz, or --from-scratch. To make that file: download "
            "https://download.pytorch.org/models/vgg16-397923af.pth, then run sdr-jax weights convert "
            "vgg16-397923af.pth --out vgg16.npz"
        )


def _check_fidelity(flag: str, fidelity: Fidelity) -> None:
    if fidelity.width % 8 or fidelity.height % 8:
        raise UserError(
            f"{flag}.width and {flag}.height must be multiples of 8, not {fidelity.size}"
        )
    with flagged(flag):
        check_settings(fidelity.render_settings())
    check_net(flag, f"{flag}.train", fidelity)


def check_net(flag: str, train_flag: str, fidelity: Fidelity) -> None:
    """Raise UserError with the flag for a size, settings or weights that do not fit the network."""
    train = fidelity.train
    with flagged(train_flag):
        check_train_settings(train)
    coarsest = max(backbone_of(train).strides) if train.has_backbone else 1
    if min(fidelity.width, fidelity.height) < coarsest:
        raise UserError(
            f"{flag}: images of {fidelity.size} are too small for {train.net}, which needs "
            f"{coarsest} pixels in width and height"
        )
    check_weights(train, 1)  # any number of classes will do, since files lack the last layer


def _check_search(config: GroupsConfig) -> None:
    search = config.search
    if search.baseline == "leave_one_out" and search.datasets_per_update < 2:
        raise UserError(
            "--search.baseline leave_one_out needs --search.datasets-per-update 2 or more"
        )
    if search.checkpoints > config.reward.train.steps:
        raise UserError(
            f"--search.checkpoints {search.checkpoints} needs as many --reward.train.steps, not "
            f"{config.reward.train.steps}"
        )


def _check_answer(config: SearchConfig) -> None:
    make_method(config, config.search.method, make_space(config), 1)


def _check_few(config: FewConfig) -> None:
    refuse_share(config, config.few_share)


def refuse_share(config: Config, share: float) -> None:
    """Raise UserError for a share with which batches have no labelled images, or nothing else."""
    for name, fidelity in fidelities(config).items():
        train = fidelity.train
        images = train.steps * train.batch
        if extra_count(share, images) in (0, images):
            count = "none" if share < 0.5 else "all"
            raise UserError(
                f"--few-share {share} takes {count} of the {images} images of "
                f"--{name}.train.steps {train.steps} x --{name}.train.batch {train.batch} from the "
                "labelled subset"
            )


_RELATIONS: tuple[tuple[type, Callable[[Any], None]], ...] = (
    (Config, _check_weights),
    (Config, _check_target),
    (GroupsConfig, _check_search),
    (FewConfig, _check_few),
    (SearchConfig, _check_answer),
)
"""Checks of several fields, by the class of configuration that has them."""
