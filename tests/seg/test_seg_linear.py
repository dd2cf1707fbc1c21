"""The linear net and its credits beside the same in plain NumPy, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import softmax

from seg.linear import RIDGE, Moments, cell_labels, credits, moments
from seg.linear import tested as solved  # not a test
from seg.metrics import confusion_matrix
from seg.nets.trunks import TRUNKS, trunk_of
from seg.pyramid import LITE0
from seg.settings import TrainSettings

from .conftest import SEEDS, assert_close, assert_same

CLASSES, SIZE, CELLS = 3, (45, 61), (6, 8)
STATISTICS = np.linspace(-0.5, 0.5, 6, dtype=np.float32), np.linspace(0.5, 2, 6, dtype=np.float32)
OF = STATISTICS, LITE0
WEIGHTS = np.repeat([1, 0.3], 2)
"""Of the images of two sets."""


def drawn(seed, count=2, classes=CLASSES):
    """Maps and labels of cells, with some void; the finest map tells the classes."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, classes, (count, *CELLS), np.uint8)
    shapes = (*CELLS, 3), (3, 4, 2), (2, 2, 1)
    maps = [rng.normal(size=(count, *shape)) for shape in shapes]
    maps[0] += np.eye(CLASSES)[labels]
    labels[rng.random(labels.shape) < 0.1] = 255
    return tuple(m.astype(np.float16) for m in maps), labels


def sets(seed, classes=CLASSES):
    """Two for training and one to be tested."""
    return drawn((seed, 0), 2, classes), drawn((seed, 1), 2, classes), drawn((seed, 2), 3)


def trained(one, other):
    own = [moments(*images, *OF, CLASSES) for images in (one, other)]
    return own[0] + own[1].times(WEIGHTS[-1])


def cells(maps):
    """Normalised features, f64[n cells channels]."""

    def large(m, axis, times):
        at = (np.arange(times * m.shape[axis]) + 0.5) / times - 0.5
        return np.apply_along_axis(lambda v: np.interp(at, np.arange(len(v)), v), axis, m)

    own = [large(large(np.float64(m), 1, 2**k), 2, 2**k)[:, :6, :8] for k, m in enumerate(maps)]
    x = (np.concatenate(own, axis=-1) - STATISTICS[0]) / STATISTICS[1]
    return x.reshape(len(x), -1, x.shape[-1])


def scores(one, other, maps, weights=WEIGHTS):
    """Log probabilities of each class in cells, up to a constant, by normals of one covariance."""
    x = np.concatenate([cells(images[0]) for images in (one, other)])
    labels = np.concatenate([one[1], other[1]]).reshape(len(x), -1)
    known = labels < 255
    weight, x, labels = np.repeat(weights, known.sum(axis=1)), x[known], labels[known]
    counts = np.bincount(labels, weight, CLASSES)
    means = np.stack([(weight * (labels == k)) @ x for k in range(CLASSES)])
    means /= np.maximum(counts, 1)[:, None]
    within = np.cov((x - means[labels]).T, aweights=weight, ddof=0)
    within += RIDGE * np.mean(np.diag(within)) * np.eye(len(within))
    far = cells(maps)[:, :, None] - means
    with np.errstate(divide="ignore"):
        prior = np.log(counts / counts.sum())
    return prior - np.einsum("nqkc,cd,nqkd->nqk", far, np.linalg.inv(within), far) / 2


def soft_miou(logits, labels):
    known = labels.reshape(len(labels), -1) < 255
    guess, truth = softmax(logits[known], axis=-1), np.eye(CLASSES)[labels[labels < 255]]
    both = (guess * truth).sum(axis=0)
    return np.mean((both / (guess.sum(axis=0) + truth.sum(axis=0) - both))[truth.any(axis=0)])


