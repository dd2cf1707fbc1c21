"""Errors of the files that a user names."""

from common.errors import UserError


class DataError(UserError):
    """A data set cannot be read; the message names the file or folder and what would be right."""


class WeightsError(UserError):
    """Weights cannot be used; the message names the file and the layer, and what would be right."""


class ModelError(UserError):
    """A saved model cannot be used; the message names the file and the field, and what would be right."""
