"""The random streams of a street by name; no two names of one table share a stream.

``numpy.random.SeedSequence`` pads short keys with zeros: ``[s]``, ``[s, 0]`` and ``[s, 0, 0]`` are the same
key. So all keys of a street have the same length: seed, number of the stream, part.
"""

from __future__ import annotations

import numpy as np

STREAMS = {
    "street": 0,  # sky, ground, camera path
    "line": 1,  # a line of objects on one side
    "background": 7,
    "cloud": 9,  # whether it covers the sky
    "course": 20,  # of the road
    "junction": 21,
    "corners": 22,  # objects at the junction
    "open": 30,  # which sides have no houses
    "parked": 31,
    "traffic": 32,
    "people": 33,
    "land": 34,  # along the road
    "furniture": 35,
    "own class": 36,
    "verge": 37,  # what lies along the sidewalks
    "noise": 40,  # of one shot's image
    "camera": 2**16,  # how it responds
}
"""Number of each stream; a new one needs a new number."""
TABLES = {"grain": 7, "textures": 19, "clouds": 41, "leaves": 43}
"""Number of each stream that is drawn once for all streets."""


def stream(seed: int, name: str, part: int = 0) -> np.random.Generator:
    """The stream of one name.

    Args:
        seed: seed of the street.
        name: a name of ``STREAMS``.
        part: which of the streams with this name: a side of the road, an ingredient, a shot.
    """
    return np.random.default_rng([seed, STREAMS[name], part])


def seeded(seed: int) -> np.random.Generator:
    """The stream of a seed of 31 or 32 bits that another stream drew."""
    return np.random.default_rng(seed)


def child(rng: np.random.Generator) -> np.random.Generator:
    """A separate stream for one part, so that its draws do not affect others; draws once from ``rng``."""
    return seeded(int(rng.integers(2**32)))


def units(seed: int, street: int) -> np.random.Generator:
    """The stream of the attributes of one street; ``seed`` is the dataset's, not the street's."""
    return np.random.default_rng([seed, street, 1])


def table_row(table: str, place: int = 0) -> np.random.Generator:
    """The stream of one row of a table (of ``TABLES``), the same in all streets."""
    return np.random.default_rng([TABLES[table], place])
