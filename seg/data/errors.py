"""The error of everything that can be wrong with a data set on disk."""


class DataError(Exception):
    """A data set cannot be read; the message names the file or folder and what would be right."""
