"""DINOv2: its tokens are those of transformers, its file is checked, a head learns on it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import save_file

from experiments.app.export import export
from seg import RECIPES, mean_iou, predict, score
from seg.inference import logits
from seg.model import Model, label_classes, load_model
from seg.nets.backbones import make_backbone
from seg.nets.dinov2 import VARIANTS, DinoV2, Variant, bicubic
from seg.nets.ops.normalise import normalise
from seg.pyramid import features
from seg.recipes import with_net
from seg.train import train
from seg.weights.dinov2 import weights_of

from .conftest import assert_same, pixels, refuses, refuses_weights, toy

C = 64
"""Channels of a token in the files of most tests, and two layers: kilobytes, not 88 MB."""


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(VARIANTS, C, Variant("ViT-tiny/14", 2))


def tensors(c=C, seed=0):
    """Random weights in Hugging Face's layout."""
    shapes = {
        "embeddings.cls_token": (1, 1, c),
        "embeddings.mask_token": (1, c),
        "embeddings.position_embeddings": (1, 1370, c),
        "embeddings.patch_embeddings.projection.weight": (c, 3, 14, 14),
        "embeddings.patch_embeddings.projection.bias": (c,),
        "layernorm.weight": (c,), "layernorm.bias": (c,),
    }  # fmt: skip
    for k in range(VARIANTS[c].depth):
        linear = dict.fromkeys(("query", "key", "value"), (c, c))
        linear = {f"attention.attention.{name}": shape for name, shape in linear.items()}
        linear |= {"attention.output.dense": (c, c), "mlp.fc1": (4 * c, c), "mlp.fc2": (c, 4 * c)}
        layer = {f"{name}.weight": shape for name, shape in linear.items()}
        layer |= {f"{name}.bias": shape[:1] for name, shape in linear.items()}
        layer |= {f"norm{i}.{part}": (c,) for i in (1, 2) for part in ("weight", "bias")}
        layer |= {f"layer_scale{i}.lambda1": (c,) for i in (1, 2)}
        shapes |= {f"encoder.layer.{k}.{name}": shape for name, shape in layer.items()}
    rng = np.random.default_rng(seed)
    arrays = {}
    for name, shape in shapes.items():
        centre = float(("norm" in name and name.endswith("weight")) or "lambda" in name)
        scale = np.prod(shape[1:]) ** -0.5 if len(shape) in (2, 4) else 0.2
        arrays[name] = rng.normal(centre, scale, shape).astype(np.float32)
    return arrays


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "model.safetensors"
    save_file(tensors(), path)
    return path


def settings_of(path, **changes):
    settings = with_net(RECIPES["lite0-frozen"], net="dinov2", weights=str(path))
    return replace(settings, steps=40, batch=2, predict_batch=2, **changes)


