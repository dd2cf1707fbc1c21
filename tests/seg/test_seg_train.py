"""Training, prediction, scoring, on tiny images of one shape (each new shape is a compilation)."""

import subprocess
import sys
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import seg
from common.labels.target_file import shipped
from seg import (
    TrainingError,
    TrainSettings,
    check_settings,
    mean_iou,
    predict,
    score,
)
from seg.batches import in_batches
from seg.data import LabelledImages, list_split, load, read_split
from seg.inference import apply, heads_of, logits, predict_heads, variable_shapes
from seg.losses import class_shares, weights_of_shares
from seg.prepare import check_arrays
from seg.pyramid import features
from seg.step import Data, functions, plan
from seg.train import train
from seg.views import with_mirror

from .conftest import assert_close, assert_same, refuses, toy

SETTINGS = TrainSettings(steps=150, batch=2, warmup=5, predict_batch=4)
LITE0 = {"net": "lite0"}


@pytest.fixture(scope="module")
def fitted():
    return train(0, *toy(), SETTINGS, 11)


def test_two_images_are_learnt_training_can_go_on_and_padding_changes_nothing(fitted):
    images, labels = toy()
    confusion = score(fitted, images, labels, SETTINGS, 11)
    assert confusion.sum() == (labels != 255).sum() and mean_iou(confusion) > 0.9
    before = jax.tree.map(np.array, fitted)
    further = train(3, *toy(), replace(SETTINGS, steps=1, warmup=0, lr=1e-4), 11, params=fitted)
    assert_same(fitted, before)
    assert_close(fitted, further, atol=2e-4)
    images, _ = toy(6)
    whole, first_five, last = (
        predict(fitted, x, SETTINGS, 11) for x in (images, images[:5], images[5:])
    )
    assert whole.shape == (6, 32, 32) and whole.dtype == np.uint8
    np.testing.assert_array_equal(np.concatenate([first_five, last]), whole)


def test_same_seed_same_net_other_seed_another_and_progress_is_told(fitted):
    reports = []
    again = train(0, *toy(), SETTINGS, 11, progress=lambda *args: reports.append(args))
    assert [step for step, _ in reports] == [50, 100, 150] and reports[-1][1] < reports[0][1]
    assert_same(fitted, again)
    nets = (train(seed, *toy(), replace(SETTINGS, steps=3, warmup=1), 11) for seed in (0, 1))
    first, other = (ravel_pytree(params)[0] for params in nets)
    assert not np.array_equal(first, other)


def test_every_step_has_noise_of_its_own_and_seeds_drawn_at_once_are_those_alone():
    images, labels = toy()

    def losses(noise):
        settings = replace(SETTINGS, noise=noise, colour=False, blur=False)
        compiled = functions(settings, 11)
        data = Data(images, labels, np.ones(11, np.float32), np.uint32(0))
        state = compiled.init(np.uint32(0), images)
        row = plan(0, len(images), settings).rows(0)._replace(lr=np.float32(0))
        values = []
        for _ in range(3):  # of the same images and parameters
            state, loss = compiled.step(state, data, row)
            values.append(float(loss))
        return len(set(values))

    assert (losses(True), losses(False)) == (3, 1)
    init = partial(functions(SETTINGS, 11).init, images=images)
    seeds = np.array([3, 8], np.uint32)
    together = jax.vmap(lambda seed: init(seed).params)(seeds)
    for k, seed in enumerate(seeds):
        assert_same(jax.tree.map(lambda leaf, k=k: leaf[k], together), init(seed).params)


