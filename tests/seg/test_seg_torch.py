"""Our nets give what the same nets in PyTorch give, and read what PyTorch saves."""

import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install torch")

from benchmarks import torch_nets  # noqa: E402
from seg.losses import cross_entropy  # noqa: E402
from seg.nets import VGG16, Compact, DeepLabV2, FCN8s  # noqa: E402
from seg.weights import WeightsError  # noqa: E402
from seg.weights.read import read  # noqa: E402

from .conftest import filled  # noqa: E402

CLASSES = 5
NETS = [
    (FCN8s(CLASSES, width=8, hidden=32), torch_nets.FCN8s(CLASSES, width=8, hidden=32)),
    (DeepLabV2(CLASSES, width=8, hidden=32), torch_nets.DeepLabV2(CLASSES, width=8, hidden=32)),
    (Compact(CLASSES), torch_nets.Compact(CLASSES)),
]


@pytest.mark.parametrize(("ours", "theirs", "size"), [
    *((*nets, size) for nets in NETS for size in ((64, 96), (61, 75))),
    *((VGG16(8, atrous), torch_nets.VGG16(8, atrous), (64, 96)) for atrous in (False, True)),
])  # fmt: skip
def test_logits_and_features_are_those_of_pytorch(ours, theirs, size):
    images = np.random.default_rng(0).normal(size=(2, *size, 3)).astype(np.float32)
    params = filled(ours, images)
    torch_nets.copy(params, theirs)
    with torch.no_grad():
        expected = jax.tree.leaves(theirs.eval()(torch_nets.images_of(images)))
    found = jax.tree.leaves(jax.jit(ours.apply)({"params": params}, images))
    for mine, other in zip(found, expected, strict=True):
        assert other.std() > 0.05
        np.testing.assert_allclose(mine, other.numpy().transpose(0, 2, 3, 1), atol=1e-4)


def test_loss_and_gradient_are_those_of_pytorch():
    rng = np.random.default_rng(0)
    logits = rng.normal(size=(2, 6, 7, CLASSES)).astype(np.float32)
    labels = rng.integers(0, CLASSES, (2, 6, 7)).astype(np.uint8)
    labels[0, :2] = 255
    weights = rng.uniform(0.5, 2, CLASSES).astype(np.float32)
    loss, gradient = jax.value_and_grad(cross_entropy)(*map(jnp.asarray, (logits, labels, weights)))
    leaf = torch_nets.images_of(logits).requires_grad_()
    given = torch.from_numpy(labels).long(), torch.from_numpy(weights)
    theirs = torch.nn.functional.cross_entropy(leaf, *given, ignore_index=255)
    theirs.backward()
    assert float(loss) == pytest.approx(theirs.item(), rel=1e-5)
    np.testing.assert_allclose(gradient, leaf.grad.numpy().transpose(0, 2, 3, 1), atol=1e-6)


@pytest.mark.parametrize("zipped", [True, False], ids=["zip", "legacy"])
def test_state_dicts_are_read_as_pytorch_reads_them(tmp_path, zipped):
    module = torch_nets.FCN8s(CLASSES, width=2, hidden=3)
    state = module.state_dict()
    state["half"] = torch.arange(6).reshape(2, 3).half().T
    state["brain"] = torch.linspace(0, 1, 5).bfloat16()[1:4]
    state["count"] = torch.tensor(7)
    state["parameter"] = torch.nn.Parameter(torch.ones(2))
    path = tmp_path / "weights.pth"
    torch.save(state, path, _use_new_zipfile_serialization=zipped)
    arrays = read(path)
    assert list(arrays) == list(state)
    for name, tensor in state.items():
        tensor = tensor.detach().float()
        np.testing.assert_array_equal(arrays[name].astype(np.float32), tensor.numpy())


class Shell:
    """Would run a command when it is unpickled."""

    def __reduce__(self):
        return os.system, ("exit 1",)


@pytest.mark.parametrize("zipped", [True, False], ids=["zip", "legacy"])
@pytest.mark.parametrize(("value", "message"), [
    ({"features.0.weight": Shell()}, r"it calls (posix|nt)\.system; expected a state dict"),
    (torch.nn.Conv2d(3, 4, 3), r"it calls torch\.nn\.modules\.conv\.Conv2d"),
    ({"state_dict": {"a": torch.ones(2)}}, "'state_dict' is a dict; .* save that one alone"),
    ([torch.ones(2)], "holds a list; expected a state dict"),
    ({"epoch": 3}, "'epoch' is a int"),
], ids=["shell", "module", "nested", "list", "number"])  # fmt: skip
def test_what_is_no_state_dict_is_refused_unread(tmp_path, value, message, zipped):
    path = tmp_path / "weights.pth"
    torch.save(value, path, _use_new_zipfile_serialization=zipped)
    with pytest.raises(WeightsError, match=f"weights.pth: .*{message}"):
        read(path)
