"""The simplest model: each class is the mean and spread of its colours and rows. NumPy alone."""

import numpy as np

IGNORE = 255


def features(images: np.ndarray) -> np.ndarray:
    """Colour in [0, 1] and row in [0, 1] of every pixel: f32[n, h, w, 4]."""
    rows = np.linspace(0, 1, images.shape[1], dtype=np.float32)[:, None, None]
    rows = np.broadcast_to(rows, (*images.shape[:3], 1))
    return np.concatenate([images.astype(np.float32) / 255, rows], axis=-1)


def score(
    images: np.ndarray, labels: np.ndarray, real_images: np.ndarray, real_labels: np.ndarray
) -> float:
    """Mean IoU over the real classes of the most likely class of each pixel."""
    rendered, classes = features(images), [k for k in np.unique(labels) if k != IGNORE]
    real = features(real_images)
    likelihoods = []
    for k in classes:
        pixels = rendered[labels == k]
        mean, spread = pixels.mean(axis=0), pixels.std(axis=0) + 0.02
        likelihoods.append(-(((real - mean) / spread) ** 2).sum(axis=-1) / 2 - np.log(spread).sum())
    predictions = np.array(classes)[np.argmax(likelihoods, axis=0)]
    labelled = real_labels != IGNORE
    ious = []
    for k in np.unique(real_labels[labelled]):
        predicted, true = (predictions == k) & labelled, real_labels == k
        ious.append((predicted & true).sum() / (predicted | true).sum())
    return float(np.mean(ious))