def test_heads_are_nets_of_their_own_whose_mean_logits_count(narrow_lite):
    """The first is that of the same seed alone, and each has weights and an order of its own."""
    images, labels = (np.repeat(part, 2, axis=1).repeat(2, axis=2) for part in toy(4))
    one_head = TrainSettings(net=narrow_lite, steps=4, batch=2, warmup=0, head_width=8)
    settings = replace(one_head, heads=3)
    reported_steps = []
    net = train(
        5, images, labels, settings, 11, progress=lambda *args: reported_steps.append(args[0])
    )
    assert reported_steps == [4, 8, 12]
    heads = heads_of(net, settings.heads)
    assert_same(heads[0], train(5, images, labels, one_head, 11))
    kernels = net["params"]["head"]["project"]["kernel"]
    assert len({kernel.tobytes() for kernel in np.asarray(kernels)}) == len(kernels) == 3
    head_logits = [logits(head, images, one_head, 11) for head in heads]
    np.testing.assert_allclose(
        logits(net, images, settings, 11), np.mean(head_logits, 0), atol=1e-4
    )
    labels_of_heads = predict_heads(net, images, settings, 11)
    expected = [predict(net, images, settings, 11)]
    expected += [predict(head, images, one_head, 11) for head in heads]
    assert (labels_of_heads == np.stack(expected, axis=1)).mean() > 0.999  # sums have another order
    np.testing.assert_array_equal(
        predict_heads(heads[0], images, one_head, 11), expected[1][:, None]
    )
    shapes = jax.tree.map(
        lambda leaf: (leaf.shape, leaf.dtype), (net, variable_shapes(settings, 11))
    )
    assert shapes[0] == shapes[1]
    further = train(6, images, labels, replace(settings, lr=1e-6), 11, params=net)
    assert_close(further, net, atol=1e-4)
    steps = []
    options = {"stepwise": False, "progress": lambda *args: steps.append(args[0])}
    at_once = train(5, images, labels, settings, 11, **options)
    assert steps == [12]
    assert_close(at_once, net, rtol=1e-3, atol=1e-4)
    at_once = train(6, images, labels, replace(settings, lr=1e-6), 11, params=net, **options)
    assert_close(at_once, further, rtol=1e-3, atol=1e-4)
    with pytest.raises(TrainingError, match="loss is nan after 4 of 4 steps"):
        train(5, images, labels, replace(settings, lr=1e30), 11, **options)
    with pytest.raises(ValueError, match="checkpoints are for networks of one head"):
        train(5, images, labels, settings, 11, checkpoints=2)
    with pytest.raises(ValueError, match="checkpoints are for networks of one head"):
        train(5, images, labels, settings, 11, at_checkpoint=steps.append)


def test_few_images_are_predicted_in_a_small_batch(fitted, monkeypatch):
    sizes = []

    def recorded(run, images, size):
        sizes.append(size)
        return in_batches(run, images, size)

    monkeypatch.setattr("seg.inference.in_batches", recorded)
    settings, images, whole = replace(SETTINGS, predict_batch=16), toy(count=20)[0], []
    for count in (1, 5, 20):
        whole.append(logits(fitted, images[:count], settings, 11))
    assert sizes == [1, 6, 16]
    assert_close(whole[0][0], whole[2][0], atol=1e-4)


def test_weights_that_are_not_finite_are_an_error():
    settings = replace(SETTINGS, steps=1, warmup=0, lr=3e38, optimizer="sgd", weight_decay=1e4)
    with pytest.raises(TrainingError, match="weights are not finite after 1 steps"):
        train(0, *toy(), settings, 11)


def test_parts_of_a_set_keep_the_features_of_their_views():
    """Features of three images in two views are the numbers of their rows."""
    images = np.arange(3, dtype=np.uint8)[:, None, None, None]
    maps = (np.array([0, 1, 2, 10, 11, 12])[:, None],)
    test_set = LabelledImages(images, images[..., 0], tuple("abc"), features=maps)
    for part, rows in (
        (test_set.take([-1]), [2]), (test_set.take(np.array([False, True, True])), [1, 2]),
        (test_set.take([]), []), (test_set.between(1, 9), [1, 2]),
    ):  # fmt: skip
        assert part.images.ravel().tolist() == rows and part.names == tuple("abc"[k] for k in rows)
        assert part.features[0].ravel().tolist() == rows + [10 + k for k in rows]


@pytest.mark.parametrize("kind", ["net", "head"])
def test_logits_are_the_mean_over_an_image_and_its_mirror_image(kind, narrow_lite):
    settings = TrainSettings(steps=2, warmup=0)
    if kind == "head":
        settings = replace(settings, net=narrow_lite, heads=2, head_width=8)
    images, labels = (part.repeat(2, axis=1).repeat(2, axis=2) for part in toy(3))
    images, labels = images[:, :, :57], labels[:, :, :57]  # the last cell of a map is cut
    averaged = replace(settings, average_mirror=True)
    net = train(0, images, labels, settings, 11)
    direct, mirrored = (logits(net, x, settings, 11) for x in (images, images[:, :, ::-1]))
    expected = (direct + mirrored[:, :, ::-1]) / 2
    np.testing.assert_allclose(logits(net, images, averaged, 11), expected, atol=1e-4)
    np.testing.assert_allclose(apply(net, jnp.asarray(images), averaged, 11), expected, atol=2e-3)
    whole = predict(net, images, averaged, 11)
    assert (whole == expected.argmax(-1)).mean() > 0.999
    np.testing.assert_array_equal(whole[:, :, ::-1], predict(net, images[:, :, ::-1], averaged, 11))
    if settings.frozen and settings.has_backbone:
        maps = features(with_mirror(images, averaged), averaged)
        np.testing.assert_array_equal(predict(net, images, averaged, 11, features=maps), whole)
        test_set = LabelledImages(images, labels, features=maps)
        for part in (test_set.between(1, 3), test_set.take([1, 2])):
            predictions = predict(net, part.images, averaged, 11, features=part.features)
            np.testing.assert_array_equal(predictions, whole[1:3])
        with pytest.raises(ValueError, match="2 views of each"):
            predict(net, images, averaged, 11, features=features(images, averaged))


