"""The nets of ``seg.nets`` in PyTorch, with which ours are compared in results and in speed.

Layers have the names of ours, so that ``copy`` can put the same parameters into both.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from seg.nets.lite import SIZES, STEM, Block, blocks_of, taps_of
from seg.nets.ops.depthwise import same
from seg.nets.ops.normalise import MEAN, STD


def convolution(c_in: int, c_out: int, side: int, dilation: int = 1) -> nn.Conv2d:
    """A convolution that keeps the size."""
    return nn.Conv2d(c_in, c_out, side, padding=dilation * (side // 2), dilation=dilation)


def padded(x: Tensor, multiple: int) -> Tensor:
    """Pad with zeros below and on the right until the size is a multiple."""
    h, w = x.shape[-2:]
    return F.pad(x, (0, -w % multiple, 0, -h % multiple))


def enlarged(x: Tensor, times: int, size: tuple[int, int]) -> Tensor:
    """Enlarge bilinearly between pixel centres, and crop."""
    large = F.interpolate(x, scale_factor=times, mode="bilinear", align_corners=False)
    return large[..., : size[0], : size[1]]


class VGG16(nn.Module):
    """Five stages of convolutions; returns each pooled stage."""

    def __init__(self, width: int = 64, atrous: bool = False) -> None:
        super().__init__()
        self.atrous = atrous
        c_in = 3
        for stage, (count, factor) in enumerate(
            zip((2, 2, 3, 3, 3), (1, 2, 4, 8, 8), strict=True), 1
        ):
            for number in range(1, count + 1):
                dilation = 2 if atrous and stage == 5 else 1
                layer = convolution(c_in, factor * width, 3, dilation)
                self.add_module(f"conv{stage}_{number}", layer)
                c_in = factor * width

    def forward(self, x: Tensor) -> list[Tensor]:
        pools = []
        for stage, count in enumerate((2, 2, 3, 3, 3), 1):
            for number in range(1, count + 1):
                x = F.relu(getattr(self, f"conv{stage}_{number}")(x))
            if self.atrous:
                x = F.max_pool2d(x, 3, stride=2 if stage <= 3 else 1, padding=1)
            else:
                x = F.max_pool2d(x, 2)
            pools.append(x)
        return pools


class FCN8s(nn.Module):
    def __init__(self, classes: int, width: int = 64, hidden: int = 4096) -> None:
        super().__init__()
        self.vgg16 = VGG16(width)
        self.fc6 = convolution(8 * width, hidden, 7)
        self.fc7 = convolution(hidden, hidden, 1)
        self.score_fr = convolution(hidden, classes, 1)
        self.score_pool4 = convolution(8 * width, classes, 1)
        self.score_pool3 = convolution(4 * width, classes, 1)
        double = {"kernel_size": 4, "stride": 2, "padding": 1, "bias": False}
        self.upscore2 = nn.ConvTranspose2d(classes, classes, **double)
        self.upscore_pool4 = nn.ConvTranspose2d(classes, classes, **double)

    def forward(self, images: Tensor) -> Tensor:
        pools = self.vgg16(padded(images, 32))
        x = pools[4]
        for layer in (self.fc6, self.fc7):
            x = F.dropout(F.relu(layer(x)), 0.5, self.training)
        x = self.upscore2(self.score_fr(x)) + self.score_pool4(pools[3])
        x = self.upscore_pool4(x) + self.score_pool3(pools[2])
        return enlarged(x, 8, (images.shape[2], images.shape[3]))


class DeepLabV2(nn.Module):
    def __init__(self, classes: int, width: int = 64, hidden: int = 1024) -> None:
        super().__init__()
        self.vgg16 = VGG16(width, atrous=True)
        for number, rate in enumerate((6, 12, 18, 24), 1):
            self.add_module(f"fc6_{number}", convolution(8 * width, hidden, 3, rate))
            self.add_module(f"fc7_{number}", convolution(hidden, hidden, 1))
            self.add_module(f"fc8_{number}", convolution(hidden, classes, 1))

    def forward(self, images: Tensor) -> Tensor:
        features = self.vgg16(padded(images, 8))[-1]
        scores = []
        for number in range(1, 5):
            x = features
            for name in ("fc6", "fc7"):
                x = F.relu(getattr(self, f"{name}_{number}")(x))
                x = F.dropout(x, 0.5, self.training)
            scores.append(getattr(self, f"fc8_{number}")(x))
        total = scores[0] + scores[1] + scores[2] + scores[3]
        return enlarged(total, 8, (images.shape[2], images.shape[3]))


class _ConvNormRelu(nn.Module):
    def __init__(self, c_in: int, c_out: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        # With stride 2 and an even size, JAX pads on the far side only.
        self.padding = (0, 1, 0, 1) if stride == 2 else (dilation,) * 4
        self.Conv_0 = nn.Conv2d(c_in, c_out, 3, stride, dilation=dilation, bias=False)
        self.GroupNorm_0 = nn.GroupNorm(8, c_out, eps=1e-6)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.GroupNorm_0(self.Conv_0(F.pad(x, self.padding))))


class Compact(nn.Module):
    def __init__(self, classes: int, width: int = 24) -> None:
        super().__init__()
        self._ConvNormRelu_0 = _ConvNormRelu(49, width)
        self._ConvNormRelu_1 = _ConvNormRelu(width, width)
        self._ConvNormRelu_2 = _ConvNormRelu(width, 2 * width, stride=2)
        self._ConvNormRelu_3 = _ConvNormRelu(2 * width, 2 * width, dilation=2)
        self._ConvNormRelu_4 = _ConvNormRelu(2 * width, 2 * width, dilation=2)
        self.Conv_0 = convolution(2 * width, width, 1)
        self._ConvNormRelu_5 = _ConvNormRelu(width, width)
        self.Conv_1 = convolution(width, classes, 1)

    def forward(self, images: Tensor) -> Tensor:
        x = padded(images, 8)
        b, c, h, w = x.shape
        # The order in cells is ours: row, column, colour, from the slowest to the fastest.
        x = x.reshape(b, c, h // 4, 4, w // 4, 4).permute(0, 3, 5, 1, 2, 4)
        x = x.reshape(b, 16 * c, h // 4, w // 4)
        row = torch.linspace(-1, 1, h // 4)[None, None, :, None].expand(b, 1, -1, w // 4)
        x = self._ConvNormRelu_0(torch.cat([x, row], 1))
        skip = self._ConvNormRelu_1(x)
        x = self._ConvNormRelu_2(skip)
        x = x + self._ConvNormRelu_3(x)
        x = x + self._ConvNormRelu_4(x)
        x = F.interpolate(self.Conv_0(x), scale_factor=2, mode="nearest")
        x = self._ConvNormRelu_5(x + skip)
        return enlarged(self.Conv_1(x), 4, (images.shape[2], images.shape[3]))


class _Same(nn.Conv2d):
    """A convolution with TensorFlow's "SAME" padding: the odd cell comes after."""

    def __init__(self, c_in: int, c_out: int, side: int, stride: int = 1, groups: int = 1) -> None:
        inside = side // 2 if stride == 1 else 0
        super().__init__(c_in, c_out, side, stride, inside, groups=groups)

    def forward(self, x: Tensor) -> Tensor:
        if self.stride[0] > 1:
            (above, below), (left, right) = (
                same(n, self.kernel_size[0], self.stride[0]) for n in x.shape[-2:]
            )
            x = F.pad(x, (left, right, above, below))
        return super().forward(x)


