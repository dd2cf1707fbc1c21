"""Prepares a training: checks its images, computes features, statistics and class weights."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Float32, UInt8

from seg import losses, pyramid
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages
from seg.mixing import TrainingSet, mean_share, mixed
from seg.nets import FeatureMaps
from seg.nets.head import STATISTICS, Maps
from seg.pyramid import Statistics
from seg.settings import VGG_NETS, TrainSettings
from seg.step import Params, Variables
from seg.views import view_labels, views
from seg.weights import load

CHUNK = 50
"""Steps between two checks of the loss; also the longest scan on an accelerator."""


class TrainingError(Exception):
    """The loss is no longer finite."""


class PreparedPart(NamedTuple):
    """What a network trains on of one part of its training set, in NumPy."""

    inputs: Any  # u8[n h w 3]; for a frozen backbone the `FeatureMaps` of all views
    labels: UInt8[np.ndarray, "n h w"]  # of all views for a frozen backbone
    class_shares: Float[np.ndarray, " classes"]
    statistics: Statistics | None  # of its features; None where they are not needed


class Prepared(NamedTuple):
    """What a network trains on."""

    parts: tuple[PreparedPart, ...]
    share: float  # of the second part in the first batch
    class_weights: Float32[np.ndarray, " classes"]
    statistics: Statistics | None  # of the head's features; None where they are not needed

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of images, or views, of each part."""
        return tuple(len(part.labels) for part in self.parts)


PartCache = dict[tuple[int, ...], PreparedPart]
"""Prepared parts by the identities of their arrays, which must live as long as the cache."""


def prepare(
    training_set: TrainingSet,
    settings: TrainSettings,
    classes: int,
    statistics: Statistics | None = None,
    resumes: bool = False,
    cache: PartCache | None = None,
) -> Prepared:
    """Check a training set and compute what its training needs.

    Args:
        training_set: labelled images of one size, in one or two parts.
        settings: of the training; `seg.check.check_settings` allows them.
        classes: the network's number of classes.
        statistics: for `head_statistics` "target", those of real images.
        resumes: whether training starts from a trained network, which has statistics.
        cache: of parts that several sets share; with the same other arguments.

    Raises:
        ValueError: settings, images, labels, features and statistics do not fit together.
        WeightsError: the backbone's weights cannot be used.
    """
    for part in training_set.parts:
        check_arrays(part.images, part.labels)
        check_inputs(part.images, settings, part.features, settings.views)
    of_target = settings.head_statistics == "target"
    if statistics is not None and not of_target:
        raise ValueError('statistics are for head_statistics "target"; the settings say "training"')
    if statistics is None and of_target and not resumes:
        raise ValueError('head_statistics "target" needs statistics, or params that have them')
    needs_statistics = settings.has_backbone and statistics is None and not resumes
    cache = {} if cache is None else cache
    parts = tuple(
        _prepared_part(part, settings, classes, needs_statistics, cache)
        for part in training_set.parts
    )
    shares = training_set.shares
    share = shares[-1]
    if len(parts) > 1:  # weights and statistics are those of all batches
        mean = mean_share(share, settings.last_share)
        shares = (1 - mean, mean)
    class_weights = np.ones(classes, np.float32)
    if settings.weighted:
        weighted = [s * part.class_shares for s, part in zip(shares, parts, strict=True)]
        class_weights = losses.weights_of_shares(np.sum(weighted, axis=0))
    if needs_statistics:
        statistics = mixed(shares, [part.statistics for part in parts if part.statistics])
    return Prepared(parts, share, class_weights, statistics)


