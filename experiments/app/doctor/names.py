"""Names of ids and colours in files that come with labels: lists, tables and JSON."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from common.files import composed, read_json

Names = dict[str, str]
"""Names by id, written as 3, or by colour, written as [128, 64, 128]."""
LISTS = ("classes", "labels", "names")
"""Files whose lines, and fields whose entries, are names alone, for the ids 0, 1, 2 and so on."""
FIELDS = ("id2label", "label2id", "categories", *LISTS)
"""Fields of JSON with names: of Hugging Face, of COCO, and of Mapillary, Supervisely and others."""
NAME_FIELDS = ("readable", "title", "name", "label")
COLOUR_FIELDS = ("color", "colour", "rgb")
"""Fields of an entry."""
MOST_FILES = 20
"""The most files of a folder; more are labels themselves."""
LARGEST = 2**20
"""The size in bytes of the largest file that is read."""
NAME = r"\s*(?=.*[^\W\d_])[\w(](?:[\w /()&'+-]|\.(?=\w))*\s*"
_FIRST, _LAST = r"\d+(?:[^\w(-]|-\s)+", r"(?:[\s,;:=|\[(]|\s-)+\d+"
"""A number before a name, and one after it, each with the separators between."""


def names_beside(root: Path, label: Path, lists: Collection[str]) -> Names:
    """Read the names of ids or colours from files in the folder of a label and in those above it.

    Args:
        root: the folder of the data.
        label: one of its label files.
        lists: files below the root that list images, which are left out.
    """
    names: Names = {}
    found: set[Path] = set()
    for folder in (label.parent, *label.parent.parents):
        files = [path for path in folder.glob("*") if path.suffix in (".txt", ".csv", ".json")]
        if len(files) <= MOST_FILES:
            found.update(files)
        if folder == root:
            break
    for path in sorted(found):
        if path.relative_to(root).as_posix() in lists or path.stat().st_size > LARGEST:
            continue
        try:
            is_json = path.suffix == ".json"
            names |= _of_json(read_json(path)) if is_json else _of_text(path, alone=not names)
        except (OSError, ValueError):  # unreadable, not UTF-8, not JSON, or numbers too long
            continue
    return names


def _of_text(path: Path, alone: bool) -> Names:
    """Names of the values in the lines of a file; of names alone, if they count, their number is the id."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()[:300]
    names = {value: name for line in lines for value, name in named_values(line)}
    filled = [line for line in lines if line.strip()]
    is_list = alone and path.stem in LISTS
    if not names and is_list and all(re.fullmatch(NAME, line) for line in filled):
        return {str(number): name.strip() for number, name in enumerate(filled)}
    return names


def named_values(line: str) -> Iterator[tuple[str, str]]:
    """Yield the id and the colour that a line names, whichever it has, each with the name."""
    line = re.sub(r"(?<=\d)[\s,;:)\]]+$", "", composed(line).strip(" \t,;"))
    parts = re.fullmatch(rf"[\s\[(]*((?:{_FIRST})*)(.*?)((?:{_LAST})*)", line)
    assert parts is not None
    name = parts[2]
    before, after = (re.findall(r"\d+", numbers) for numbers in (parts[1], parts[3]))
    values: list[list[str]]
    if len(before) <= 1 and len(after) >= 3:
        values, count = [before, after[-3:]], len(after) - 3
    elif not before and after:
        values, count = [after[-1:]], len(after) - 1
    elif len(before) in (1, 3, 4):
        values, count = [before[:-3], before[-3:]], len(after)
    else:
        return
    # The other numbers are of the name, as in "zone 30".
    name += "".join(re.findall(_LAST, parts[3])[:count])
    name = name.strip(" \t,;:=|\"'")
    if re.fullmatch(NAME, name):
        for value in filter(None, values):
            numbers = [*map(int, value)]
            yield str(numbers if len(numbers) == 3 else numbers[0]), name


def _of_json(content: Any) -> Names:
    """Names of values in a list of classes, or in a table, that may be a field of an object."""
    if isinstance(content, list):
        return {value: name for k, entry in enumerate(content) for value, name in _entry(k, entry)}
    if not isinstance(content, dict):
        return {}
    for field in FIELDS:
        if field in content and (names := _of_json(content[field])):
            return names
    names = {}
    for key, value in content.items():
        if key.isdecimal() and isinstance(value, str):
            names[str(int(key))] = value
        elif colour := _colour(value):
            names[colour] = key
        elif type(value) is int:
            names[str(value)] = key
        else:
            return {}
    # Other numbers, such as a size and a version, are no ids.
    ids = sorted(value for value in content.values() if type(value) is int)
    counts = ids in ([*range(len(ids))], [*range(1, len(ids) + 1)]) and len(ids) > 2
    return names if counts or not ids else {}


def _entry(number: int, entry: Any) -> Iterator[tuple[str, str]]:
    """Yield the id (by default its number) and the colour of an entry of a list, each with its name."""
    if isinstance(entry, str):
        yield str(number), entry
    elif isinstance(entry, Mapping):
        name = next((entry[f] for f in NAME_FIELDS if isinstance(entry.get(f), str)), None)
        if name is not None:
            yield str(entry.get("id", number)), name
            yield from ((c, name) for f in COLOUR_FIELDS if (c := _colour(entry.get(f))))


def _colour(value: Any) -> str:
    """A colour, given as three bytes or as #804080, in the form of `Names`; empty for anything else."""
    if isinstance(value, str) and re.fullmatch("#[0-9a-fA-F]{6}", value):
        return str([*bytes.fromhex(value[1:])])
    is_colour = isinstance(value, list) and len(value) == 3 and all(type(v) is int for v in value)
    return str(value) if is_colour else ""