class _Block(nn.Module):
    def __init__(self, c_in: int, shape: Block) -> None:
        super().__init__()
        inner = shape.expand * c_in
        self.residual = shape.stride == 1 and c_in == shape.features
        if shape.expand > 1:
            self.expand = _Same(c_in, inner, 1)
        self.depthwise = _Same(inner, inner, shape.side, shape.stride, groups=inner)
        self.project = _Same(inner, shape.features, 1)

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu6(self.expand(x)) if hasattr(self, "expand") else x
        y = self.project(F.relu6(self.depthwise(y)))
        return x + y if self.residual else y


class Backbone(nn.Module):
    """An EfficientNet-Lite on RGB in [0, 1] with folded batch normalisation: strides 4, 8, 16, 32."""

    def __init__(self, net: str) -> None:
        super().__init__()
        self.blocks = blocks_of(SIZES[net])
        self.stem = _Same(3, STEM, 3, 2)
        c_in = STEM
        for number, shape in enumerate(self.blocks):
            self.add_module(f"block{number}", _Block(c_in, shape))
            c_in = shape.features

    def forward(self, images: Tensor) -> list[Tensor]:
        x = F.relu6(self.stem(padded((255 * images - 127) / 128, 8)))
        maps = []
        for number in range(len(self.blocks)):
            x = getattr(self, f"block{number}")(x)
            if number in taps_of(self.blocks):
                maps.append(x)
        return maps


