"""The names of the search methods, for command lines: no method is loaded with them."""

from typing import Literal

MethodName = Literal[
    "surrogate",
    "sdr",
    "pool",
    "random_attributes",
    "random_search",
    "attribute_descent",
    "gaussian",
    "intervals",
    "cma_es",
    "tpe",
    "gaussian_process",
]
"""Every search method, by the name of its function."""
