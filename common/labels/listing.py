"""Lists the images and labels of a target's file without reading pixels."""

from __future__ import annotations

import glob
import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn, cast

from common.errors import UserError
from common.files import IMAGES, composed, leads_out, plain_path, spelled
from common.labels.coco import read_coco_file
from common.labels.target_file import TRAIN, Files, TargetFile

HELD_OUT = ("test", "testing", "val", "valid", "validation")
"""Names of a split for figures in any data, in the order of choice."""
MOST_LINES = 1000
"""So many lines are searched for an image's name to tell a list from other text."""


class Entry(NamedTuple):
    """One labelled image on disk."""

    name: str  # unique within a split
    sequence: str  # its group, such as a drive, whose consecutive frames are nearly the same
    image_path: Path
    label_path: Path


def list_split(target: TargetFile, root: str | Path, split: str) -> tuple[Entry, ...]:
    """List the labelled images of one split.

    Args:
        target: describes the files.
        root: the data's folder.
        split: a split of the target's file or of the folder.

    Returns:
        Entries by group and name.

    Raises:
        UserError: the folder, the split, a list, an image or a label is missing, a name is twice in a list
            or leads out of the folder, or there are no images.
    """
    root = Path(root)
    if not root.is_dir():
        raise UserError(f"{root}: no such folder; expected {target.name}, with {_shown(target)}")
    if "/" in plain_path(split) or split in (".", ".."):
        names = split_names(target, root)
        if split not in names:
            _refuse_split(root, split, names, "expected a name, not a path")
    entries = _entries(target, root, split)
    for path in (path for entry in entries for path in (entry.image_path, entry.label_path)):
        if leads_out(root, str(path.absolute())):
            raise UserError(f"{path} leads out of {root}; expected a file below that folder")
    if not entries:
        raise UserError(f"{root}: zero images in split {split!r}; expected {_shown(target, split)}")
    repeated = [name for name, count in Counter(e.name for e in entries).items() if count > 1]
    if repeated:
        paths = " and ".join(str(e.image_path) for e in entries if e.name == repeated[0])
        raise UserError(f"{paths} have one name, {repeated[0]}; names must differ within a split")
    return tuple(sorted(entries, key=lambda entry: (entry.sequence, entry.name)))


def list_all(target: TargetFile, root: str | Path) -> dict[str, tuple[Entry, ...]]:
    """List the labelled images of every split; see `list_split`."""
    root = Path(root)
    return {
        split: list_split(target, root, split) for split in split_names(target, root) or (TRAIN,)
    }


def split_names(target: TargetFile, root: Path) -> tuple[str, ...]:
    """The splits of the target's file, or otherwise of the folder, `TRAIN` first."""
    if isinstance(target.images, dict):
        return tuple(target.images)
    if isinstance(target.splits, dict) and target.splits:
        made = not isinstance(next(iter(target.splits.values())), str)
        return tuple(dict.fromkeys([TRAIN] * made + [*target.splits]))
    found: set[str] = set()
    if isinstance(target.splits, str):
        found |= {
            split
            for split in _splits_at(target.splits, root)
            if split.lower() in (TRAIN, "training", *HELD_OUT) or _lists_images(target, root, split)
        }
    if "{split}" in target.images:
        own = _splits_at(target.images, root)
        labels = cast(str, target.labels)
        found |= own & _splits_at(labels, root) if "{split}" in labels else own
    elif not target.splits:
        found = {TRAIN}
    return tuple(sorted(found, key=lambda split: (split != TRAIN, split)))


def _lists_images(target: TargetFile, root: Path, split: str) -> bool:
    """Whether a line of a text file names an image: a README beside the lists is no split."""
    assert isinstance(target.splits, str)
    assert isinstance(target.images, str)
    listing = root / target.splits.replace("{split}", split)
    try:
        lines = _lines(listing)[:MOST_LINES]
    except UserError:
        return False
    by_name = _by_name(root, split, target.images)
    for number, line in lines:
        where = f"{listing}, line {number}"
        try:
            image = _at_name(root, split, target.images, line, by_name, where)
            pairs = () if image else _split_pairs(line)
            if image or any(len(p) == 2 and _tail(root, p[0], where).is_file() for p in pairs):
                return True
        except (UserError, OSError):  # such as a line that is too long for a name
            continue
    return False


def shared_groups(splits: Mapping[str, Sequence[Entry]]) -> str:
    """A warning about groups with images in two splits; empty if there are none."""
    of: dict[str, list[str]] = {}
    for split, entries in splits.items():
        for group in {entry.sequence for entry in entries}:
            of.setdefault(group, []).append(split)
    shared = sorted(group for group, own in of.items() if len(own) > 1)
    if not shared:
        return ""
    both = " and ".join(dict.fromkeys(split for group in shared for split in of[group]))
    shown = ", ".join(shared[:3]) + (", ..." if len(shared) > 3 else "")
    return (
        f"the published lists share {len(shared)} of {len(of)} groups ({shown}) between {both}: their "
        "images are alike, so figures on one say less about streets that no list has"
    )