class Head(nn.Module):
    """Features resized to 1/8, concatenated, normalised; 1x1, separable 3x3, 1x1; bilinear logits."""

    def __init__(self, classes: int, channels: int, width: int = 64) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("deviation", torch.ones(channels))
        self.project = convolution(channels, width, 1)
        self.depthwise = _Same(width, width, 3, groups=width)
        self.mix = convolution(width, width, 1)
        self.score = convolution(width, classes, 1)

    def forward(self, maps: list[Tensor], size: tuple[int, int]) -> Tensor:
        rows, cols = maps[1].shape[-2:]
        resized = [F.avg_pool2d(maps[0], 2), maps[1]]
        resized += [enlarged(m, t, (rows, cols)) for m, t in zip(maps[2:], (2, 4), strict=True)]
        x = torch.cat(resized, 1)
        x = (x - self.mean[None, :, None, None]) / self.deviation[None, :, None, None]
        x = F.relu(self.mix(self.depthwise(F.relu(self.project(x)))))
        return enlarged(self.score(x), 8, size)


class Lite(nn.Module):
    """Backbone and head on normalised RGB, like the other nets."""

    def __init__(self, classes: int, net: str = "lite0", width: int = 64) -> None:
        super().__init__()
        self.backbone = Backbone(net)
        taps = taps_of(self.backbone.blocks)
        self.head = Head(classes, sum(self.backbone.blocks[k].features for k in taps), width)
        self.register_buffer("shift", torch.tensor(MEAN)[None, :, None, None])
        self.register_buffer("scale", torch.tensor(STD)[None, :, None, None])

    def forward(self, images: Tensor) -> Tensor:
        maps = self.backbone(images * self.scale + self.shift)
        return self.head(maps, (images.shape[2], images.shape[3]))


NETS: dict[str, Any] = {"compact": Compact, "deeplabv2": DeepLabV2, "fcn8s": FCN8s}
NETS |= {net: partial(Lite, net=net) for net in SIZES}


def copy(params: Mapping[str, Any], module: nn.Module) -> None:
    """Put Flax parameters, or statistics, into a net of this file.

    A transposed convolution of PyTorch is the gradient of a convolution, so its kernel is flipped.
    """
    for name, value in params.items():
        child = getattr(module, name)
        if isinstance(child, Tensor):  # a statistic
            child.copy_(torch.from_numpy(np.array(value)))
            continue
        if not isinstance(child, (nn.Conv2d, nn.ConvTranspose2d, nn.GroupNorm)):
            copy(value, child)
            continue
        for part, array in value.items():
            array = np.asarray(array)
            if isinstance(child, nn.ConvTranspose2d):
                array = array[::-1, ::-1].transpose(2, 3, 0, 1)
            elif array.ndim == 4:
                array = array.transpose(3, 2, 0, 1)
            target = child.bias if part == "bias" else child.weight
            assert target is not None and target.shape == array.shape, (name, part)
            with torch.no_grad():
                target.copy_(torch.from_numpy(np.array(array, order="C")))


def images_of(images: np.ndarray) -> Tensor:
    """[b, h, w, c] to PyTorch's [b, c, h, w]."""
    return torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2)))