@pytest.mark.parametrize("size", [(224, 224), (364, 490)])
@pytest.mark.parametrize(("channels", "depth"), [
    (384, 12), pytest.param(768, 12, marks=pytest.mark.slow),
])  # fmt: skip
def test_tokens_are_those_of_transformers(channels, depth, size, tmp_path):
    """Random weights of ordinary sizes, through the file that `save_pretrained` writes."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install torch")
    hub = pytest.importorskip("transformers", reason="pip install transformers")
    config = hub.Dinov2Config(
        hidden_size=channels, num_attention_heads=channels // 64, num_hidden_layers=depth,
        image_size=518, patch_size=14,
    )  # fmt: skip
    reference = hub.Dinov2Model(config).eval()
    with torch.no_grad():
        generator = torch.Generator().manual_seed(0)
        for name, value in reference.named_parameters():
            if value.ndim > 1 or "bias" in name:
                scale = value[0].numel() ** -0.5 if value.ndim in (2, 4) else 0.2
                value.copy_(scale * torch.randn(value.shape, generator=generator))
    reference.save_pretrained(tmp_path)
    images = jnp.asarray(np.random.default_rng(1).random((2, *size, 3), np.float32))
    pixel_values = torch.from_numpy(np.array(normalise(images)).transpose(0, 3, 1, 2).copy())
    with torch.no_grad():
        expected = reference(pixel_values=pixel_values).last_hidden_state[:, 1:].numpy()
    backbone = make_backbone("dinov2", str(tmp_path / "model.safetensors"))
    (tokens,) = jax.jit(backbone.module.apply)({"params": backbone.load()}, images)
    rows, cols = (side // 14 for side in size)
    assert tokens.shape == (2, rows, cols, channels) and expected.std() > 0.5
    np.testing.assert_allclose(tokens.reshape(expected.shape), expected, atol=1e-4)


def test_bicubic_is_the_identity_at_its_own_size_and_exact_for_lines():
    np.testing.assert_array_equal(bicubic(37, 37), np.eye(37))
    matrix = bicubic(37, 16)
    np.testing.assert_allclose(matrix.sum(1), 1, atol=1e-6)
    centres = (np.arange(16) + 0.5) * 37 / 16 - 0.5
    np.testing.assert_allclose(matrix[1:-1] @ np.arange(37), centres[1:-1], atol=0.12)
    # By hand, half-way between two samples, for A = -0.75: -3/32, 19/32, 19/32, -3/32.
    row = bicubic(8, 4)[1]
    np.testing.assert_allclose(row, [0, -3 / 32, 19 / 32, 19 / 32, -3 / 32, 0, 0, 0][: len(row)])


def test_images_are_filled_up_to_whole_patches(file):
    backbone = make_backbone("dinov2", str(file))
    assert (backbone.strides, backbone.channels, backbone.source["name"]) == (
        (14,),
        (C,),
        "DINOv2 ViT-tiny/14",
    )
    images = jnp.asarray(pixels(1, 28, 42, 3) / np.float32(255))
    mean = jnp.broadcast_to(jnp.array([0.485, 0.456, 0.406]), (1, 28, 50, 3))
    wide = mean.at[:, :, :42].set(images)
    tokens = [
        backbone.module.apply({"params": backbone.load()}, x)[0] for x in (wide, wide[:, :, :43])
    ]
    assert tokens[0].shape == (1, 2, 4, C)
    whole = jnp.broadcast_to(mean[:, :, :1], (1, 28, 56, 3)).at[:, :, :50].set(wide)
    (expected,) = backbone.module.apply({"params": backbone.load()}, whole)
    np.testing.assert_allclose(tokens[0], expected, atol=1e-4)
    np.testing.assert_allclose(tokens[1], expected, atol=1e-4)
    assert (
        DinoV2(C).clone(dtype=jnp.bfloat16).apply({"params": backbone.load()}, wide)[0].dtype
        == "f4"
    )


def test_a_head_on_its_tokens_learns_and_its_model_is_loaded_where_the_file_is(file, tmp_path):
    images, labels = toy(4, (56, 70))
    settings = settings_of(file)
    net = train(0, images, labels, settings, 2)
    assert net["params"]["head"]["project"]["kernel"].shape == (1, 1, C, 64)
    maps = features(images, settings)
    assert [m.shape for m in maps] == [(4, 4, 5, C)]
    assert mean_iou(score(net, images, labels, settings, 2)) > 0.6
    assert_same(*(predict(net, images, settings, 2, features=f) for f in (maps, None)))
    model = Model(settings, net, (56, 70), label_classes(["road", "sky"]))
    model.save(tmp_path / "model")
    expected = model.predict(images)
    runtime = pytest.importorskip("onnxruntime")
    export(model, tmp_path / "net.onnx")
    providers = ["CPUExecutionProvider"]
    session = runtime.InferenceSession(str(tmp_path / "net.onnx"), providers=providers)
    scores = session.run(["logits"], {"image": images[:1]})[0]
    np.testing.assert_allclose(scores, logits(net, images[:1], settings, 2), atol=1e-2)
    assert_same(load_model(tmp_path / "model").predict(images), expected)
    # Beside the model, where both have moved.
    moved = tmp_path / "elsewhere"
    (tmp_path / "model").rename(moved)
    file.rename(moved / file.name)
    assert_same(load_model(moved).predict(images), expected)
    save_file(tensors(seed=1), moved / file.name)
    make_backbone.cache_clear()
    refuses(r"config\.json: its head was trained on the backbone DINOv2 ViT-tiny/14 .*, not on",
            load_model, moved, error=Exception)  # fmt: skip
    (moved / file.name).unlink()
    refuses(r"the weights of its backbone are missing; expected .*model", load_model, moved,
            error=Exception)  # fmt: skip


@pytest.mark.parametrize(("name", "value", "message"), [
    ("encoder.layer.1.mlp.fc2.bias", None, r"is missing; expected all of DINOv2 ViT-tiny/14"),
    ("encoder.layer.0.norm1.weight", np.ones(C + 1, np.float32),
     r": float32\[65\]; DINOv2 ViT-tiny/14 has float32\[64\]"),
    ("embeddings.position_embeddings", np.ones((1, 257, C), np.float32), r": float32\[1, 257, 64\]"),
    ("layernorm.bias", np.full(C, np.nan, np.float32), ": holds values that are not finite"),
    ("embeddings.cls_token", None, " is missing; expected DINOv2 in Hugging Face's layout"),
    ("embeddings.cls_token", np.ones((1, 1, 1024), np.float32), r": \[1, 1, 1024\]; expected DINO"),
    ("embeddings.register_tokens", np.ones((1, 4, C), np.float32), ": DINOv2 .* no such tensor"),
])  # fmt: skip
def test_files_that_do_not_fit(name, value, message):
    changed = {k: v for k, v in {**tensors(), name: value}.items() if v is not None}
    refuses_weights(
        rf"^model\.safetensors: {name} ?{message}", weights_of, changed, "model.safetensors"
    )