def _entries(target: TargetFile, root: Path, split: str) -> list[Entry]:
    """The entries of one split, in any order."""
    names = split_names(target, root)
    images, labels = target.images, target.labels
    if isinstance(images, dict):
        if split not in images:
            _refuse_split(root, split, names, f"in {target.source}")
        return list(
            _given(target, root, split, images[split], cast(dict[str, Files], labels)[split])
        )
    assert isinstance(labels, str)
    if isinstance(target.splits, str):
        listing = root / target.splits.replace("{split}", split)
        if listing.is_file():
            return list(_listed(target, root, split, listing, images, labels))
        if "{split}" not in images:
            _refuse_split(root, split, names, f"expected {listing.name}")
    elif target.splits:
        if split not in names:
            _refuse_split(root, split, names, f"in {target.source}")
        own = target.splits.get(split)
        if isinstance(own, str):
            return list(_listed(target, root, split, root / own, images, labels))
        return _made(target, root, _found(target, root, TRAIN, images, labels))[split]
    if "{split}" in images:
        first = root / images.replace("{split}", split).partition("{")[0]
        if not first.parent.is_dir() or split not in names:
            _refuse_split(root, split, names, f"expected {_shown(target, split)}")
    elif split != TRAIN:
        _refuse_split(root, split, names, f"{target.source} names none")
    return list(_found(target, root, split, images, labels))


def _refuse_split(root: Path, split: str, there: Sequence[str], why: str) -> NoReturn:
    raise UserError(
        f"{root}: no split {split!r}; {why}. Splits there: {', '.join(there) or 'none'}"
    )


def _shown(target: TargetFile, split: str = "{split}") -> str:
    """The places where images and labels should be, for errors."""
    shown = []
    for own in (target.images, target.labels):
        pattern = own.get(split, "a list") if isinstance(own, dict) else own
        shown.append(str(pattern).replace("{split}", split))
    lists = target.splits
    listing = f"{lists.replace('{split}', split)} or " if isinstance(lists, str) else ""
    return f"{listing}{' and '.join(shown)}"


# ---- patterns

_ENDINGS = "|".join(re.escape(suffix) for suffix in IMAGES)


def _regex(pattern: str) -> str:
    """A regular expression for the paths of a pattern."""
    found, seen = "", set()
    for part in re.split(r"(\{\w+\})", pattern):
        place = part.strip("{}")
        if not part.startswith("{"):
            found += re.escape(part)
        elif place in seen:
            found += f"(?P={place})"
        else:
            seen.add(place)
            found += f"(?P<{place}>(?!\\.\\.?/)[^/]+)"
    return found


def _expression(pattern: str) -> re.Pattern[str]:
    """A regular expression for whole paths; a pattern without a suffix has those of images."""
    return re.compile(_regex(pattern) + ("" if _has_suffix(pattern) else rf"(?i:{_ENDINGS})"))


def _glob(pattern: str) -> str:
    parts = re.split(r"(\{\w+\})", pattern)
    return "".join("*" if part.startswith("{") else glob.escape(part) for part in parts)


def _has_suffix(pattern: str) -> bool:
    return "." in pattern.rpartition("/")[2].rpartition("}")[2]


def matches(pattern: str, root: Path) -> Iterator[tuple[Path, dict[str, str]]]:
    """The files of a pattern with the text at its places; a pattern without a suffix has those of images."""
    exact, expression = _has_suffix(pattern), _expression(composed(pattern))
    for path in _globbed(root, pattern, "" if exact else ".*"):
        found = expression.fullmatch(composed(path.relative_to(root).as_posix()))
        if path.name[0] == "." or not found or not path.is_file():
            continue
        if exact or path.suffix.lower() in IMAGES:
            yield path, found.groupdict()


def _globbed(root: Path, pattern: str, ending: str) -> Iterator[Path]:
    """The paths of a pattern, whose accents may be composed or separate on disk."""
    for form in ("NFC", "NFD"):
        paths = list(root.glob(_glob(unicodedata.normalize(form, pattern)) + ending))
        if paths or pattern.isascii():
            return iter(paths)
    return iter(())


def _splits_at(pattern: str, root: Path) -> set[str]:
    """The values of {split} in the files or folders of a pattern."""
    parts = pattern.split("/")
    last = next(k for k, part in enumerate(parts) if "{split}" in part)
    head = composed("/".join(parts[: last + 1]))
    suffix = "" if last < len(parts) - 1 or _has_suffix(head) else r"\.\w+"
    expression = re.compile(_regex(head) + suffix)
    matches = (
        (path, expression.fullmatch(composed(path.relative_to(root).as_posix())))
        for path in _globbed(root, head, "*" * bool(suffix))
    )
    return {m["split"] for path, m in matches if m and path.is_dir() == (last < len(parts) - 1)}


