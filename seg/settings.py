"""All that decides how a net is trained, apart from the data and the seed."""

from dataclasses import dataclass

from seg.classes import class_table
from seg.nets import net
from seg.optim import optimizer


@dataclass(frozen=True)
class TrainSettings:
    """All that decides how a net is trained, apart from the data and the seed.

    Named sets of them are in `seg.recipes`.

    Attributes:
        net: name of the net, see `seg.net`.
        table: name of the class table, see `seg.class_table`.
        optimizer: "adam" or "sgd".
        lr: highest learning rate. Paper (SGD): 5e-4.
        steps: how many updates. Paper: 1000 per reward, 20 000 at the end.
        batch: images per update. Paper: 4.
        warmup: updates over which the rate rises. Paper: 0.
        power: of the poly decay.
        momentum: of SGD.
        weight_decay: Paper: 1e-4.
        mirror: swap left and right of half of the images.
        colour: vary gamma, gain, contrast, saturation.
        blur: mix with a blur.
        weighted: balance rare classes in the loss by `class_weights`.
        predict_batch: images per call of the net in `predict`.
        weights: file of ImageNet weights from `python -m seg.weights convert`, which the VGG nets start
            from (paper). None: every layer starts at random, He's way, and a VGG net then learns
            little in a thousand steps.
        norm: GroupNorm after the VGG nets' convolutions, for training from scratch; not in the paper.
        lr_multipliers: "none", or "deeplab": rates and decay that differ by layer, see `seg.optim`.
        accumulate: parts into which the images of an update are cut, to need less memory; the
            gradient is that of the whole.
        dtype: what the nets compute in, "float32" or "bfloat16"; parameters and logits stay float32.
    """

    net: str = "compact"
    table: str = "camvid"
    optimizer: str = "adam"
    lr: float = 1e-2
    steps: int = 200
    batch: int = 8
    warmup: int = 20
    power: float = 0.9
    momentum: float = 0.9
    weight_decay: float = 0.0
    mirror: bool = True
    colour: bool = True
    blur: bool = True
    weighted: bool = True
    predict_batch: int = 16
    weights: str | None = None
    norm: bool = False
    lr_multipliers: str = "none"
    accumulate: int = 1
    dtype: str = "float32"

    @property
    def classes(self) -> int:
        """How many classes the table has."""
        return len(class_table(self.table).classes)


def check_settings(settings: TrainSettings) -> None:
    """Refuse settings that no net can be trained with; files are not looked at.

    Raises:
        ValueError: a field out of range, by name.
    """
    if settings.steps < 1 or settings.batch < 1:
        raise ValueError(
            f"steps and batch must be at least 1; got {settings.steps} and {settings.batch}"
        )
    if settings.accumulate < 1 or settings.batch % settings.accumulate:
        raise ValueError(
            f"accumulate must be at least 1 and divide the batch of {settings.batch} evenly; "
            f"got {settings.accumulate}"
        )
    if settings.norm and settings.weights is not None:
        raise ValueError("norm is for training from scratch: the nets of weights have no GroupNorm")
    if settings.weights is not None and settings.net == "compact":
        raise ValueError("weights are of VGG16, which the net compact does not have in it")
    net(settings.net, settings.classes, settings.dtype, settings.norm)
    optimizer(settings.optimizer, lr_multipliers=settings.lr_multipliers)
