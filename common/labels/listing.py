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

from common.errors import UserError, suggestion
from common.files import IMAGES, check_folder, composed, leads_out, plain_path, spelled
from common.labels.coco import read_coco_file
from common.labels.target_file import TRAIN, Files, TargetFile

HELD_OUT = ("test", "testing", "val", "valid", "validation")
"""Names of a split to evaluate on, in order of preference."""
MOST_LINES = 1000
"""Number of lines searched for the name of an image, to tell a list from other text."""


class Entry(NamedTuple):
    """One labelled image on disk."""

    name: str  # unique within a split
    sequence: str  # its group, such as a sequence, whose consecutive frames are nearly identical
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
        UserError: the folder, the split, a list, an image or a label is missing, a name is repeated or
            outside the folder, or there are no images.
    """
    root = Path(root)
    check_folder(root, f"{target.name}, with {_places(target)}")
    if "/" in plain_path(split) or split in (".", ".."):
        names = split_names(target, root)
        if split not in names:
            _refuse_split(root, split, names, "expected a name, not a path")
    entries = _entries(target, root, split)
    for path in (path for entry in entries for path in (entry.image_path, entry.label_path)):
        if leads_out(root, str(path.absolute())):
            raise UserError(f"{path} is outside {root}; expected a file in that folder")
    if not entries:
        raise UserError(f"{root}: no images in split {split!r}; expected {_places(target, split)}")
    repeated = [name for name, count in Counter(e.name for e in entries).items() if count > 1]
    if repeated:
        paths = " and ".join(str(e.image_path) for e in entries if e.name == repeated[0])
        raise UserError(
            f"{paths} have the same name, {repeated[0]}; names must be unique within a split"
        )
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
        has_lists = isinstance(next(iter(target.splits.values())), str)
        return tuple(target.splits) if has_lists else tuple(dict.fromkeys([TRAIN, *target.splits]))
    splits: set[str] = set()
    if isinstance(target.splits, str):
        splits |= {
            split
            for split in _splits_at(target.splits, root)
            if split.lower() in (TRAIN, "training", *HELD_OUT) or _lists_images(target, root, split)
        }
    if "{split}" in target.images:
        image_splits = _splits_at(target.images, root)
        labels = cast(str, target.labels)
        splits |= image_splits & _splits_at(labels, root) if "{split}" in labels else image_splits
    elif not target.splits:
        splits = {TRAIN}
    return tuple(sorted(splits, key=lambda split: (split != TRAIN, split)))


def _lists_images(target: TargetFile, root: Path, split: str) -> bool:
    """Whether a line of a text file names an image: a README next to the lists is no split."""
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
    splits_of: dict[str, list[str]] = {}
    for split, entries in splits.items():
        for group in {entry.sequence for entry in entries}:
            splits_of.setdefault(group, []).append(split)
    shared = sorted(group for group, names in splits_of.items() if len(names) > 1)
    if not shared:
        return ""
    both = " and ".join(dict.fromkeys(split for group in shared for split in splits_of[group]))
    shown = ", ".join(shared[:3]) + (", ..." if len(shared) > 3 else "")
    return (
        f"the published lists share {len(shared)} of {len(splits_of)} groups ({shown}) between {both}: "
        "their images are similar, so scores on one say less about new streets"
    )


def _entries(target: TargetFile, root: Path, split: str) -> list[Entry]:
    """The entries of one split, in any order."""
    names = split_names(target, root)
    images, labels = target.images, target.labels
    if isinstance(images, dict):
        if split not in images:
            _refuse_split(root, split, names, f"in {target.source}")
        return list(
            _tabled(target, root, split, images[split], cast(dict[str, Files], labels)[split])
        )
    assert isinstance(labels, str)
    if isinstance(target.splits, str):
        listing = root / target.splits.replace("{split}", split)
        if listing.is_file():
            return _listed(target, root, split, listing, images, labels)
        if "{split}" not in images:
            _refuse_split(root, split, names, f"expected {listing.name}")
    elif target.splits:
        if split not in names:
            _refuse_split(root, split, names, f"in {target.source}")
        listing_path = target.splits.get(split)
        if isinstance(listing_path, str):
            return _listed(target, root, split, root / listing_path, images, labels)
        return _split_up(target, root, _matched(target, root, TRAIN, images, labels))[split]
    if "{split}" in images:
        first = root / images.replace("{split}", split).partition("{")[0]
        if not first.parent.is_dir() or split not in names:
            _refuse_split(root, split, names, f"expected {_places(target, split)}")
    elif split != TRAIN:
        _refuse_split(root, split, names, f"{target.source} defines none")
    return list(_matched(target, root, split, images, labels))


def _refuse_split(root: Path, split: str, names: Sequence[str], why: str) -> NoReturn:
    if not root.is_dir():
        raise UserError(f"{root} does not exist, or is no folder")
    raise UserError(
        f"{root}: no split {split!r}"
        + (suggestion(split, names) or f"; {why}. Its splits: {', '.join(names) or 'none'}")
    )


def _places(target: TargetFile, split: str = "{split}") -> str:
    """The places where images and labels should be, for errors."""
    places = []
    for files in (target.images, target.labels):
        pattern = files.get(split, "a list") if isinstance(files, dict) else files
        places.append(str(pattern).replace("{split}", split))
    lists = target.splits
    listing = f"{lists.replace('{split}', split)} or " if isinstance(lists, str) else ""
    return f"{listing}{' and '.join(places)}"


# ---- patterns

_ENDINGS = "|".join(re.escape(suffix) for suffix in IMAGES)
_SPELLINGS = tuple(case for s in IMAGES for case in (s, s.upper(), s.title()))
"""Endings of image files as they are on disk; of other spellings only patterns find files."""


def _regex(pattern: str) -> str:
    """A regular expression for the paths of a pattern."""
    expression = ""
    earlier: set[str] = set()
    for part in re.split(r"(\{\w+\})", pattern):
        place = part.strip("{}")
        if not part.startswith("{"):
            expression += re.escape(part)
        elif place in earlier:
            expression += f"(?P={place})"
        else:
            earlier.add(place)
            expression += f"(?P<{place}>(?!\\.\\.?/)[^/]+)"
    return expression


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
        match = expression.fullmatch(composed(path.relative_to(root).as_posix()))
        if path.name[0] == "." or not match or not path.is_file():
            continue
        if exact or path.suffix.lower() in IMAGES:
            yield path, match.groupdict()


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
    """The path, with the suffix that the image has on disk if any will do; None if there is no file."""
    paths = [path.with_name(path.name + suffix) for suffix in (_SPELLINGS if any_suffix else [""])]
    return next(filter(None, map(spelled, paths)), None)


def _has_folders(pattern: str) -> bool:
    return "{group}" in pattern or "{folder}" in pattern


def _filled(pattern: str, split: str, places: Mapping[str, str]) -> str:
    for place, value in {"split": split, **places}.items():
        pattern = pattern.replace(f"{{{place}}}", value)
    return pattern


# ---- entries


def _labelled(
    target: TargetFile, split: str, image: Path, root: Path, labels: str, places: Mapping[str, str]
) -> Entry | None:
    """An image with its label by the pattern; None if it has none and is left out."""
    path = root / _filled(labels, split, places)
    label = _on_disk(path, not _has_suffix(labels))
    if label is None:
        _check_left_out(target, image, path if _has_suffix(labels) else f"{path}.png")
        return None
    if target.format == "coco-json" and read_coco_file(label).image_of(image) is None:
        _check_left_out(target, image, f"its name among the images in {label}")
        return None
    return _named(target, image, label, places)


def _check_left_out(target: TargetFile, image: Path, expected: Path | str) -> None:
    """Raise UserError for an image without a label, unless the target's file leaves such images out."""
    if target.unlabelled == "refuse":
        raise UserError(
            f"{image}: image without label; expected {expected}; 'unlabelled: skip' in {target.source} "
            "leaves such images out"
        )


