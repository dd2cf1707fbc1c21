"""Properties of OBJ materials that the loader does not read: texture options and opacity."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_OPTION = re.compile(
    rf"-(?:([ost])((?:\s+{_NUMBER}(?=\s)){{1,3}})|mm\s+\S+\s+\S+"
    r"|(?:blendu|blendv|bm|boost|cc|clamp|imfchan|texres|type)\s+\S+)\s+",
    re.IGNORECASE,
)


class Look(NamedTuple):
    """A material of a library."""

    texture: str = ""  # its file
    scale: tuple[float, float] = (1.0, 1.0)  # of texture coordinates
    offset: tuple[float, float] = (0.0, 0.0)  # added to them, then
    opacity: float = 1.0


def texture(text: str) -> Look:
    """Parse the text after `map_Kd`: options, then the file name, which may contain spaces."""
    pairs = {"s": [1.0, 1.0], "o": [0.0, 0.0], "t": [0.0, 0.0]}
    text = text.strip()
    while option := _OPTION.match(text):
        if option[1]:
            values = [float(value) for value in option[2].split()[:2]]
            pairs[option[1].lower()][: len(values)] = values
        text = text[option.end() :]
    return Look(text, (pairs["s"][0], pairs["s"][1]), (pairs["o"][0], pairs["o"][1]))


def looks(lines: Iterable[str]) -> dict[str, Look]:
    """Parse the materials of a library by name; `d` takes precedence over `Tr`, its opposite.

    Raises:
        ValueError: an opacity is not a number.
    """
    texts: dict[str, dict[str, str]] = {}  # by material and key
    name = ""
    for line in lines:
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        if key.lower() == "newmtl":
            name = " ".join(rest.split())
        texts.setdefault(name, {})[key.lower()] = rest
    materials = {}
    for name, fields in texts.items():
        opacity = 1 - float(fields.get("tr") or 0)
        if fields.get("d"):
            opacity = float(fields["d"].split()[-1])  # perhaps after `-halo`
        materials[name] = texture(fields.get("map_kd", ""))._replace(opacity=opacity)
    return materials
