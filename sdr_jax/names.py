"""The names of the search methods for command lines, without loading a method."""

from typing import Literal

MethodName = Literal[
    "surrogate",
    "sdr",
    "random_attributes",
    "random_search",
    "attribute_descent",
    "gaussian",
    "intervals",
]
"""Every search method, by the name of its function."""
