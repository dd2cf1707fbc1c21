"""A net of the smallest kind: each class is the mean and spread of its colours and rows. NumPy alone."""

import numpy as np

VOID = 255


def features(images: np.ndarray) -> np.ndarray:
    """Colour in [0, 1] and row in [0, 1] of every pixel: f32[n, h, w, 4]."""
    rows = np.linspace(0, 1, images.shape[1], dtype=np.float32)[:, None, None]
    rows = np.broadcast_to(rows, (*images.shape[:3], 1))
    return np.concatenate([images.astype(np.float32) / 255, rows], axis=-1)


def score(
    images: np.ndarray, labels: np.ndarray, real_images: np.ndarray, real_labels: np.ndarray
) -> float:
    """Mean IoU over the real classes of the most likely class of each pixel."""
    seen, classes = features(images), [k for k in np.unique(labels) if k != VOID]
    real = features(real_images)
    fits = []
    for k in classes:
        own = seen[labels == k]
        mean, spread = own.mean(axis=0), own.std(axis=0) + 0.02
        fits.append(-(((real - mean) / spread) ** 2).sum(axis=-1) / 2 - np.log(spread).sum())
    found = np.array(classes)[np.argmax(fits, axis=0)]
    counts = real_labels != VOID
    ious = []
    for k in np.unique(real_labels[counts]):
        ours, theirs = (found == k) & counts, real_labels == k
        ious.append((ours & theirs).sum() / (ours | theirs).sum())
    return float(np.mean(ious))