def _named(target: TargetFile, image: Path, label: Path, places: Mapping[str, str]) -> Entry:
    """An entry with its group; folders at the places of a pattern are part of the name."""
    name = places["name"]
    folders = [places[place] for place in ("group", "folder") if place in places]
    group = next(iter(folders), name)
    if target.group is not None:
        match = re.search(target.group, name)
        group = ((match[1] if match.re.groups else match[0]) if match else None) or name
    for folder in folders:
        if not name.startswith(f"{folder}_"):
            name = f"{folder}_{name}"
    return Entry(name, group, image, label)


def image_matches(images: str, labels: str, root: Path) -> Iterator[tuple[Path, dict[str, str]]]:
    """The images of a pattern with the text at its places, without files that are labels of such images."""
    is_label = _expression(composed(labels))
    for path, places in matches(images, root):
        label = is_label.fullmatch(composed(path.relative_to(root).as_posix()))
        image = root / _filled(images, "", label.groupdict()) if label else path
        if image == path or _on_disk(image, not _has_suffix(images)) is None:
            yield path, places


def _matched(
    target: TargetFile, root: Path, split: str, images: str, labels: str
) -> Iterator[Entry]:
    """The entries at the patterns."""
    images, labels = (pattern.replace("{split}", split) for pattern in (images, labels))
    for image, places in image_matches(images, labels, root):
        if entry := _labelled(target, split, image, root, labels, places):
            yield entry


