"""How unsure a net is of an image: what orders images that are to be labelled next."""

import numpy as np
from jaxtyping import Float32


def mean_margin(scores: Float32[np.ndarray, "rows cols classes"]) -> float:
    """How close the two likeliest classes of a pixel are, in the mean over the image's pixels.

        u = mean_x (1 - (p1[x] - p2[x]))

    with p the softmax of the scores, p1 its highest and p2 its second highest: 0 where the net is sure of all
    pixels, 1 where it knows nothing. `benchmarks.next_labels` compares it with other measures.

    Args:
        scores: logits of an image, of 1 class or more.

    Source: margin sampling, Scheffer et al. (2001), "Active Hidden Markov Models for Information Extraction";
    Settles (2009), "Active Learning Literature Survey", section 3.1.
    """
    p = np.exp(scores - scores.max(axis=-1, keepdims=True))
    p /= p.sum(axis=-1, keepdims=True)
    if p.shape[-1] == 1:
        return 0.0
    highest = np.partition(p, -2, axis=-1)
    return float(np.mean(1 - (highest[..., -1] - highest[..., -2]), dtype=np.float64))