@given(SEEDS, st.sampled_from([2, 3]))
def test_it_is_a_linear_discriminant_that_knows_only_the_classes_of_its_training(seed, classes):
    one, other, (maps, labels) = sets(seed, classes)
    maps = tuple(8 * m for m in maps)  # real images can be far from rendered ones
    found, slope = solved(trained(one, other), maps, labels, *OF)
    guess = scores(one, other, maps).argmax(axis=-1).reshape(labels.shape)
    np.testing.assert_array_equal(found, confusion_matrix(labels, guess, CLASSES))
    assert np.all(np.isfinite(credits(slope, *one, *OF)))


@given(SEEDS, st.sampled_from([2, 3]))
def test_credits_are_the_derivative_by_the_weight_of_an_image(seed, classes):
    one, other, (maps, labels) = sets(seed, classes)
    _, slope = solved(trained(one, other), maps, labels, *OF)
    found = np.concatenate([credits(slope, *images, *OF) for images in (one, other)])
    step = 1e-4 * np.eye(4)
    expected = [
        soft_miou(scores(one, other, maps, WEIGHTS + by), labels)
        - soft_miou(scores(one, other, maps, WEIGHTS - by), labels)
        for by in step
    ]
    np.testing.assert_allclose(found, np.array(expected) / 2e-4, atol=1e-5)
    assert np.abs(found).max() > 1e-3
    assert abs(WEIGHTS @ found) < 1e-5  # only shares of the set count


@given(SEEDS)
def test_void_cells_count_for_nothing(seed):
    one, other, (maps, labels) = sets(seed)
    images, own = one
    changed = (np.where(own[..., None] == 255, np.float16(9), images[0]), *images[1:]), own
    assert_same(moments(*changed, *OF, CLASSES), moments(*one, *OF, CLASSES))
    training = trained(one, other)
    _, slope = solved(training, maps, labels, *OF)
    assert_same(credits(slope, *changed, *OF), credits(slope, *one, *OF))
    void = np.full_like(own, 255)
    assert not credits(slope, images, void, *OF).any()
    beside = np.where(labels[..., None] == 255, np.float16(9), maps[0]), *maps[1:]
    assert_same(solved(training, beside, labels, *OF), solved(training, maps, labels, *OF))


@given(SEEDS)
def test_moments_add_in_any_order(seed):
    one, other = drawn((seed, 0)), drawn((seed, 1))
    found = moments(*one, *OF, CLASSES) + moments(*other, *OF, CLASSES)
    order = np.random.default_rng(seed).permutation(4)
    both = jax.tree.map(lambda *parts: np.concatenate(parts)[order], one, other)
    assert_close(found, moments(*both, *OF, CLASSES), rtol=1e-5, atol=1e-4)
    x, labels = cells(both[0])[both[1].reshape(4, -1) < 255], both[1][both[1] < 255]
    truth = np.eye(CLASSES)[labels]
    expected = Moments(truth.sum(axis=0), truth.T @ x, x.T @ x)
    assert_close(found, expected, rtol=1e-5, atol=1e-4)


def test_a_trunk_may_need_its_file_of_weights(monkeypatch):
    own = trunk_of(LITE0)
    monkeypatch.setitem(
        TRUNKS, "filed", lambda weights: own._replace(source={"file": weights + ""})
    )
    filed, images = TrainSettings(net="filed", weights="w"), drawn(0)
    found = moments(*images, STATISTICS, filed, CLASSES)
    assert_same(found, moments(*images, *OF, CLASSES))


def test_labels_of_cells_are_those_of_their_centres_at_any_size():
    rows, cols = np.indices(SIZE, np.uint8)
    found = cell_labels(np.stack([rows, cols]), LITE0)
    assert_same(found[0], np.repeat([[4], [12], [20], [28], [36], [44]], 8, axis=1))
    assert_same(found[1], np.repeat([[4, 12, 20, 28, 36, 44, 52, 60]], 6, axis=0))
    outline = trunk_of(LITE0).module.init_with_output
    (finest, *_), _ = jax.eval_shape(outline, jax.random.key(0), jnp.zeros((2, *SIZE, 3)))
    assert found.shape == finest.shape[:3]
    # The centre of the last cells may lie outside.
    assert cell_labels(np.stack([rows, cols])[:, :42, :58], LITE0)[:, -1, -1].tolist() == [41, 57]