def _tabled(
    target: TargetFile, root: Path, split: str, images: Files, labels: Files
) -> Iterator[Entry]:
    """The entries of a split in the tables of images and labels."""
    if isinstance(images, str) and isinstance(labels, str):
        yield from _matched(target, root, split, images, labels)
    elif not isinstance(images, str) and not isinstance(labels, str):
        listed = []
        for k, pair in enumerate(zip(images, labels, strict=True)):
            where = f"{target.source}, images.{split}[{k}]"
            if row := _pair(target, root, where, pair):
                listed.append(row)
        yield from _distinct(target, root, listed)
    else:
        raise UserError(f"{target.source}: images and labels of {split} must both be lists")


class _Listed(NamedTuple):
    """An entry of a list."""

    where: str  # its place, for errors
    entry: Entry
    by_stem: bool = False  # whether its name is that of its file alone


def _distinct(target: TargetFile, root: Path, listed: Sequence[_Listed]) -> list[Entry]:
    """The entries of a list; if files of several folders have one name, paths become the names.

    Raises:
        UserError: an image is listed twice.
    """
    images: set[Path] = set()
    for where, entry, _ in listed:
        if entry.image_path in images:
            raise UserError(f"{where}: {entry.name} is listed twice; remove one")
        images.add(entry.image_path)
    if len({row.entry.name for row in listed}) == len(listed):
        return [row.entry for row in listed]
    return [
        _named(
            target, entry.image_path, entry.label_path, {"name": _path_name(root, entry.image_path)}
        )
        if by_stem
        else entry
        for _, entry, by_stem in listed
    ]


def _path_name(root: Path, image: Path) -> str:
    """A name of an image from its path below the folder."""
    return composed(image.relative_to(root).with_suffix("").as_posix()).replace("/", "_")


def _listed(
    target: TargetFile, root: Path, split: str, listing: Path, images: str, labels: str
) -> list[Entry]:
    """The entries of a list, whose lines are a name, a path, or an image and its label."""
    by_name = _by_name(root, split, images)
    listed = []
    for number, line in _lines(listing):
        where = f"{listing}, line {number}"
        named = _at_name(root, split, images, line, by_name, where)
        pairs = [*_split_pairs(line)]
        pair = next((words for words in pairs if len(words) == 2), ())
        if named is not None:
            entry = _labelled(target, split, named[0], root, labels, named[1])
            row = _Listed(where, entry) if entry else None
        elif pair:
            row = _pair(target, root, where, pair, images.replace("{split}", split))
        elif leads_out(root, _filled(images, split, {"name": line})):
            raise UserError(f"{where}: {line} is outside {root}")
        else:
            several = len(pairs[-1]) > 2
            expected = line if several else root / _filled(images, split, {"name": line})
            hint = ", with a comma or a tab between them if names have spaces" if several else ""
            raise UserError(
                f"{where}: no image {expected}; expected a name, a path, or an image and its label{hint}"
            )
        if row is not None:
            listed.append(row)
    return _distinct(target, root, listed)


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
    if not _has_folders(images):
        return None
    by_name: dict[str, list[tuple[Path, dict[str, str]]]] = {}
    for path, places in matches(images.replace("{split}", split), root):
        by_name.setdefault(places["name"], []).append((path, places))
    return by_name


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
                f"{where}: {named[0][0]} and {named[1][0]} both have this name; write the path"
            )
        if named:
            return named[0]
    else:
        path = _filled(images, split, {"name": line})
        image = _on_disk(root / path, not _has_suffix(images))
        if image is not None and not leads_out(root, path):
            return image, {"name": line}
    # A path below the folder, with or without suffix, or a name with the suffix that the pattern leaves out.
    expression = _expression(images)
    folder, _, file = images.rpartition("/")
    endings = [Path(file).suffix] if _has_suffix(images) else _SPELLINGS
    for ending in ("", *endings):
        for path in (f"{line}{ending}", f"{folder}/{line}{ending}"):
            match = expression.fullmatch(path)
            image = spelled(root / path) if match else None
            if match and image is not None:
                return image, match.groupdict()
    return None