def _on_disk(path: Path, any_suffix: bool) -> Path | None:
    """The path, if need be with the suffix that the image has on this disk."""
    endings = [own for s in IMAGES for own in (s, s.upper())] if any_suffix else [""]
    paths = [path.with_name(path.name + own) for own in endings]
    return next(filter(None, map(spelled, paths)), None)


def _filled(pattern: str, split: str, places: Mapping[str, str]) -> str:
    for place, value in {"split": split, **places}.items():
        pattern = pattern.replace(f"{{{place}}}", value)
    return pattern


# ---- entries


def _entry(
    target: TargetFile, split: str, image: Path, root: Path, labels: str, places: Mapping[str, str]
) -> Entry:
    """An image with its label by the pattern. Raises UserError if it has none."""
    found = _labelled(target, split, image, root, labels, places)
    if found is None:
        raise UserError(_without_label(split, image, root, labels, places))
    return found


def _without_label(
    split: str, image: Path, root: Path, labels: str, places: Mapping[str, str]
) -> str:
    label = root / _filled(labels, split, places)
    expected = label if _has_suffix(labels) else f"{label}.png"
    if "{name}" not in labels and label.is_file():
        expected = f"its name among the images in {label}"
    return f"{image}: image without label; expected {expected}"


def _labelled(
    target: TargetFile, split: str, image: Path, root: Path, labels: str, places: Mapping[str, str]
) -> Entry | None:
    """An image with its label by the pattern, if it has one."""
    label = _on_disk(root / _filled(labels, split, places), not _has_suffix(labels))
    if label is None:
        return None
    if target.format == "coco-json" and read_coco_file(label).image_of(image) is None:
        return None
    return _named(target, image, label, places["name"], places.get("group"))


def _named(
    target: TargetFile, image: Path, label: Path, name: str, folder: str | None = None
) -> Entry:
    """An entry with its group; if groups are folders, they are part of the name."""
    group = folder or name
    if target.group is not None:
        found = re.search(target.group, name)
        group = ((found[1] if found.re.groups else found[0]) if found else None) or name
    if folder is not None and not name.startswith(f"{folder}_"):
        name = f"{folder}_{name}"
    return Entry(name, group, image, label)


def _found(target: TargetFile, root: Path, split: str, images: str, labels: str) -> Iterator[Entry]:
    """The entries at the patterns."""
    for image, places in matches(images.replace("{split}", split), root):
        if entry := _labelled(target, split, image, root, labels, places):
            yield entry
        elif target.unlabelled == "refuse":
            hint = f"; 'unlabelled: skip' in {target.source} leaves such images out"
            raise UserError(_without_label(split, image, root, labels, places) + hint)


def _given(
    target: TargetFile, root: Path, split: str, images: Files, labels: Files
) -> Iterator[Entry]:
    """The entries of a split in the tables of images and labels."""
    if isinstance(images, str) and isinstance(labels, str):
        yield from _found(target, root, split, images, labels)
    elif not isinstance(images, str) and not isinstance(labels, str):
        for k, pair in enumerate(zip(images, labels, strict=True)):
            where = f"{target.source}, images.{split}[{k}]"
            yield _pair(target, root, where, pair)
    else:
        raise UserError(f"{target.source}: images and labels of {split} must both be lists")


def _listed(
    target: TargetFile, root: Path, split: str, listing: Path, images: str, labels: str
) -> Iterator[Entry]:
    """The entries of a list, whose lines are a name, a path, or an image and its label."""
    by_name = _by_name(root, split, images)
    names: set[str] = set()
    for number, line in _lines(listing):
        where = f"{listing}, line {number}"
        own = _at_name(root, split, images, line, by_name, where)
        pair = next((words for words in _split_pairs(line) if len(words) == 2), ())
        if own is not None:
            entry = _entry(target, split, own[0], root, labels, own[1])
        elif pair:
            entry = _pair(target, root, where, pair)
        elif leads_out(root, _filled(images, split, {"name": line})):
            raise UserError(f"{where}: {line} leads out of {root}")
        else:
            expected = root / _filled(images, split, {"name": line})
            raise UserError(
                f"{where}: no image {expected}; expected a name, a path, or an image and its label"
            )
        if entry.name in names:
            raise UserError(f"{where}: {entry.name} is listed twice; once is right")
        names.add(entry.name)
        yield entry


def _lines(listing: Path) -> list[tuple[int, str]]:
    """The lines of a list with their numbers, without empty ones."""
    try:
        lines = listing.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{listing}: not a readable text file ({error})") from error
    return [(number, line) for number, text in enumerate(lines, 1) if (line := plain_path(text))]


