"""Networks trained at once are those trained one by one, whatever the padding and the neighbours."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seg import TrainingError, TrainSettings, predict_heads, train, train_many
from seg.at_once import padded
from seg.data import LabelledImages
from seg.metrics import confusion_matrix
from seg.mixing import TrainingSet, training_set
from seg.nets.backbones import backbone_of

from .conftest import SEEDS, assert_close, assert_same, pixels, refuses

CLASSES = 3
HEAD = TrainSettings(
    net="lite0",
    steps=4,
    batch=3,
    warmup=1,
    views=2,
    head_width=8,
    head_dropout=0.2,
    predict_batch=2,
)
COMPACT = TrainSettings(steps=2, batch=2, warmup=0, lr=1e-3, noise=True, predict_batch=2)
"""In a loop, XLA's CPU backend is slow at convolutions: few steps of few images."""


def images_of(count: int, config: TrainSettings, seed: int = 0, views: int | None = None):
    """Noise, with features of noise for a frozen backbone, whose own would take seconds."""
    side = 32 if config.frozen else 16
    images = pixels(count, side, side, 3, seed=seed)
    labels = pixels(count, side, side, seed=seed + 1, below=CLASSES)
    labels[:, :3] = 255
    maps = None
    if config.frozen:
        rng, backbone = np.random.default_rng(seed), backbone_of(config)
        rows = count * (config.views if views is None else views)
        maps = tuple(
            rng.normal(size=(rows, side // stride, side // stride, c)).astype(np.float16)
            for stride, c in zip(backbone.strides, backbone.channels, strict=True)
        )
    return LabelledImages(images, labels, features=maps)


def one_by_one(seeds, sets, config):
    for seed, images in zip(seeds, sets, strict=True):
        parts, shares = images if isinstance(images, TrainingSet) else ((images,), (1.0,))
        more = {} if len(parts) == 1 else {"extra": parts[1], "share": shares[1]}
        first = parts[0]
        yield train(
            seed, *first[:2], config, CLASSES, features=first.features, stepwise=True, **more
        )


def check_same(seeds, sets, config, test):
    """Variables agree, and so do confusion matrices, but for pixels whose best classes are equally good."""
    networks = train_many(seeds, sets, config, CLASSES, test=test)
    assert len(networks) == len(seeds) and networks.errors == (None,) * len(seeds)
    for k, expected in enumerate(one_by_one(seeds, sets, config)):
        assert_close(networks.variables(k), expected, rtol=2e-3, atol=2e-4)
        views = predict_heads(expected, test.images, config, CLASSES, features=test.features)
        for image in range(len(test.images)):
            matrix = confusion_matrix(test.labels[image], views[image, 0], CLASSES)
            assert np.abs(networks.by_image[k, image] - matrix).sum() <= 0.02 * matrix.sum()
            assert (networks.by_image[k, image].sum(1) == matrix.sum(1)).all()
        for head in range(1, views.shape[1]):
            matrix = confusion_matrix(test.labels, views[:, head], CLASSES)
            assert np.abs(networks.by_head[k, head - 1] - matrix).sum() <= 0.02 * matrix.sum()
    return networks


@settings(max_examples=5)
@given(st.lists(SEEDS, min_size=3, max_size=3), st.floats(0.2, 0.8))
def test_heads_trained_at_once_are_those_trained_alone(seeds, share):
    first = images_of(3, HEAD)
    sets = [first, images_of(4, HEAD, 5), training_set(images_of(1, HEAD, 9), first, share)]
    check_same(seeds, sets, HEAD, images_of(3, HEAD, 11, views=1))


@settings(max_examples=3)
@given(st.lists(SEEDS, min_size=2, max_size=2), st.floats(0.2, 0.8))
def test_compact_networks_trained_at_once_are_those_trained_alone(seeds, share):
    sets = [
        images_of(2, COMPACT),
        training_set(images_of(2, COMPACT, 7), images_of(1, COMPACT, 9), share),
    ]
    check_same(seeds, sets, COMPACT, images_of(3, COMPACT, 11))


def test_several_heads_means_mirror_images_and_a_rising_share_at_once():
    config = replace(HEAD, heads=2, average=0.5, average_mirror=True, last_share=0.9, jaccard=1.0)
    sets = [training_set(images_of(2, config, k), images_of(2, config, k + 3), 0.3) for k in (0, 6)]
    networks = check_same([3, 4], sets, config, images_of(3, config, 11, views=2))
    assert networks.by_head.shape == (2, 2, CLASSES, CLASSES)


def test_neighbours_and_padding_change_nothing():
    sets = [images_of(count, HEAD, count) for count in (3, 4, 2)]
    whole = train_many([1, 2, 3], sets, HEAD, CLASSES)
    assert whole.by_image is None
    steps = []
    progress = lambda step, loss: steps.append((step, np.isfinite(loss)))  # noqa: E731
    alone = train_many([2, 1], [sets[1], sets[0]], HEAD, CLASSES, progress=progress)
    assert steps == [(4, True)]
    assert_close(alone.variables(0), whole.variables(1), atol=1e-5)
    assert_close(alone.variables(1), whole.variables(0), atol=1e-5)


def test_a_network_that_diverges_spoils_no_other():
    sets = [images_of(3, HEAD, seed) for seed in range(3)]
    test = images_of(2, HEAD, 11, views=1)
    expected = train_many([0, 1, 2], sets, HEAD, CLASSES, test=test)
    sets[1].features[0][:] = np.inf
    networks = train_many([0, 1, 2], sets, HEAD, CLASSES, test=test)
    assert networks.errors[::2] == (None, None)
    assert (
        networks.errors[1]
        == "the loss is nan after 4 of 4 steps; a lower learning rate than 0.01 may help"
    )
    for k in (0, 2):
        assert_same(networks.variables(k), expected.variables(k))
        np.testing.assert_array_equal(networks.by_image[k], expected.by_image[k])
    assert not networks.by_image[1].any() and expected.by_image[1].any()
    assert np.isnan(jax.tree.leaves(networks.stacked["params"])[0][1]).any()
    with pytest.raises(TrainingError, match="loss is nan after 4 of 4"):
        networks.variables(1)


def test_weights_that_are_not_finite_after_the_last_step_are_an_error():
    config = replace(HEAD, steps=1, warmup=0, lr=3e38, optimizer="sgd", weight_decay=1e4)
    networks = train_many(
        [0], [images_of(3, config)], config, CLASSES, test=images_of(2, config, 11, 1)
    )
    assert networks.errors[0].startswith("weights are not finite after 1 steps")
    assert not networks.by_image.any()


@given(st.integers(1, 10**6))
def test_counts_are_padded_to_two_sizes_an_octave(count):
    size = padded(count)
    assert count <= size < 1.5 * count + 1 and padded(size) == size
    while size % 2 == 0:
        size //= 2
    assert size in (1, 3)


def test_what_cannot_be_trained_at_once_is_refused():
    good, features = images_of(2, HEAD), images_of(2, HEAD).features
    other = LabelledImages(pixels(2, 64, 32, 3), pixels(2, 64, 32, below=3))
    for message, seeds, sets, change in (
        ("got 2 and 1", [0, 1], [good], {}),
        ("got 0 and 0", [], [], {}),
        ("rng_seed must be in", [0, 2**32], [good, good], {}),
        (r"sets\[1\]: label 11 is none of 3", [0, 1], [good, good._replace(labels=good.labels | 9)], {}),
        (r"sets\[0\]: features are for a frozen backbone", [0], [good], {"net": "compact"}),
        (r"sets\[1\]: .*share .* must lie in \(0, 1\); got 1.0", [0, 1],
         [good, TrainingSet((good, good), (0.0, 1.0))], {}),
        (r"sets\[0\]: a training set has one or two parts, with a share for each; got 2 and 1", [0],
         [TrainingSet((good, good))], {}),
        (r"sets\[0\]: a training set has one or two parts, .*; got 3 and 3", [0],
         [TrainingSet((good, good, good), (0.5, 0.3, 0.2))], {}),
        (r"one size; got 32x32 in sets\[0\], 32x64 in sets\[1\]", [0, 1],
         [good._replace(features=None), other], {"net": "compact"}),
        ("warmup must be less", [0], [good], {"warmup": 4}),
    ):  # fmt: skip
        refuses(message, train_many, seeds, sets, replace(HEAD, **change), CLASSES)
    test = good._replace(features=tuple(m[:1] for m in features))
    refuses("expected float16", train_many, [0], [good], HEAD, CLASSES, test=test)
