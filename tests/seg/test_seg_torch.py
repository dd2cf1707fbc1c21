"""Our networks give what the same networks in PyTorch give, and read what PyTorch saves."""

import jax
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install torch")

from benchmarks import torch_nets  # noqa: E402
from seg.nets import VGG16, Compact, DeepLabV2, FCN8s, net, normalise  # noqa: E402
from seg.nets.backbones import make_backbone  # noqa: E402
from seg.nets.head import statistics  # noqa: E402
from seg.weights.read import read  # noqa: E402

from .conftest import assert_close, filled, normal  # noqa: E402

CLASSES = 5
NETS = [
    (FCN8s(CLASSES, width=8, hidden=32), torch_nets.FCN8s(CLASSES, width=8, hidden=32)),
    (DeepLabV2(CLASSES, width=8, hidden=32), torch_nets.DeepLabV2(CLASSES, width=8, hidden=32)),
    (Compact(CLASSES), torch_nets.Compact(CLASSES)),
]


@pytest.mark.parametrize(("module", "torch_module", "size"), [
    *((*nets, size) for nets in NETS for size in ((64, 96), (61, 75))),
    *((VGG16(8, atrous), torch_nets.VGG16(8, atrous), (64, 96)) for atrous in (False, True)),
])  # fmt: skip
def test_logits_and_features_are_those_of_pytorch(module, torch_module, size):
    pictures = 0.45 + 0.22 * normal(2, *size, 3)
    assert_as_in_pytorch(module, torch_module, pictures, filled(module, pictures))


def assert_as_in_pytorch(module, torch_module, pictures, params, rtol=1e-7, **others):
    """Networks normalise RGB in [0, 1] themselves; those of PyTorch, and our VGG16, take it normalised."""
    normalised = normalise(pictures)
    variables = {"params": params, **others}
    for collection in variables.values():
        torch_nets.copy(collection, torch_module)
    with torch.no_grad():
        expected = jax.tree.leaves(
            torch_module.eval()(torch_nets.images_of(np.asarray(normalised)))
        )
    assert all(other.std() > 0.05 for other in expected)
    images = normalised if isinstance(module, VGG16) else pictures
    outputs = jax.tree.leaves(jax.jit(module.apply)(variables, images))
    assert_close(outputs, [o.numpy().transpose(0, 2, 3, 1) for o in expected], rtol, atol=1e-4)


@pytest.mark.parametrize(("name", "size"), [
    ("lite0", (64, 96)), ("lite0", (45, 61)), ("lite2", (64, 96)),
])  # fmt: skip
def test_logits_of_a_lite_are_those_of_pytorch(name, size):
    rng = np.random.default_rng(0)  # noise has features like no photo's, so it is enlarged
    coarse = rng.random((2, size[0] // 8 + 2, size[1] // 8 + 2, 3)).astype(np.float32)
    pictures = jax.image.resize(coarse, (2, *size, 3), "linear")
    module = net(name, CLASSES, width=16)
    params = filled(module, pictures) | {"backbone": make_backbone(name).load()}
    maps = jax.jit(make_backbone(name).module.apply)({"params": params["backbone"]}, pictures)
    head_statistics = dict(zip(("mean", "deviation"), statistics(maps), strict=True))
    torch_module = torch_nets.Lite(CLASSES, name, width=16)
    assert_as_in_pytorch(
        module, torch_module, pictures, params, rtol=1e-4, statistics={"head": head_statistics}
    )


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