def _prepared_part(
    part: LabelledImages,
    settings: TrainSettings,
    classes: int,
    needs_statistics: bool,
    cache: PartCache,
) -> PreparedPart:
    key = tuple(map(id, (part.images, part.labels, part.features)))
    if key not in cache:
        check_labels(part.labels, classes)
        inputs: Any = part.images
        labels, maps, statistics = part.labels, part.features, None
        if settings.frozen:
            if maps is None:
                images, labels = views(part.images, labels, settings)
                maps = pyramid.features(images, settings)
            else:
                labels = view_labels(part.images, labels, settings)
            inputs = FeatureMaps(maps, part.images.shape[1:3])
        if needs_statistics:
            statistics = pyramid.channel_statistics(
                pyramid.features(part.images, settings) if maps is None else maps
            )
        shares = losses.class_shares(part.labels, classes)
        cache[key] = PreparedPart(inputs, labels, shares, statistics)
    return cache[key]


def check_arrays(images: np.ndarray, labels: np.ndarray | None = None) -> None:
    """Raise ValueError unless images are RGB bytes with a label for each pixel."""
    if images.ndim != 4 or images.shape[-1] != 3 or images.dtype != np.uint8:
        raise ValueError(f"images must be u8[n, h, w, 3]; got {images.dtype}{list(images.shape)}")
    if len(images) == 0:
        raise ValueError("zero images; expected at least one")
    if labels is None:
        return
    if labels.dtype != np.uint8 or labels.shape != images.shape[:3]:
        raise ValueError(
            f"labels must be u8{list(images.shape[:3])}, one per pixel of the images; "
            f"got {labels.dtype}{list(labels.shape)}"
        )


def check_labels(labels: UInt8[np.ndarray, "n h w"], classes: int) -> None:
    """Raise ValueError if a label is none of the classes."""
    unknown = np.flatnonzero(losses.label_counts(labels)[classes:IGNORE_LABEL])
    if unknown.size:
        raise ValueError(
            f"label {classes + unknown.max()} is none of {classes} classes; expected "
            f"0..{classes - 1}, or {IGNORE_LABEL} for ignored pixels"
        )


def check_inputs(
    images: np.ndarray, settings: TrainSettings, features: Maps | None, views: int
) -> None:
    """Raise ValueError unless the network takes images of this size, and the features are theirs."""
    if settings.has_backbone:
        pyramid.check_size(images, settings)
    if features is not None and not settings.frozen:
        raise ValueError(
            f"features are for a frozen backbone, not for {settings.net}, {settings.backbone}"
        )
    if features is not None:
        pyramid.check_features(features, images, settings, views)


def check_seed(rng_seed: int) -> None:
    """Raise ValueError unless a seed has 32 bits."""
    if not 0 <= rng_seed < 2**32:
        raise ValueError(f"rng_seed must be in 0..2**32 - 1; got {rng_seed}")


def head_seeds(rng_seed: int, heads: int) -> list[int]:
    """The seeds of the heads' parameters and images; the first has that of the training."""
    more = (np.random.SeedSequence([rng_seed, head]) for head in range(1, heads))
    return [rng_seed, *(int(sequence.generate_state(1)[0]) for sequence in more)]


def first_variables(
    params: Params, settings: TrainSettings, statistics: Statistics | None
) -> Variables:
    """The variables at the start: random parameters, but where the settings name weights."""
    if settings.net in VGG_NETS and settings.weights is not None:
        params = load(settings.weights, settings.net, params)
    if not settings.has_backbone:
        return {"params": params}
    assert statistics is not None
    if not settings.frozen:
        params = {**params, "backbone": pyramid.backbone_params(settings)}
    mean, deviation = statistics
    return {"params": params, STATISTICS: {"head": {"mean": mean, "deviation": deviation}}}


def error_of_weights(variables: Any, settings: TrainSettings) -> str | None:
    """Say that weights of a trained network are not finite, as after a last bad step; None if they are."""
    if all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(variables)):
        return None
    return (
        f"weights are not finite after {settings.steps} steps; a lower learning rate than "
        f"{settings.lr} may help"
    )


def error_of(loss: float, step: int, settings: TrainSettings) -> str | None:
    """Say that the loss after a step is not finite; None if it is."""
    if np.isfinite(loss):
        return None
    return (
        f"the loss is {loss} after {step} of {settings.steps} steps; "
        f"a lower learning rate than {settings.lr} may help"
    )