def test_a_jaccard_loss_and_a_rising_share_change_the_net_and_nothing_else():
    images, labels = toy(4)
    brief = replace(SETTINGS, steps=3, warmup=0)
    nets = [train(0, images, labels, s, 11) for s in (brief, replace(brief, jaccard=1.0))]
    assert any(map(np.any, jax.tree.leaves(jax.tree.map(np.subtract, *nets))))
    extra, first = LabelledImages(images[2:], labels[2:]), LabelledImages(images[:2], labels[:2])
    steps = replace(brief, steps=8)
    sets = {"extra": extra, "share": 0.25}
    constant, same, rising = (
        train(0, *first[:2], replace(steps, last_share=last), 11, **sets)
        for last in (None, 0.25, 1.0)
    )
    assert_same(constant, same)
    assert any(map(np.any, jax.tree.leaves(jax.tree.map(np.subtract, same, rising))))


def test_scanned_steps_are_the_same_steps():
    settings = replace(SETTINGS, steps=3, warmup=1, lr=1e-3)
    fitted = (train(0, *toy(), settings, 11, stepwise=stepwise) for stepwise in (True, False))
    assert_close(*fitted, atol=1e-4)


@pytest.mark.parametrize(("average", "averaged"), [(0.6, 6), (0.01, 1), (0.99, 10)])
def test_the_trained_net_is_the_mean_over_the_last_steps(average, averaged):
    images, labels = toy()
    settings = replace(SETTINGS, steps=10, lr=1e-3, weighted=False, average=average)
    compiled, rows = functions(settings, 11), plan(0, len(images), settings)
    data = jax.device_put(Data(images, labels, np.ones(11, np.float32), np.uint32(0)))
    state, nets = compiled.init(data.seed, images), []
    for i in range(settings.steps):
        state, _ = compiled.step(state, data, rows.rows(i))
        nets.append({"params": jax.tree.map(np.array, state.params)})
    last = nets[-averaged:]
    expected = jax.tree.map(lambda *leaves: np.mean(leaves, axis=0, dtype=np.float64), *last)
    assert_close(train(0, images, labels, settings, 11), expected, atol=1e-6)
    assert_same(train(0, images, labels, replace(settings, average=0.0), 11), nets[-1])


def test_checkpoints_are_the_nets_of_their_steps_and_change_none():
    settings = replace(SETTINGS, steps=10, lr=1e-3, average=0.4)
    kept = []

    def train_(**more):
        keep = {"at_checkpoint": lambda net: kept.append(jax.tree.map(np.array, net))}
        return train(0, *toy(), settings, 11, **(keep | more))

    without = train_(at_checkpoint=None)
    for checkpoints in (1, 4):
        assert_same(train_(checkpoints=checkpoints), without)
    one, first, second, third, last = kept  # after 2, 5, 7 and 10 steps; the last 4 are averaged
    for net in (one, last):
        assert_same(net, without)
    nets = []
    rows, compiled = plan(0, 2, settings), functions(settings, 11)
    weights = weights_of_shares(class_shares(toy()[1], 11))
    data = jax.device_put(Data(*toy(), weights, np.uint32(0)))
    state = compiled.init(data.seed, data.images)
    for i in range(10):
        state, _ = compiled.step(state, data, rows.rows(i))
        nets.append({"params": jax.tree.map(np.array, state.params)})
    for network, step in ((first, 2), (second, 5), (third, 7)):
        assert_same(network, nets[step - 1])
    for count in (0, 11):
        with pytest.raises(ValueError, match=rf"checkpoints must lie in 1\.\.10, .* got {count}"):
            train_(checkpoints=count)


