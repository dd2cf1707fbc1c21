"""Refuses settings that do not allow training; users' backbones are known here, which needs JAX."""

from common.bounds import check_bounds
from seg.nets.backbones import check_name
from seg.settings import FILELESS_NETS, VGG_NETS, TrainSettings


def check_settings(settings: TrainSettings) -> None:
    """Refuse settings that do not allow training; files are not read.

    Raises:
        ValueError: a field is of another type or out of range, or fields do not fit together; the message
            names them.
    """
    check_net(settings)
    if settings.warmup >= settings.steps:
        raise ValueError(
            f"warmup must be less than the {settings.steps} steps, not {settings.warmup}"
        )
    if settings.batch % settings.accumulate:
        raise ValueError(
            f"accumulate must divide the batch of {settings.batch} evenly, not {settings.accumulate}"
        )
    if settings.accumulate > 1 and settings.jaccard:
        raise ValueError("jaccard is of a whole batch, and accumulate cuts it into parts; set one")


def check_net(settings: TrainSettings) -> None:
    """Refuse settings that no network can have, whatever the course of its training.

    Raises:
        ValueError: as `check_settings`.
    """
    check_bounds(settings)
    if settings.has_backbone:
        check_name(settings.net)
    if settings.norm and settings.weights is not None:
        raise ValueError(
            "norm is for training from scratch: networks that start from weights have no GroupNorm"
        )
    if settings.net == "dinov2":
        if settings.weights is None:
            raise ValueError("dinov2 needs weights, the .safetensors file of its backbone")
        if settings.backbone == "tuned":
            raise ValueError('backbone is "tuned", but the backbone of dinov2 stays frozen')
    if settings.weights is not None and settings.net in FILELESS_NETS:
        raise ValueError(
            f"weights are for VGG16 or dinov2, neither of which is in the network {settings.net}"
            + ("; its own weights come with a package" if settings.has_backbone else "")
        )
    if settings.backbone == "tuned" and not settings.has_backbone:
        raise ValueError(
            f'backbone is "tuned", but the network {settings.net} has no backbone; lite0 to lite2 have one'
        )
    if settings.heads > 1 and not settings.frozen:
        raise ValueError(
            f"heads must be 1, not {settings.heads}, for the network {settings.net} without a frozen backbone"
        )
    if settings.net not in VGG_NETS and (settings.norm or settings.lr_multipliers != "none"):
        raise ValueError(
            f"norm and lr_multipliers are for {' and '.join(VGG_NETS)}, not for {settings.net}"
        )
    if not settings.has_backbone and (
        settings.loss_stride != 1 or settings.head_statistics != "training"
    ):
        raise ValueError(
            f"loss_stride and head_statistics are for networks with a backbone; the network is {settings.net}"
        )
