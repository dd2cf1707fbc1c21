"""Settings of the training of a network: everything but the data and the seed."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from common.bounds import POSITIVE, at_least, at_most, must, within

BackboneName = Literal["lite0", "lite1", "lite2", "dinov2"]
"""Networks that are a head on a backbone."""
NetName = Literal["compact", "deeplabv2", "fcn8s", BackboneName]
VGG_NETS: tuple[NetName, ...] = ("fcn8s", "deeplabv2")
"""Networks that may start from a file of VGG16's weights."""
FILELESS_NETS: tuple[NetName, ...] = ("compact", "lite0", "lite1", "lite2")
"""Networks that start from no file: at random, or from the weights of a package."""
WHOLE_NETS: tuple[NetName, ...] = ("compact", *VGG_NETS)
"""Networks without a backbone; all other networks have one, those of users, too (`seg.nets.backbones`)."""
BackboneTraining = Literal["frozen", "tuned"]
HeadStatistics = Literal["training", "target"]
OptimizerName = Literal["adam", "sgd"]
LrMultipliers = Literal["none", "deeplab"]
Multipliers = LrMultipliers | Literal["backbone"]
Dtype = Literal["float32", "bfloat16"]
STRIDES = (1, 2, 4, 8)
"""Allowed distances of the pixels in the loss."""
_STRIDE = must(f"be one of {', '.join(map(str, STRIDES))}", STRIDES.__contains__)


class BackboneSpec(NamedTuple):
    """What decides the features of a backbone."""

    net: str
    weights: str | None
    dtype: Dtype


class NetSpec(NamedTuple):
    """What decides a network's parameters and its logits."""

    net: str
    dtype: Dtype
    norm: bool
    backbone: BackboneSpec | None  # None for a network that is no head on a backbone
    head_width: int
    head_dropout: float


class AugmentSpec(NamedTuple):
    """The changes of `seg.augment`."""

    mirror: bool
    scale: bool
    colour: bool
    mix: bool
    blur: bool
    noise: bool


class OptimSpec(NamedTuple):
    """The optimiser, but for the learning rate, which is data."""

    optimizer: OptimizerName
    momentum: float
    weight_decay: float
    lr_multipliers: Multipliers


class StepSpec(NamedTuple):
    """What decides the compiled functions of a training; the rest of the settings is data or its shape."""

    net: NetSpec
    augment: AugmentSpec | None  # None where features were augmented before
    optim: OptimSpec
    loss_stride: int
    jaccard: float
    accumulate: int
    averages: bool


