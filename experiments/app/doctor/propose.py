"""Proposes a target's file for a folder: patterns of images and labels, and their possible classes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import yaml

from common.errors import UserError
from common.files import IMAGES, composed, files_below, plain_path
from common.labels import classes as engine
from common.labels.listing import list_split, matches, split_names
from common.labels.target_file import FILE, SHIPPED, TRAIN, Format, find_target, shipped
from experiments.targets.real import HELD_OUT
from seg.data.images import read_image
from seg.data.labels import FORMATS, LabelReader

TRAINING_SETS = ("gta5", "synthia")
"""Targets in the package whose layouts are also those of many other folders."""
LOOKED_AT = 60
"""Number of label files whose values are read for a proposal."""
MOST_ENDINGS = 4
"""The most kinds of names in one folder, such as a_image.png and a_label.png."""
FEW = 64
"""The most different values of a label file; photographs have more."""
SPLITS = (TRAIN, "training", *HELD_OUT)
GROUPS = (r"^(.*)__", r"^(.*?)[_-]*\d+\D*$", r"^[^_-]+")
"""Expressions for groups of names, in the order of trial."""
_CITYSCAPES = re.compile(r"_label(?:Ids|((?:cs)?TrainIds))\.")
"""Label files with the ids of Cityscapes, or with those of its 19 classes (the parenthesis)."""
_MAPS = re.compile(r"depth|dispar|normals?(?![a-z])|flow|instance|panoptic|thermal", re.IGNORECASE)
"""Names of images that hold a number or an object for each pixel."""
_PHOTOGRAPHS = re.compile(r"rgb|ima?ge?|photo|picture|camera|frame|colou?r", re.IGNORECASE)
"""Names of photographs."""
VOID_NAMES = {
    "void",
    "unlabeled",
    "unlabelled",
    "ignore",
    "other",
    "unknown",
    "various",
    "background",
}
SYNONYMS = {
    "road": "street drivable lane roadway asphalt", "sidewalk": "pavement footpath walkway",
    "building": "house facade", "wall": "", "fence": "", "pole": "column lamppost",
    "vegetation": "tree bush plant",
    "traffic light": "trafficlight", "traffic sign": "sign trafficsign signsymbol", "terrain": "grass soil",
    "sky": "", "person": "pedestrian people human", "rider": "bicyclist cyclist motorcyclist",
    "car": "vehicle", "truck": "lorry", "bus": "coach", "train": "tram", "motorcycle": "motorbike",
    "bicycle": "bike cycle",
}  # fmt: skip
"""Engine class -> other words for it."""


class Proposal(NamedTuple):
    """A file, and notes on its guesses."""

    text: str
    notes: list[str]


class _Pair(NamedTuple):
    """A folder of images and the folder of their labels, as patterns."""

    images: str
    labels: str
    number: int  # of images


def propose(root: Path) -> Proposal:
    """Propose a target's file for a folder: its own, that of a known data set, or a guess.

    Raises:
        UserError: no images with labels are found, or the folder's own file is wrong.
    """
    if not root.is_dir():
        raise UserError(f"{root}: no such folder; expected one with images and labels")
    if (root / FILE).is_file():
        find_target(None, root)  # refuses a wrong file
        try:
            return Proposal((root / FILE).read_text(encoding="utf-8"), [])
        except UnicodeDecodeError:
            raise UserError(f"{root / FILE}: no UTF-8; save it as UTF-8") from None
    for name in SHIPPED:
        if name not in TRAINING_SETS and _fits(name, root):
            path = Path(engine.__file__).parent / "targets" / f"{name}.yaml"
            text = f"name: {name}\n{path.read_text(encoding='utf-8')}"
            return Proposal(text, [f"the folder has the layout and the values of {name}"])
    return _guess(root)


def _fits(name: str, root: Path) -> bool:
    """Whether a folder has the layout of a known data set, and values in some of its labels."""
    target = shipped(name)
    try:
        reader = LabelReader(target)
        for split in split_names(target, root):
            entries = list_split(target, root, split)
            for entry in entries[:: max(len(entries) // 8, 1)]:
                if reader.read(entry.label_path, entry.image_path)[1]:
                    return False
    except UserError:
        return False
    return bool(split_names(target, root))


# ---- images and labels


def _guess(root: Path) -> Proposal:
    files = [path.relative_to(root) for path in files_below(root)]
    parts = _sorted_parts(root, files)
    pairs = _pairs(parts)
    if not pairs:
        parts = _sorted_parts(root, files, starts=True)
        pairs = _pairs(parts)
    if not pairs:
        raise _no_pairs(root, files, parts)
    best = _best(root, pairs)
    notes = [
        f"{pair.number} images at {pair.images} are left out; a second file can take them"
        for pair in pairs
        if pair != best
    ]
    images, labels = best.images, best.labels
    labelled = dict(matches(labels, root))
    form, values, names = _values(sorted(labelled))
    lines = [f"images: {_quoted(images)}", f"labels: {_quoted(labels)}"]
    if form in ("labelme-json", "cityscapes-json"):
        lines.append(f"format: {form}")
    found = dict(matches(images, root))
    lists = _lists(root, {own for path, p in found.items() for own in (path.stem, p["name"])})
    bare = [] if lists else _bare(found, labelled.values())
    if bare:
        lines.append("unlabelled: skip")
        notes.append(
            f"{len(bare)} images without a label, such as {bare[0].relative_to(root)}, are left out"
        )
    if "{split}" not in images:
        if lists:
            lines.append(f"splits: {yaml.safe_dump(lists, default_flow_style=True).strip()}")
        else:
            notes.append("no list of a test split is found: all images are for training")
    if "{group}" not in images:
        group = _group([places["name"] for places in found.values()])
        if group:
            lines.append(f"group: {_quoted(group)}")
        else:
            notes.append(
                "names do not show which images are of one drive: each is a group of its own"
            )
    known: Mapping[str, str] = {}
    if not names:
        keys = [_key(value, form) for value in values]
        known = _named(root, labels, {*lists.values()}) or _as_cityscapes(labels, form, keys)
    classes = _classes(root, form, values, names, known, notes)
    return Proposal("\n".join([*lines, *classes]) + "\n", notes)


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _bare(images: Mapping[Path, dict[str, str]], labels: Collection[dict[str, str]]) -> list[Path]:
    """Images without a label, in splits that have some."""
    there = {frozenset(places.items()) for places in labels}
    splits = {places.get("split") for places in labels}
    return [
        path
        for path, places in sorted(images.items())
        if places.get("split") in splits and frozenset(places.items()) not in there
    ]


class _Sorted(NamedTuple):
    """The files of a folder by what they look like."""

    images: list[_Part]
    labels: list[_Part]
    errors: list[str]  # of files that cannot be read


def _sorted_parts(root: Path, files: Sequence[Path], starts: bool = False) -> _Sorted:
    """Sort files by folder, ending and the text around their names into images and labels."""
    buckets: dict[tuple[str, str], list[str]] = {}
    for path in files:
        if path.suffix.lower() in (*IMAGES, ".json"):
            buckets.setdefault((path.parent.as_posix(), path.suffix), []).append(path.stem)
    parts = _Sorted([], [], [])
    for key, stems in buckets.items():
        for part in _parts(*key, stems, starts):
            kind = _kind([part.path(root, core) for core in sorted(part.cores)[:3]], parts.errors)
            if kind:
                (parts.labels if kind == "labels" else parts.images).append(part)
    return parts


def _pairs(parts: _Sorted) -> list[_Pair]:
    """Patterns of images and labels of the same names, or of the same numbers after different starts."""
    found: Counter[tuple[str, str]] = Counter()
    for image in parts.images:
        ranked = [
            (
                _alike(image, label),
                -bool(_MAPS.search(label.pattern_below)),
                -_distance(image.folder, label.folder),
                bool(_CITYSCAPES.search(label.pattern)),
                -k,
            )
            for k, label in enumerate(parts.labels)
        ]
        if ranked and (best := max(ranked))[0]:
            found[_template(image, parts.labels[-best[-1]])] += best[0]
    return _grouped(found)


def _alike(one: _Part, other: _Part) -> int:
    """The number of names that two parts share; 0 if that is less than half of the smaller one."""
    common = len(one.cores & other.cores)
    return common if 2 * common >= min(len(one.cores), len(other.cores)) else 0


def _best(root: Path, pairs: Sequence[_Pair]) -> _Pair:
    """The pair of the photographs: not maps such as depth, then the most, in colour, and named so.

    Raises:
        UserError: another pair with the same labels is as good.
    """

    def rank(pair: _Pair) -> tuple[bool, int, bool, bool]:
        first = min(path for path, _ in matches(pair.images, root))
        try:
            image = read_image(first)
            colour = bool((image != image[..., :1]).any())
        except UserError:  # the survey reports it
            colour = False
        named = _PHOTOGRAPHS.search(pair.images) is not None
        return not _MAPS.search(pair.images), pair.number, colour, named

    if len(pairs) == 1:
        return pairs[0]
    ranks = [rank(pair) for pair in pairs]
    best = pairs[ranks.index(max(ranks))]
    for pair, own in zip(pairs, ranks, strict=True):
        if pair != best and own == max(ranks) and pair.labels == best.labels:
            raise UserError(
                f"{root}: images at {best.images} and at {pair.images} have the same labels, {best.labels}; "
                f"write a {FILE} with the pattern of the photographs"
            )
    return best


def _no_pairs(root: Path, files: Sequence[Path], parts: _Sorted) -> UserError:
    """The error of a folder without pairs: the first file that cannot be read, or labels like photographs."""
    for k, one in enumerate(parts.images):
        for other in parts.images[k + 1 :]:
            if _alike(one, other):
                core = min(one.cores & other.cores)
                colours, path = min((_colours(part.path(root, core)), part.path(root, core))
                                    for part in (one, other))  # fmt: skip
                return UserError(
                    f"{path}: holds {colours} values, as labels do that were resized with smoothing or "
                    "saved as JPEG; save them as PNG, and resize them by nearest pixel"
                )
    kinds = Counter(path.suffix.lower() for path in files).most_common(4)
    counts = ", ".join(f"{count} of {kind or 'no ending'}" for kind, count in kinds) or "nothing"
    why = f"; {parts.errors[0]}" if parts.errors else ""
    return UserError(
        f"{root}: no images with labels of the same names among {counts}{why}; expected such as "
        f"images/a.jpg and labels/a.png, or a {FILE} with the patterns of both"
    )


def _colours(path: Path) -> int:
    """The number of different colours of an image; 0 if it cannot be read."""
    try:
        return len(np.unique(FORMATS["colours"](path).codes))
    except UserError:
        return 0


class _Part(NamedTuple):
    """Files of one folder whose names have the same start and the same ending."""

    folder: str
    suffix: str
    start: str
    ending: str  # before the suffix
    cores: set[str]  # names between both

    def path(self, root: Path, core: str) -> Path:
        """The path of one of the files."""
        return root / self.folder / self.pattern.replace("{name}", core)

    @property
    def pattern_below(self) -> str:
        """The pattern of their paths."""
        return f"{self.folder}/{self.pattern}"

    @property
    def pattern(self) -> str:
        """The pattern of their names."""
        return f"{self.start}{{name}}{self.ending}{self.suffix}"


def _parts(folder: str, suffix: str, stems: Sequence[str], starts: bool) -> list[_Part]:
    """Group the files of a folder by the text around their digits, if there are few such.

    That is the text after the last digit, such as _label, and with ``starts`` that before the first one, too.
    """
    cores: dict[tuple[str, str], set[str]] = {}
    start = r"\D*" if starts else ""
    for stem in stems:
        # Cityscapes has _leftImg8bit.
        parts = re.fullmatch(rf"({start})(.*?)((?:8bit|\D)*)", stem, re.DOTALL)
        assert parts is not None
        cores.setdefault((parts[1], parts[3]), set()).add(parts[2])
    if len(cores) > MOST_ENDINGS or "" in [core for own in cores.values() for core in own]:
        cores = {("", ""): {*stems}}
    return [_Part(folder, suffix, *around, own) for around, own in cores.items()]


def _kind(sample: Sequence[Path], errors: list[str]) -> str:
    """Tell whether files look like labels or like images; empty for neither, as errors then say why."""
    kinds = set()
    for path in sample:
        if path.suffix.lower() in (".jpg", ".jpeg"):
            kinds.add("images")
            continue
        try:
            _, codes, _ = _looked_at(path)
        except UserError as error:
            errors.append(str(error))
            continue
        few = path.suffix == ".json" or len(np.unique(codes[::2, ::2])) <= FEW
        kinds.add("labels" if few else "images")
    return kinds.pop() if len(kinds) == 1 else ""


def _looked_at(path: Path) -> tuple[Format, np.ndarray, tuple[str, ...]]:
    """The format of a label file by its content, with its values; polygons have names, too."""
    polygons: tuple[Format, ...] = ("labelme-json", "cityscapes-json")
    first, second = polygons if path.suffix == ".json" else ("ids", "colours")
    try:
        return first, *FORMATS[first](path)
    except UserError as error:
        try:
            return second, *FORMATS[second](path)
        except UserError as other:
            # A file of the second format that is wrong has its list.
            raise (
                other if path.suffix == ".json" and "shapes must be a list" in str(error) else error
            ) from None


def _distance(one: str, other: str) -> int:
    """The number of folders that two paths do not share."""
    return len(set(PurePosixPath(one).parts) ^ set(PurePosixPath(other).parts))


def _template(image: _Part, label: _Part) -> tuple[str, str]:
    """Patterns, with {split} if both paths name a split."""
    parts, folder = PurePosixPath(image.folder).parts, label.folder
    for word in parts:
        # The labels' folder may be named after it, as trainannot is.
        others = PurePosixPath(folder).parts
        named = [part for part in others if part == word] or [p for p in others if word in p]
        if word.lower() in SPLITS and named:
            parts = tuple("{split}" if part == word else part for part in parts)
            folder = "/".join(p.replace(word, "{split}") if p in named else p for p in others)
            break
    return _joined("/".join(parts) or ".", image.pattern), _joined(folder, label.pattern)


def _joined(folder: str, name: str) -> str:
    return name if folder == "." else f"{folder}/{name}"


def _grouped(found: Counter[tuple[str, str]]) -> list[_Pair]:
    """Merge patterns that differ in one folder, the same for images and labels, into one with {group}."""
    merged: Counter[tuple[str, str]] = Counter()
    for (images, labels), count in found.items():
        merged[_with_group(images, labels, found)] += count
    return _of_any_suffix([_Pair(*both, count) for both, count in merged.items()])


def _of_any_suffix(pairs: Sequence[_Pair]) -> list[_Pair]:
    """Merge pairs whose images differ in their suffix alone, if no picture beside them is a label."""
    alike: dict[tuple[str, str], list[_Pair]] = {}
    for pair in pairs:
        (images, labels), suffix = pair[:2], PurePosixPath(pair.images).suffix
        beside = images.rpartition("/")[0] == labels.rpartition("/")[0]
        if not beside or labels.endswith(".json"):
            images = images.removesuffix(suffix)
        alike.setdefault((images, labels), []).append(pair)
    return [
        own[0] if len(own) == 1 else _Pair(*both, sum(pair.number for pair in own))
        for both, own in alike.items()
    ]


def _with_group(images: str, labels: str, found: Iterable[tuple[str, str]]) -> tuple[str, str]:
    own, others = images.split("/"), {pair[0] for pair in found}
    for k, part in enumerate(own[:-1]):
        if part == "{split}" or part not in labels.split("/"):
            continue
        open_ = [*own[:k], "{group}", *own[k + 1 :]]
        alike = [
            other for other in others
            if (words := other.split("/")) and len(words) == len(own)
            and [*words[:k], "{group}", *words[k + 1 :]] == open_
        ]  # fmt: skip
        if len(alike) > 1:
            own_labels = ["{group}" if p == part else p for p in labels.split("/")]
            return "/".join(open_), "/".join(own_labels)
    return images, labels


def _lists(root: Path, known: Collection[str]) -> dict[str, str]:
    """Find text files beside the folders, or where VOC has them, whose lines are names of images."""

    def names_one(line: str) -> bool:
        """Whether a line is a name, which may have spaces, or an image and its label."""
        paths = PurePosixPath(line), PurePosixPath(line.split()[0])
        return any(path.name in known or path.stem in known for path in paths)

    found = {}
    voc = [root / "ImageSets/Segmentation" / f"{split}.txt" for split in SPLITS]
    for path in [*sorted(root.glob("*.txt")), *filter(Path.is_file, voc)]:
        try:
            lines = path.read_text(encoding="utf-8-sig").split("\n")
        except (OSError, UnicodeDecodeError):
            continue
        lines = [*filter(None, map(plain_path, lines))]
        if lines and 2 * sum(map(names_one, lines)) > len(lines):
            found[path.stem] = path.relative_to(root).as_posix()
    # Others, such as trainval.txt, hold these again.
    return {split: own for split, own in found.items() if split in SPLITS} or found


def _group(names: Sequence[str]) -> str:
    """The first expression that finds groups of two or more images; empty if none does."""
    for expression in GROUPS:
        groups = Counter(m[m.re.groups] for n in names if (m := re.search(expression, n)))
        if groups and sum(groups.values()) == len(names) and len(groups) * 2 <= len(names):
            if "" not in groups:
                return expression
    return ""


# ---- classes


def _values(labels: Sequence[Path]) -> tuple[Format, Counter[int], Counter[str]]:
    """The format, and the pixels of each id, colour or name, in some of the label files.

    Where one file has colours, grey ones are colours, too. Pixels without a polygon have the name "".
    """
    form: Format = "ids"
    values: Counter[int] = Counter()
    names: Counter[str] = Counter()
    sample = labels[:: max(len(labels) // LOOKED_AT, 1)]
    looks = []
    for path in sample:
        with suppress(UserError):  # the survey reports it
            looks.append((path, *_looked_at(path)))
    forms = {look[1] for look in looks}
    # Every other pixel will do where there are several values: the survey reads whole files.
    step = (
        2
        if len({value for _, _, codes, _ in looks for value in np.unique(codes[::2, ::2])}) > 1
        else 1
    )
    for path, form, codes, found in looks:
        if form == "ids" and "colours" in forms:
            form, (codes, found) = "colours", FORMATS["colours"](path)
        own, counts = np.unique(codes[::step, ::step], return_counts=True)
        for value, count in zip(own.tolist(), counts.tolist(), strict=True):
            if path.suffix != ".json":
                values[value] += count
            else:
                names[found[value - 1] if value else ""] += count
    return form, values, names


def _classes(
    root: Path,
    form: Format,
    values: Counter[int],
    names: Counter[str],
    known: Mapping[str, str],
    notes: list[str],
) -> list[str]:
    """The lines of void and classes; ``known`` are names of ids or colours.

    No proposal has one class alone: what would be void, or the pixels of no polygon, is then the other one.

    Raises:
        UserError: the labels hold a single value.
    """
    pixels = {name: names[name] for name in sorted(names)} if names else {
        _key(value, form): values[value] for value in sorted(values)
    }  # fmt: skip
    total = max(sum(pixels.values()), 1)
    share = {key: f"{100 * count / total:.1f} % of the pixels" for key, count in pixels.items()}
    bare = pixels.pop("", 0)
    shown = {key: key if names else known.get(key, "") for key in pixels}
    void = [key for key, name in shown.items() if _is_void(key, name)]
    lines = []
    if len(shown) - len(void) < 2:
        if len(shown) + bool(bare) < 2:
            held = ", ".join(shown) or "nothing"
            raise UserError(
                f"{root}: labels hold one value alone ({held}); expected two classes or more"
            )
        notes += [
            f"{key} has {share[key]}, and is a class, since there is one other; if it means pixels "
            "without a label, put it into 'void' and name more classes"
            for key in void
        ]
        if bare:
            lines.append("rest: background")
            notes.append(
                f"pixels without a polygon, {share['']}, are the class background; 'rest' says so"
            )
        void = []
    elif bare:
        notes.append(
            f"pixels without a polygon, {share['']}, are void; 'rest: background' makes a class of them"
        )
    notes += [f"{key} is void: {share[key]}; put it into a class if it is one" for key in void]
    of: dict[str, list[str]] = {}
    for key, name in shown.items():
        if key not in void:
            of.setdefault(name or _unnamed(key, shown), []).append(_quoted(key) if names else key)
    field = "names" if names else "ids" if form == "ids" else "colours"
    raw_void = [_quoted(key) if names else key for key in void]
    lines += [f"void: [{', '.join(raw_void)}]", "classes:"]
    taken: set[str] = set()
    for own, raws in of.items():
        renders = [one for one in _rendered(own) if one not in taken]
        taken |= {*renders}
        told = f", renders: [{', '.join(renders)}]" if renders else ""
        lines.append(f"  {_quoted(own)}: {{{field}: [{', '.join(raws)}]{told}}}")
    if not taken:
        notes.append(
            "the classes' names are not known: name them after the pictures, and give each that the engine "
            f"has 'renders', of {', '.join(engine.NAMES)}"
        )
    return lines


def _unnamed(key: str, shown: Mapping[str, str]) -> str:
    """A name for a value that has none; of two values, as masks have, 0 is the background."""
    if len(shown) == 2 and not any(shown.values()) and any(zero in shown for zero in ZEROS):
        return "background" if key in ZEROS else "foreground"
    return f"class {key.strip('[]').replace(', ', ' ')}"


def _key(value: int, form: Format) -> str:
    return str([value >> 16, value >> 8 & 255, value & 255] if form == "colours" else value)


def _is_void(key: str, name: str) -> bool:
    plain = (name or key).lower()
    return plain in VOID_NAMES or (not name and key in ("255", "65535", "[0, 0, 0]"))


ZEROS = ("0", "[0, 0, 0]")
LISTS = ("classes", "labels", "names")
"""Files whose lines are names alone, for the ids 0, 1, 2 and so on."""
NAME = r"\s*(?=.*[^\W\d_])[\w(](?:[\w /()&'+-]|\.(?=\w))*\s*"
_FIRST, _LAST = r"\d+(?:[^\w(-]|-\s)+", r"(?:[\s,;:=|\[(]|\s-)+\d+"
"""A number before a name, and one after it, each with the separators between."""


def _named_value(line: str) -> tuple[str, str] | None:
    """The id or colour in a line, as `_key` writes it, and its name; None if the line has no such pair."""
    line = re.sub(r"(?<=\d)[\s,;:)\]]+$", "", composed(line).strip(" \t,;"))
    parts = re.fullmatch(rf"[\s\[(]*((?:{_FIRST})*)(.*?)((?:{_LAST})*)", line)
    assert parts is not None
    name = parts[2]
    before, after = (re.findall(r"\d+", numbers) for numbers in (parts[1], parts[3]))
    if len(before) <= 1 and len(after) >= 3:
        value, count = after[-3:], len(after) - 3
    elif not before and after:
        value, count = after[-1:], len(after) - 1
    elif len(before) in (1, 3, 4):
        value, count = before[-3:], len(after)
    else:
        return None
    for number in re.findall(_LAST, parts[3])[
        :count
    ]:  # those that are of the name, as in "zone 30"
        name += number
    name = name.strip(" \t,;:=|\"'")
    if not re.fullmatch(NAME, name):
        return None
    numbers = [int(number) for number in value]
    return str(numbers if len(numbers) == 3 else numbers[0]), name


def _named(root: Path, labels: str, lists: Collection[str]) -> dict[str, str]:
    """Names of ids or colours in a file above the labels that is not one of the lists of a split."""
    found: dict[str, str] = {}
    above = [own for own in PurePosixPath(labels).parents[1:] if "{" not in str(own)]
    folders = {root, *(root / own for own in above)}
    files = {path for own in folders for path in own.glob("*") if path.suffix in (".txt", ".csv")}
    for path in sorted(files):
        if path.relative_to(root).as_posix() in lists:
            continue
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()[:300]
        except (OSError, UnicodeDecodeError):
            continue
        for line in lines:
            if (pair := _named_value(line)) is not None:
                found[pair[0]] = pair[1]
        filled = [line for line in lines if line.strip()]
        if not found and path.stem in LISTS and all(re.fullmatch(NAME, own) for own in filled):
            found = {str(number): name.strip() for number, name in enumerate(filled)}
    return found


def _as_cityscapes(labels: str, form: Format, keys: Sequence[str]) -> dict[str, str]:
    """Names of ids where label files are called as Cityscapes calls them, or of colours that are its own."""
    classes = shipped("cityscapes").classes
    if form == "colours":
        found = {str([*colour]): name for name, own in classes.items() for colour in own.colours}
        return found if 2 * sum(key in found for key in keys) > len(keys) else {}
    called = _CITYSCAPES.search(labels)
    if called is None:
        return {}
    if called[1]:
        found = {str(number): name for number, name in enumerate(classes)}
    else:
        found = {str(number): name for name, own in classes.items() for number in own.ids}
    return {key: found.get(key, "void") for key in keys}


def _rendered(name: str) -> list[str]:
    """Engine classes that a name may mean."""
    plain = re.sub(r"[_-]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)).lower().strip()
    forms = {plain, plain.removesuffix("s"), plain.replace(" ", "")}
    return [one for one, others in SYNONYMS.items() if forms & {one, *others.split()}]
