"""Refuses settings that do not allow training; users' trunks are known here, which needs JAX."""

from common.bounds import check_bounds
from seg.nets.trunks import check_name
from seg.settings import FILELESS_NETS, TrainSettings


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
    """Refuse settings that no net can have, whatever the course of its training.

    Raises:
        ValueError: as `check_settings`.
    """
    check_bounds(settings)
    if settings.has_trunk:
        check_name(settings.net)
    if settings.norm and settings.weights is not None:
        raise ValueError("norm is for training from scratch: the nets of weights have no GroupNorm")
    if settings.net == "dinov2":
        if settings.weights is None:
            raise ValueError("weights must name the file of the trunk of dinov2, a .safetensors")
        if settings.trunk == "tuned":
            raise ValueError('trunk is "tuned", but that of dinov2 stays frozen')
    if settings.weights is not None and settings.net in FILELESS_NETS:
        raise ValueError(
            f"weights are of VGG16 or dinov2, which the net {settings.net} does not have in it"
            + ("; its own come with it" if settings.has_trunk else "")
        )
    if settings.trunk == "tuned" and not settings.has_trunk:
        raise ValueError(
            f'trunk is "tuned", but the net {settings.net} has no trunk; lite0 to lite2 have'
        )
    if settings.heads > 1 and not settings.frozen:
        raise ValueError(
            f"heads must be 1, not {settings.heads}, for the net {settings.net} without a frozen trunk"
        )
    if settings.has_trunk and (settings.norm or settings.lr_multipliers != "none"):
        raise ValueError(
            f"norm and lr_multipliers are for the VGG nets; {settings.net} has rates of its own"
        )
    if not settings.has_trunk and (
        settings.loss_stride != 1 or settings.head_statistics != "training"
    ):
        raise ValueError(
            f"loss_stride and head_statistics are of nets on a trunk; the net is {settings.net}"
        )
