"""Lite0 is what PyTorch makes of the same file: features, logits, loss, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

torch = pytest.importorskip(
    "torch", reason="PyTorch is not installed: pip install torch (the extra `torch`)"
)

from torch.nn import functional as F  # noqa: E402

from benchmarks import torch_nets  # noqa: E402
from seg.losses import cross_entropy  # noqa: E402
from seg.nets import Lite0, normalise  # noqa: E402
from seg.nets.lite0 import BLOCKS, TAPS, Trunk, pyramid, statistics  # noqa: E402
from seg.nets.ops.depthwise import same  # noqa: E402
from seg.pyramid import trunk_params  # noqa: E402
from seg.weights import lite0  # noqa: E402

CLASSES = 5


def pictures(h, w, count=2):
    """Smooth random pictures, RGB in [0, 1]: noise has features like no photograph's."""
    rng = np.random.default_rng(h * w)
    coarse = rng.random((count, h // 8 + 2, w // 8 + 2, 3)).astype(np.float32)
    return np.asarray(jax.image.resize(coarse, (count, h, w, 3), "linear"))


def published(images):
    """The features by the file's own names, with batch normalisation as it was trained."""
    state = torch.load(lite0.path(), weights_only=True)

    def layer(x, conv, norm, stride=1):
        kernel = state[f"{conv}.weight"]
        side = kernel.shape[-1]
        (above, below), (left, right) = (same(n, side, stride) for n in x.shape[-2:])
        groups = kernel.shape[0] if kernel.shape[1] == 1 else 1
        x = F.conv2d(F.pad(x, (left, right, above, below)), kernel, stride=stride, groups=groups)
        parts = (state[f"{norm}.{p}"] for p in ("running_mean", "running_var", "weight", "bias"))
        return F.batch_norm(x, *parts, training=False, eps=1e-3)

    x = F.relu6(layer((255 * images - 127) / 128, "_conv_stem", "_bn0", 2))
    maps = []
    for number, block in enumerate(BLOCKS):
        at, y = f"_blocks.{number}.", x
        if block.expand > 1:
            y = F.relu6(layer(y, f"{at}_expand_conv", f"{at}_bn0"))
        y = F.relu6(layer(y, f"{at}_depthwise_conv", f"{at}_bn1", block.stride))
        y = layer(y, f"{at}_project_conv", f"{at}_bn2")
        x = x + y if y.shape == x.shape and block.stride == 1 else y
        if number in TAPS:
            maps.append(x)
    return maps


@pytest.mark.parametrize("size", [(64, 96), (40, 72)])
def test_features_are_those_of_the_published_net(size):
    images = pictures(*size)
    with torch.no_grad():
        expected = published(torch_nets.images_of(images))
    maps = jax.jit(Trunk().apply)({"params": trunk_params()}, images)
    for mine, other in zip(maps, expected, strict=True):
        other = other.numpy().transpose(0, 2, 3, 1)
        assert other.std() > 0.3
        np.testing.assert_allclose(mine, other, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("size", [(64, 96), (45, 61)])
def test_logits_loss_and_gradients_are_those_of_pytorch(size):
    images = np.asarray(normalise(jnp.asarray(pictures(*size))))
    ours, theirs = Lite0(CLASSES, width=16), torch_nets.Lite0(CLASSES, width=16)
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(ours.init, jax.random.key(0), images)["params"]

    def draw(leaf):
        fan_in = max(int(np.prod(leaf.shape[:-1])), 1)
        return rng.normal(0, np.sqrt(2 / fan_in), leaf.shape).astype(np.float32)

    params = {"trunk": trunk_params(), "head": jax.tree.map(draw, shapes["head"])}
    maps = jax.jit(Trunk().apply)({"params": params["trunk"]}, pictures(*size))
    params["head"]["mean"], params["head"]["deviation"] = statistics(pyramid(maps))
    torch_nets.copy(params, theirs)
    labels = rng.integers(0, CLASSES, images.shape[:3]).astype(np.uint8)
    labels[0, :5] = 255
    weights = rng.uniform(0.5, 2, CLASSES).astype(np.float32)

    def loss_of(params):
        logits = ours.apply({"params": params}, jnp.asarray(images))
        return cross_entropy(logits, jnp.asarray(labels), jnp.asarray(weights)), logits

    (loss, logits), gradient = jax.jit(jax.value_and_grad(loss_of, has_aux=True))(params)
    expected = theirs(torch_nets.images_of(images))
    their_loss = F.cross_entropy(
        expected, torch.from_numpy(labels).long(), torch.from_numpy(weights), ignore_index=255
    )
    their_loss.backward()
    np.testing.assert_allclose(
        logits, expected.detach().numpy().transpose(0, 2, 3, 1), atol=1e-4, rtol=1e-4
    )
    assert float(loss) == pytest.approx(their_loss.item(), abs=1e-4)
    named = dict(theirs.named_parameters())
    compared = 0
    for path, mine in jax.tree_util.tree_leaves_with_path(gradient):
        *home, part = (key.key for key in path)
        if part in ("mean", "deviation"):
            continue
        grad = named[".".join([*home, "bias" if part == "bias" else "weight"])].grad.numpy()
        grad = grad.transpose(2, 3, 1, 0) if grad.ndim == 4 else grad
        np.testing.assert_allclose(mine, grad, atol=1e-4, rtol=1e-3, err_msg=str(path))
        compared += 1
    assert compared == len(named)