def test_means_are_the_same_scanned_and_where_training_goes_on(fitted):
    settings = replace(SETTINGS, steps=4, warmup=1, lr=1e-3, average=0.5)
    ways = (train(0, *toy(), settings, 11, stepwise=stepwise) for stepwise in (True, False))
    assert_close(*ways, atol=1e-4)
    last = replace(settings, steps=1, warmup=0)
    ways = (train(0, *toy(), s, 11, params=fitted) for s in (last, replace(last, average=0.0)))
    assert_same(*ways)  # not the mean with the parameters at the start


def test_all_void_labels_do_no_harm_and_a_loss_that_is_not_finite_is_an_error():
    images, labels = toy()
    params = train(0, images, np.full_like(labels, 255), replace(SETTINGS, steps=2, warmup=1), 11)
    assert np.isfinite(ravel_pytree(params)[0]).all()
    with pytest.raises(TrainingError, match=r"loss is nan after 50 of 60 steps; .*1e\+30"):
        train(0, *toy(), replace(SETTINGS, steps=60, lr=1e30), 11)


@pytest.mark.parametrize(("name", "dtype"), [
    ("adam", "float32"), ("sgd", "float32"), ("adam", "bfloat16"),
])  # fmt: skip
def test_state_keeps_structure_shapes_and_dtypes(name, dtype):
    images, labels = toy()
    settings = replace(SETTINGS, optimizer=name, dtype=dtype, weight_decay=1e-4, average=0.5)
    compiled = functions(settings, 11)
    state = jax.eval_shape(compiled.init, np.uint32(0), images)
    data = Data(images, labels, np.ones(11, np.float32), np.uint32(0))
    row = plan(0, len(images), SETTINGS).rows(0)
    after, loss = jax.eval_shape(compiled.step, state, data, row)
    assert after == state and (loss.shape, loss.dtype) == ((), np.float32)


def test_every_image_is_seen_equally_often_and_what_is_compiled_is_kept():
    rows = plan(0, 6, TrainSettings(steps=9, batch=4))
    assert rows.batch_indices.shape == (9, 4) and len(rows.draws) == len(rows.lr) == 9
    np.testing.assert_array_equal(np.bincount(rows.batch_indices.ravel()), [6] * 6)
    other_data = replace(SETTINGS, steps=3, lr=0.1, batch=5, weights="vgg16.npz")
    assert functions(SETTINGS, 11) is functions(other_data, 11)
    assert functions(SETTINGS, 11) is not functions(replace(SETTINGS, mirror=False), 11)
    averaged, more = (functions(replace(SETTINGS, average=share), 11) for share in (0.3, 0.6))
    assert averaged is more is not functions(SETTINGS, 11)


@pytest.mark.parametrize(("images", "labels", "message"), [
    (np.zeros((0, 8, 8, 3), np.uint8), np.zeros((0, 8, 8), np.uint8), "zero images"),
    (np.zeros((2, 8, 8, 1), np.uint8), None, r"images must be u8\[n, h, w, 3\]"),
    (np.zeros((2, 8, 8, 3), np.float32), None, "got float32"),
    (np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 9), np.uint8), "one per pixel"),
    (np.zeros((2, 8, 8, 3), np.uint8), np.zeros((3, 8, 8), np.uint8), "one per pixel"),
    (np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 8, 8), np.int32), "got int32"),
])  # fmt: skip
def test_arrays_that_do_not_fit(images, labels, message):
    refuses(message, check_arrays, images, labels)