@dataclass(frozen=True)
class TrainSettings:
    """Settings of the training of a network: everything but the data and the seed.

    Named sets of them are in `seg.recipes`.

    Attributes:
        net: see docs/howto/net.md, which also shows how to add a backbone.
        optimizer: see `seg.optim`.
        lr: highest learning rate. Paper (SGD): 5e-4.
        steps: number of updates. Paper: 1000 per reward, 20 000 at the end.
        batch: images per update. Paper: 4.
        warmup: updates over which the rate rises. Paper: 0.
        power: power of the poly decay.
        momentum: momentum of SGD.
        weight_decay: Paper: 1e-4.
        mirror: swap left and right of half of the images.
        colour: vary gamma, gain, contrast, saturation.
        mix: mix the colour channels, see `seg.augment`.
        blur: mix with a blur.
        noise: add noise to every pixel.
        scale: enlarge or shrink image and labels, by 0.5 to 2, and cut to the image's size.
        weighted: balance rare classes in the loss by `losses.weights_of_shares`.
        predict_batch: images per call of the network in `predict`.
        weights: file of ImageNet weights from `sdr-jax weights convert`, from which the VGG networks start
            (paper). If it holds the 13 convolutions alone, fc6 and fc7 start at random; DeepLabv2's
            always do. None: every layer starts at random (He), and a VGG network then learns little in a
            thousand steps. For dinov2: the file of its backbone's weights, which it needs.
        norm: GroupNorm after the VGG networks' convolutions, for training from scratch; not in the paper.
        lr_multipliers: rates and decay that differ by layer, see `seg.optim`.
        accumulate: parts into which the images of an update are cut, to need less memory; the
            gradient is that of the whole.
        dtype: the networks' type of computation; parameters and logits stay float32.
        backbone: for networks with a backbone. "frozen": its weights stay as they are, features of an image
            are computed once, and only the head trains. "tuned": everything trains, the backbone at a tenth
            of the rate. Networks without a backbone ignore "frozen".
        views: number of views of each training image for a frozen backbone: the image itself, then augmented
            ones (`seg.views`). Features of lite0 cost 10 to 15 ms of a core and 150 kB each at 240x176.
            Networks without a frozen backbone augment in every step.
        head_statistics: the images whose mean and deviation normalise a head's features: its training
            images, or the target's real ones, which need no labels and are given to `train`.
        loss_stride: for networks with a backbone: the distance in pixels between the rows, and columns, in
            the loss.
        head_width: channels of a backbone's head.
        head_dropout: share of its features that a backbone's head leaves out in training.
        average: share of the last steps over whose parameters the trained network is the mean. 0: the network
            after the last step.
        heads: heads on a frozen backbone, each with first weights and an order of images of its own. Logits
            are their mean. Features are computed once for all.
        jaccard: weight of the soft Jaccard loss, added to the cross-entropy, see `seg.losses`.
        last_share: share of the second part of a training set in the last batch; it changes linearly
            from the share in the first one. None: it stays constant.
        average_mirror: whether logits are the mean over an image and its mirror image.
    """

    net: NetName | str = "compact"
    optimizer: OptimizerName = "adam"
    lr: Annotated[float, POSITIVE] = 1e-2
    steps: Annotated[int, at_least(1)] = 200
    batch: Annotated[int, at_least(1)] = 8
    warmup: Annotated[int, at_least(0), at_most(2**31 - 1)] = 20
    power: Annotated[float, at_least(0)] = 0.9
    momentum: Annotated[float, within(0, 1, "[)")] = 0.9
    weight_decay: Annotated[float, at_least(0)] = 0.0
    mirror: bool = True
    colour: bool = True
    mix: bool = False
    blur: bool = True
    noise: bool = False
    scale: bool = False
    weighted: bool = True
    predict_batch: Annotated[int, at_least(1)] = 16
    weights: str | None = None
    norm: bool = False
    lr_multipliers: LrMultipliers = "none"
    accumulate: Annotated[int, at_least(1)] = 1
    dtype: Dtype = "float32"
    backbone: BackboneTraining = "frozen"
    views: Annotated[int, at_least(1)] = 2
    head_statistics: HeadStatistics = "training"
    loss_stride: Annotated[int, _STRIDE] = 1
    head_width: Annotated[int, at_least(1), at_most(2**16)] = 64
    head_dropout: Annotated[float, within(0, 1, "[)")] = 0.0
    average: Annotated[float, within(0, 1, "[)")] = 0.0
    heads: Annotated[int, at_least(1), at_most(2**10)] = 1
    jaccard: Annotated[float, at_least(0)] = 0.0
    last_share: Annotated[float | None, within(0, 1)] = None
    average_mirror: bool = False

    @property
    def has_backbone(self) -> bool:
        """Whether the network is a head on a backbone."""
        return self.net not in WHOLE_NETS

    @property
    def frozen(self) -> bool:
        """Whether the network has a backbone that does not train."""
        return self.has_backbone and self.backbone == "frozen"

    @property
    def net_spec(self) -> NetSpec:
        """What decides the network."""
        backbone = BackboneSpec(self.net, self.weights, self.dtype) if self.has_backbone else None
        head = (self.head_width, self.head_dropout)
        return NetSpec(self.net, self.dtype, self.norm, backbone, *head)

    @property
    def augment_spec(self) -> AugmentSpec:
        """What augmentation does."""
        return AugmentSpec(self.mirror, self.scale, self.colour, self.mix, self.blur, self.noise)

    @property
    def optim_spec(self) -> OptimSpec:
        """The optimiser with its rates by layer."""
        multipliers: Multipliers = "backbone" if self.has_backbone else self.lr_multipliers
        return OptimSpec(self.optimizer, self.momentum, self.weight_decay, multipliers)

    @property
    def step_spec(self) -> StepSpec:
        """What decides the compiled step."""
        return StepSpec(
            self.net_spec,
            None if self.frozen else self.augment_spec,
            self.optim_spec,
            self.loss_stride,
            self.jaccard,
            self.accumulate,
            self.average > 0,
        )