def _pair(
    target: TargetFile, root: Path, where: str, pair: Sequence[str], images: str = ""
) -> _Listed | None:
    """An image and its label by their paths; None if it has no label and is left out.

    An image at the pattern ``images`` has the group and the folder there.
    """
    image, label = (_tail(root, path, where) for path in pair)
    if not image.is_file():
        raise UserError(f"{where}: no image {image}, whatever the extension ({', '.join(IMAGES)})")
    if not label.is_file():
        _check_left_out(target, image, label)
        return None
    path = composed(image.relative_to(root).as_posix())
    match = _expression(images).fullmatch(path) if _has_folders(images) else None
    places = match.groupdict() if match else {"name": composed(image.stem)}
    return _Listed(where, _named(target, image, label, places), by_stem=match is None)


def _tail(root: Path, path: str, where: str) -> Path:
    """A listed path below the folder.

    Published lists have paths of other machines (/SegNet/CamVid/train/...) and suffixes that copies lack, so
    the longest tail of the path that exists is taken. What follows a dot may also be part of the name.
    """
    path = plain_path(path)
    parts = [part for part in path.split("/") if part]
    tails = ["/".join(parts[k:]) for k in range(len(parts))] if path.startswith("/") else [path]
    for tail in filter(None, tails):
        if leads_out(root, tail):
            raise UserError(f"{where}: {tail} is outside {root}")
        whole = root / tail
        names = [whole.name, *(whole.name + suffix for suffix in _SPELLINGS)]
        if whole.suffix.lower() in IMAGES:
            names += [whole.stem + suffix for suffix in _SPELLINGS]
        for candidate in map(whole.with_name, names):
            if (file := spelled(candidate)) is not None:
                return file
    return root.joinpath(*tails[:1])


# ---- splits by groups or shares


def _split_up(target: TargetFile, root: Path, entries: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Make splits by groups or shares; no group is in two of them."""
    left: dict[str, list[Entry]] = {}
    for entry in entries:
        left.setdefault(entry.sequence, []).append(entry)
    rules = cast(Mapping[str, float | tuple[str, ...]], target.splits)
    total, group_count = sum(map(len, left.values())), len(left)
    splits: dict[str, list[Entry]] = {}
    for k, (split, rule) in enumerate(rules.items()):
        if isinstance(rule, float):
            later = len(rules) - k  # splits that need a group each, training included
            groups = _share(left, rule * total, max(1, len(left) - later))
        else:
            groups = [*rule]
        missing = [group for group in groups if group not in left]
        if missing:
            names = ", ".join(sorted(left)[:8]) + (", ..." if len(left) > 8 else "")
            raise UserError(
                f"{target.source}: splits.{split}: no group {missing[0]!r}; {root} has {names or 'none'}"
            )
        splits[split] = [entry for group in groups for entry in left[group]]
        if isinstance(rule, float):
            left = {group: entries for group, entries in left.items() if group not in groups}
    taken = {entry.sequence for entries in splits.values() for entry in entries}
    splits.setdefault(
        TRAIN, [entry for group in left if group not in taken for entry in left[group]]
    )
    if total and not splits[TRAIN]:
        why = (
            f"other splits take all {group_count} groups"
            if group_count > len(rules)
            else f"every split needs a group of its own, and there are only {group_count}"
        )
        raise UserError(f"{target.source}: splits: no images left for {TRAIN}, since {why}")
    return splits


def _share(groups: Mapping[str, Sequence[Entry]], images: float, most: int) -> list[str]:
    """Choose one group or more, ``most`` at most, with about so many images.

    The order is that of the names' digests; if it misses by half or more, that of the groups' sizes may be
    nearer.
    """
    by_digest = sorted(groups, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    by_size = sorted(by_digest, key=lambda name: abs(len(groups[name]) - images))

    choices: list[tuple[float, list[str]]] = []
    for order in (by_digest, by_size):
        taken = order[:1]
        count = sum(len(groups[name]) for name in taken)
        for name in order[1:]:
            size = len(groups[name])
            if len(taken) < most and abs(count + size - images) < abs(count - images):
                taken.append(name)
                count += size
        choices.append((abs(count - images), taken))
    error, taken = choices[0]
    return taken if error < images / 2 else min(choices, key=lambda choice: choice[0])[1]