@pytest.mark.parametrize(("change", "message"), [
    ({"steps": 0}, "steps must be 1 or more, not 0"),
    ({"lr": 0.0}, "lr must be positive, not 0.0"),
    ({"batch": 0}, "batch must be 1 or more, not 0"),
    ({"accumulate": 0}, "accumulate must be 1 or more, not 0"),
    ({"batch": 4, "accumulate": 3}, "accumulate must divide the batch of 4 evenly, not 3"),
    ({"weights": "vgg16.npz"}, "neither of which is in the network compact"),
    ({"net": "fcn8s", "weights": "vgg16.npz", "norm": True}, "norm is for training from scratch"),
    ({"backbone": "tuned"}, '"tuned", but the network compact has no backbone; lite0'),
    ({"net": "fcn8s", "backbone": "tuned"}, "the network fcn8s has no backbone"),
    (LITE0 | {"weights": "vgg16.npz"}, "in the network lite0; its own weights come with a package"),
    (LITE0 | {"norm": True}, "are for fcn8s and deeplabv2, not for lite0"),
    (LITE0 | {"lr_multipliers": "deeplab"}, "are for fcn8s and deeplabv2, not for lite0"),
    (LITE0 | {"views": 0}, "views must be 1 or more, not 0"),
    (LITE0 | {"loss_stride": 3}, "loss_stride must be one of 1, 2, 4, 8, not 3"),
    ({"loss_stride": 2}, "are for networks with a backbone; the network is compact"),
    (LITE0 | {"head_width": 0}, "head_width must be 1 or more, not 0"),
    (LITE0 | {"head_dropout": 1.0}, r"head_dropout must lie in \[0, 1\), not 1\.0"),
    ({"average": 1.0}, r"average must lie in \[0, 1\), not 1\.0"),
    ({"dtype": "float16"}, "dtype must be one of float32, bfloat16, not float16"),
    ({"optimizer": "lion"}, "optimizer must be one of adam, sgd, not lion"),
    ({"net": "fcn8"}, "unknown network 'fcn8'; known networks: compact, deeplabv2, dinov2, fcn8s, lite0"),
    (LITE0 | {"backbone": "Tuned"}, "backbone must be one of frozen, tuned, not Tuned"),
    (LITE0 | {"head_statistics": "both"}, "head_statistics must be one of training, target, not both"),
    ({"net": "compact", "norm": True}, "are for fcn8s and deeplabv2, not for compact"),
    ({"net": "compact", "lr_multipliers": "deeplab"}, "are for fcn8s and deeplabv2, not for compact"),
    ({"momentum": 1.5}, "momentum must lie in"),
    ({"lr_multipliers": "caffe"}, "lr_multipliers must be one of none, deeplab, not caffe"),
    ({"mirror": "no"}, "mirror must be True or False, not 'no'"),
    ({"steps": 100.5}, "steps must be a whole number, not 100.5"),
    ({"steps": 100, "warmup": 100}, "warmup must be less than the 100 steps, not 100"),
    ({"heads": 2}, "heads must be 1, not 2, for the network compact without a frozen backbone"),
    (LITE0 | {"backbone": "tuned", "heads": 2}, "for the network lite0 without a frozen backbone"),
    ({"accumulate": 2, "jaccard": 1.0}, "jaccard is of a whole batch, and accumulate cuts it"),
    ({"last_share": 1.5}, r"last_share must lie in \[0, 1\], not 1\.5"),
    ({"jaccard": -1.0}, "jaccard must be 0 or more, not -1.0"),
    ({"average": -0.1}, r"average must lie in \[0, 1\), not -0\.1"),
])  # fmt: skip
def test_settings_that_make_no_sense(change, message):
    images, labels = toy()
    settings = copy(SETTINGS)
    vars(settings).update(change)  # `replace` refuses other types here, but not where users are
    refuses(message, check_settings, settings)
    refuses(message, train, 0, images, labels, settings, 11)
    for seed in (-1, 2**32):
        refuses("rng_seed must be in", train, seed, images, labels, SETTINGS, 11)
    with pytest.raises(ValueError, match=r"label 11 is none of 11 .* 0\.\.10, or 255 for ignored"):
        train(0, images, np.where(labels == 1, 11, labels).astype(np.uint8), SETTINGS, 11)


def test_public_names_exist_and_reading_data_does_not_load_jax():
    assert all(hasattr(seg, name) for name in seg.__all__)
    with pytest.raises(AttributeError, match="colour_table"):
        _ = seg.colour_table
    code = "import seg.data, seg.metrics, sys; assert not {'jax', 'flax'} & set(sys.modules)"
    root = Path(seg.__file__).parents[1]
    subprocess.run([sys.executable, "-c", code], cwd=root, check=True)


def test_real_images_are_learnt(camvid_dir):
    files = shipped("camvid")
    entries = [e for e in list_split(files, camvid_dir, "train") if e.sequence != "0006R0"]
    data, held_out = (
        load(entries, files, (48, 64)),
        read_split("camvid", camvid_dir, "val", (48, 64)),
    )
    settings = TrainSettings()
    params = train(0, data.images, data.labels, settings, 11)
    assert 0.20 < mean_iou(score(params, held_out.images, held_out.labels, settings, 11)) < 0.32
