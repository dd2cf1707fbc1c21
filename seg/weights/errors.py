"""The error of everything that can be wrong with a file of weights."""

from seg.data.errors import DataError


class WeightsError(DataError):
    """Weights cannot be used; the message names the file and the layer, and what would be right."""