def _by_name(
    root: Path, split: str, images: str
) -> dict[str, list[tuple[Path, dict[str, str]]]] | None:
    """The images by name where their groups are folders, which lists may leave out."""
    if "{group}" not in images:
        return None
    found: dict[str, list[tuple[Path, dict[str, str]]]] = {}
    for path, places in matches(images.replace("{split}", split), root):
        found.setdefault(places["name"], []).append((path, places))
    return found


def _split_pairs(line: str) -> Iterator[list[str]]:
    """A line cut into an image and its label: at a separator, or at its spaces."""
    for separator in (r"\s*[,;\t]\s*", r"\s+"):
        yield [plain_path(word) for word in re.split(separator, line)]


def _at_name(
    root: Path,
    split: str,
    images: str,
    line: str,
    by_name: Mapping[str, list[tuple[Path, dict[str, str]]]] | None,
    where: str,
) -> tuple[Path, dict[str, str]] | None:
    """The image of a name, or of its path below the folder."""
    images = images.replace("{split}", split)
    if by_name is not None:
        named = by_name.get(line, ())
        if len(named) > 1:
            raise UserError(
                f"{where}: {named[0][0]} and {named[1][0]} have this name; write the path"
            )
        if named:
            return named[0]
    else:
        path = _filled(images, split, {"name": line})
        image = _on_disk(root / path, not _has_suffix(images))
        if image is not None and not leads_out(root, path):
            return image, {"name": line}
    # A path below the folder, or a name with the suffix that the pattern leaves out.
    folder = images.rpartition("/")[0]
    for path in (line, f"{folder}/{line}"):
        found = _expression(images).fullmatch(path)
        image = spelled(root / path) if found else None
        if found and image is not None:
            return image, found.groupdict()
    return None


def _pair(target: TargetFile, root: Path, where: str, pair: Sequence[str]) -> Entry:
    """An image and its label by their paths."""
    image, label = (_tail(root, path, where) for path in pair)
    if not image.is_file():
        raise UserError(f"{where}: no image {image}, neither as {' nor as '.join(IMAGES)}")
    if not label.is_file():
        raise UserError(f"{image}: image without label; expected {label}")
    return _named(target, image, label, composed(image.stem))


def _tail(root: Path, path: str, where: str) -> Path:
    """A listed path below the folder.

    Published lists have paths of other machines (/SegNet/CamVid/train/...) and suffixes that copies lack, so
    the longest tail of the path that exists is taken.
    """
    path = plain_path(path)
    parts = [part for part in path.split("/") if part]
    tails = ["/".join(parts[k:]) for k in range(len(parts))] if path.startswith("/") else [path]
    for tail in tails:
        if leads_out(root, tail):
            raise UserError(f"{where}: {tail} leads out of {root}")
        whole = root / tail
        for own in (whole, *(whole.with_suffix(suffix) for suffix in IMAGES)):
            if (file := spelled(own)) is not None:
                return file
    return root.joinpath(*tails[:1])


# ---- splits by groups or shares


def _made(target: TargetFile, root: Path, found: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Make splits by groups or shares; no group is in two of them."""
    of: dict[str, list[Entry]] = {}
    for entry in found:
        of.setdefault(entry.sequence, []).append(entry)
    splits = cast(Mapping[str, float | tuple[str, ...]], target.splits)
    total = sum(map(len, of.values()))
    made: dict[str, list[Entry]] = {}
    for split, own in splits.items():
        groups = _share(of, own * total) if isinstance(own, float) else own
        missing = [group for group in groups if group not in of]
        if missing:
            there = ", ".join(sorted(of)[:8]) + (", ..." if len(of) > 8 else "")
            raise UserError(
                f"{target.source}: splits.{split}: no group {missing[0]!r}; {root} has {there or 'none'}"
            )
        made[split] = [entry for group in groups for entry in of[group]]
        if isinstance(own, float):
            of = {group: entries for group, entries in of.items() if group not in groups}
    taken = {entry.sequence for entries in made.values() for entry in entries}
    made.setdefault(TRAIN, [e for group, own in of.items() if group not in taken for e in own])
    if not made[TRAIN]:
        raise UserError(
            f"{target.source}: splits: nothing is left for {TRAIN}; there are {len(taken)} groups, which are "
            "never split, and every split needs one"
        )
    return made


def _share(of: Mapping[str, Sequence[Entry]], wanted: float) -> list[str]:
    """Choose groups, one or more, with about so many images, in the order of their names' digests."""
    taken: list[str] = []
    count = 0
    for group in sorted(of, key=lambda name: hashlib.sha256(name.encode()).hexdigest()):
        size = len(of[group])
        if not taken or abs(count + size - wanted) < abs(count - wanted):
            taken.append(group)
            count += size
    return taken
