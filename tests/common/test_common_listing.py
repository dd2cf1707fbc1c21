"""Images and labels as targets' files name them, on folders of a few files; no pixel is read."""

import hashlib
import json
import re
from collections import Counter
from pathlib import Path
from unicodedata import normalize

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import UserError
from common.labels.listing import list_all, list_split, shared_groups, split_names
from common.labels.target_file import parse_target, shipped

CLASSES = "\nclasses: {road: {ids: [0]}, sky: {ids: [1]}}"


def put(root: Path, *names: str, text: str = "never read") -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def target_of(text: str):
    return parse_target(text + CLASSES, "t.yaml")


def names(splits) -> dict[str, list[str]]:
    return {split: [entry.name for entry in entries] for split, entries in splits.items()}


def groups(splits) -> dict[str, str]:
    return {entry.name: entry.sequence for entries in splits.values() for entry in entries}


def refuses(root: Path, target, split: str, *words: str) -> None:
    with pytest.raises(UserError) as caught:
        list_split(target, root, split)
    message = str(caught.value)
    assert "\n" not in message and all(word in message for word in words), message


LAYOUTS = {
    "camvid": (
        ["train/{}.png trainannot/{}.png 0001TP_1 0016E5_2",
         "test/{}.jpg testannot/{}.png Seq05VD_f3 0001TP_4"],
        {"train": ["0001TP_1", "0016E5_2"], "test": ["0001TP_4", "Seq05VD_f3"]},
        ["0001TP", "0016E5", "Seq05VD"],
    ),
    "camvid-32": (
        ["701_StillsRaw_full/{}.png LabeledApproved_full/{}_L.png 0006R0_f1 0016E5_2 Seq05VD_f3 Seq05VD_f4"],
        {"train": ["0006R0_f1", "0016E5_2"], "test": ["Seq05VD_f3", "Seq05VD_f4"]},
        ["0006R0", "0016E5", "Seq05VD"],
    ),
    "cityscapes": (
        ["leftImg8bit/train/{}_leftImg8bit.png gtFine/train/{}_gtFine_labelIds.png bonn/bonn_0 "
         "aachen/aachen_1",
         "leftImg8bit/val/{}_leftImg8bit.png gtFine/val/{}_gtFine_labelIds.png ulm/ulm_0 ulm/ulm_1"],
        {"train": ["aachen_1", "bonn_0"], "val": ["ulm_0", "ulm_1"]},
        ["aachen", "bonn", "ulm"],
    ),
    "labelmefacade": (
        ["images/{}.jpg labels/{}.png town__p10 boston__img_7 town__p9 laredo__street"],
        {"train": ["boston__img_7", "town__p10", "town__p9"], "test": ["laredo__street"]},
        ["boston__img", "laredo__street", "town__p"],
    ),
    "idd-lite": (
        ["leftImg8bit/train/{}_image.jpg gtFine/train/{}_label.png 0/024541 87/357164 87/024541",
         "leftImg8bit/val/{}_image.jpg gtFine/val/{}_label.png 132/475092"],
        {"train": ["0_024541", "87_024541", "87_357164"], "val": ["132_475092"]},
        ["0", "132", "87"],
    ),
    "kitti": (
        ["training/image_2/{}.png training/semantic/{}.png 000000_10 000001_10 000002_10 000003_10"],
        {"train": 3, "test": 1},
        ["000000_10", "000001_10", "000002_10", "000003_10"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_published_layouts_of_the_targets_that_come_with_the_package(tmp_path, name):
    files, splits, expected = LAYOUTS[name]
    for words in files:
        image, label, *stems = words.split()
        for stem in stems:
            put(tmp_path, image.format(stem), label.format(stem))
    if name == "labelmefacade":
        put(tmp_path, "train.txt", text="town__p10\nboston__img_7\n\ntown__p9\n")
        put(tmp_path, "test.txt", text="laredo__street")
    listed = list_all(shipped(name), tmp_path)
    listed_names = names(listed)
    assert list(listed_names) == list(splits)
    for split, names_or_count in splits.items():
        assert names_or_count in (listed_names[split], len(listed_names[split]))
    assert sorted(set(groups(listed).values())) == expected
    for entries in listed.values():
        assert list(entries) == sorted(entries, key=lambda entry: (entry.sequence, entry.name))
        assert all(entry.image_path.is_file() and entry.label_path.is_file() for entry in entries)
    label = next(entry for entries in listed.values() for entry in entries).label_path
    label.unlink()
    with pytest.raises(
        UserError, match=r"image without label; expected .*" + re.escape(label.name)
    ):
        list_all(shipped(name), tmp_path)


def test_lists_of_names_of_paths_and_of_pairs(tmp_path):
    target = target_of(
        "images: '{split}/{name}'\nlabels: '{split}_l/{name}'\nsplits: '{split}.txt'"
    )
    put(tmp_path, *(f"day/{k}.png" for k in "abc"), *(f"day_l/{k}.png" for k in "abc"))
    for text in (
        "a\nb", " b \n\na\n", "day/a.png\nday/b.png", "/home/x/data/day/a.png /data/day_l/a.png\nb",
        "day/a.jpg day_l/a.png\nday/b.png day_l/b.jpeg", "a.png\nb.png",
    ):  # fmt: skip
        put(tmp_path, "day.txt", text=text)
        entries = list_split(target, tmp_path, "day")
        assert [e.name for e in entries] == ["a", "b"], text
        assert {e.image_path.suffix for e in entries} == {".png"}
    (tmp_path / "day.txt").unlink()
    assert [e.name for e in list_split(target, tmp_path, "day")] == ["a", "b", "c"]
    assert split_names(target, tmp_path) == ("day",)


def test_a_list_of_images_whose_groups_are_folders(tmp_path):
    target = target_of(
        "images: 'i/{group}/{name}.jpg'\nlabels: 'l/{group}/{name}.png'\nsplits: {train: t.txt}"
    )
    for name in ("x/1", "x/2", "y/2"):
        put(tmp_path, f"i/{name}.jpg", f"l/{name}.png")
    put(tmp_path, "t.txt", text="1\ni/y/2.jpg")
    assert groups(list_all(target, tmp_path)) == {"x_1": "x", "y_2": "y"}
    put(tmp_path, "t.txt", text="1\n2")
    refuses(
        tmp_path,
        target,
        "train",
        "t.txt, line 2:",
        "i/x/2.jpg and",
        "both have this name; write the path",
    )


def test_tables_of_images_and_labels(tmp_path):
    target = target_of("images: {a: 'd/{name}.jpg', b: [n/1.jpg, /p/n/2.jpg]}\n"
                 "labels: {a: 'dl/{name}.png', b: [m/1.png, m/2.png]}")  # fmt: skip
    put(tmp_path, "d/x.jpg", "dl/x.png", "n/1.jpg", "n/2.jpg", "m/1.png", "m/2.png")
    assert names(list_all(target, tmp_path)) == {"a": ["x"], "b": ["1", "2"]}
    (tmp_path / "m/2.png").unlink()
    refuses(tmp_path, target, "b", "n/2.jpg: image without label", "m/2.png")
    (tmp_path / "n/1.jpg").unlink()
    refuses(tmp_path, target, "b", "t.yaml, images.b[0]: no image", "n/1.jpg")
    refuses(tmp_path, target, "c", "no split 'c'; in t.yaml. Its splits: a, b")


def test_names_with_signs_of_patterns_are_names(tmp_path):
    target = target_of("images: 'a[1]/{name}.v2.jpg'\nlabels: 'l*/{name}.png'")
    put(tmp_path, "a[1]/x.v2.jpg", "a[1]/y.jpg", "a1/z.v2.jpg", "l*/x.png")
    assert names(list_all(target, tmp_path)) == {"train": ["x"]}


@pytest.mark.parametrize(("expression", "expected"), [
    ("^(.*)__", {"a__1": "a", "a__2": "a", "b": "b"}),
    ("^[^_]+", {"a__1": "a", "a__2": "a", "b": "b"}),
    ("x*", {"a__1": "a__1", "a__2": "a__2", "b": "b"}),
    (r"\d", {"a__1": "1", "a__2": "2", "b": "b"}),
])  # fmt: skip
def test_groups_by_an_expression(tmp_path, expression, expected):
    target = target_of(f"images: 'i/{{name}}'\nlabels: 'l/{{name}}'\ngroup: '{expression}'")
    for name in expected:
        put(tmp_path, f"i/{name}.jpeg", f"l/{name}.png")
    assert groups(list_all(target, tmp_path)) == expected


def test_splits_by_group_leave_the_rest_for_training(tmp_path):
    text = "images: 'i/{name}.png'\nlabels: 'l/{name}.png'\ngroup: '^.'\n"
    for name in ("a1", "a2", "b1", "c1", "c2"):
        put(tmp_path, f"i/{name}.png", f"l/{name}.png")
    target = target_of(text + "splits: {test: [c], val: [b]}")
    splits = list_all(target, tmp_path)
    assert names(splits) == {"train": ["a1", "a2"], "test": ["c1", "c2"], "val": ["b1"]}
    assert not shared_groups(splits)
    refuses(
        tmp_path, target_of(text + "splits: {test: [d]}"), "test", "no group 'd'", "has a, b, c"
    )
    target = target_of(text + "splits: {test: [a], val: [b, c]}")
    refuses(tmp_path, target, "val", "no images left for train, since other splits take all 3")
    target = target_of(text + "splits: {train: [a], test: [c]}")
    assert names(list_all(target, tmp_path)) == {"train": ["a1", "a2"], "test": ["c1", "c2"]}
    refuses(tmp_path, target, "val", "no split 'val'", "Its splits: train, test")


@given(st.lists(st.integers(1, 9), min_size=3, max_size=12), st.sampled_from([0.1, 0.25, 0.5]))
def test_shares_never_split_a_group(tmp_path_factory, sizes, share):
    root = tmp_path_factory.mktemp("data")
    for k, size in enumerate(sizes):
        put(root, *(f"{f}/g{k}_{n}.png" for n in range(size) for f in "il"))
    text = "images: 'i/{name}.png'\nlabels: 'l/{name}.png'\ngroup: '^[^_]+'\n"
    splits = list_all(target_of(f"{text}splits: {{test: {share}}}"), root)
    sides = [{entry.sequence for entry in entries} for entries in splits.values()]
    assert len(sides) == 2 and all(sides) and not sides[0] & sides[1]
    assert sum(map(len, splits.values())) == sum(sizes)
    # With one more group or one less in it, the split would not be nearer to its share.
    expected, count = share * sum(sizes), len(splits["test"])
    test_groups = Counter(entry.sequence for entry in splits["test"])
    assert len(test_groups) == 1 or abs(count - expected) <= max(sizes)
    assert splits == list_all(target_of(f"{text}splits: {{test: {share}}}"), root)


@pytest.mark.parametrize(("sizes", "shares", "expected"), [
    ((40, 4, 3, 3), {"test": 0.2}, {"train": 40, "test": 10}),
    ((19, 5, 5, 5, 5, 5, 5), {"test": 0.2}, {"train": 39, "test": 10}),
    ((30, 30), {"test": 0.1}, {"train": 30, "test": 30}),
    ((5, 5, 5, 5), {"test": 0.9}, {"train": 5, "test": 15}),
    ((5, 5, 5, 5), {"val": 0.6, "test": 0.3}, {"train": 5, "val": 10, "test": 5}),
])  # fmt: skip
@pytest.mark.parametrize("first", "abcdefgh")
def test_a_share_is_approached_whatever_the_names(tmp_path, sizes, shares, expected, first):
    for k, size in enumerate(sizes):
        put(tmp_path, *(f"{folder}/{first}{k}_{n}.png" for n in range(size) for folder in "il"))
    text = (
        f"images: 'i/{{name}}'\nlabels: 'l/{{name}}'\ngroup: '^[^_]+'\nsplits: {json.dumps(shares)}"
    )
    splits = list_all(target_of(text), tmp_path)
    assert {split: len(entries) for split, entries in splits.items()} == expected


def test_shares_of_equal_groups_are_those_of_the_names_digests(tmp_path):
    put(tmp_path, *(f"{folder}/{k}_{n}.png" for k in range(10) for n in "ab" for folder in "il"))
    text = "images: 'i/{name}'\nlabels: 'l/{name}'\ngroup: '^.'\nsplits: {val: 0.1, test: 0.3}"
    listed = list_all(target_of(text), tmp_path)
    digests = sorted("0123456789", key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    assert {entry.sequence for entry in listed["val"]} == {*digests[:1]}
    assert {entry.sequence for entry in listed["test"]} == {*digests[1:4]}


def test_a_share_of_one_group_leaves_nothing(tmp_path):
    put(tmp_path, "i/g_1.png", "l/g_1.png", "i/g_2.png", "l/g_2.png")
    target = target_of("images: 'i/{name}'\nlabels: 'l/{name}'\ngroup: '^.'\nsplits: {test: 0.5}")
    refuses(tmp_path, target, "train", "no images left for train, since every split")


def test_what_is_missing_or_not_as_it_should_be(tmp_path):
    target = target_of(
        "images: '{split}/{name}.png'\nlabels: '{split}_l/{name}.png'\nsplits: '{split}.txt'"
    )
    refuses(tmp_path / "gone", target, "train", "gone: no such folder", "{split}/{name}.png and")
    refuses(tmp_path, target, "train", "no split 'train'", "Its splits: none")
    put(
        tmp_path,
        "train/a.png",
        "train_l/a.png",
        "train/b.png",
        "test/c.png",
        "none/.keep",
        "none_l/.keep",
    )
    refuses(
        tmp_path,
        target,
        "val",
        "no split 'val'; expected val.txt or val/{name}.png",
        "Its splits: train, none",
    )
    refuses(
        tmp_path, target, "none", "no images in split 'none'; expected none.txt or none/{name}.png"
    )
    refuses(
        tmp_path, target, "train", "train/b.png: image without label; expected", "train_l/b.png"
    )
    for text, words in {
        "\n": ("no images in split 'train'",), "a\na": ("line 2: a is listed twice",),
        "c": ("line 1: no image", "train/c.png; expected a name, a path"),
        "b": ("b.png: image without label",),
        "../../a": ("line 1: ../../a is outside",), "../a ../b": ("line 1: ../a is outside",),
        "/x/../../a.png /y/b.png": ("line 1:", "is outside"),
        "x/d.png y/d.png": ("line 1: no image", "d.png"),
        "train/a.png y/a.png": ("a.png: image without label; expected", "y/a.png"),
    }.items():  # fmt: skip
        put(tmp_path, "train.txt", text=text)
        refuses(tmp_path, target, "train", *words)
    (tmp_path / "train.txt").write_bytes(b"\xff\xfe\x00")
    refuses(tmp_path, target, "train", "train.txt: not a readable text file")
    target = target_of("images: '{name}'\nlabels: '{name}'\nsplits: {train: t.txt}")
    refuses(tmp_path, target, "train", "t.txt: not a readable text file (")
    target = target_of("images: 'train/{name}.png'\nlabels: 'train/{name}.png'")
    assert names(list_all(target, tmp_path)) == {"train": ["a", "b"]}
    refuses(tmp_path, target, "test", "no split 'test'; t.yaml defines none. Its splits: train")


def test_text_files_beside_lists_are_no_splits(tmp_path):
    target = target_of("images: 'i/{name}.png'\nlabels: 'l/{name}.png'\nsplits: '{split}.txt'")
    put(tmp_path, "i/a.png", "l/a.png", "i/b.png", "l/b.png")
    put(tmp_path, "train.txt", text="a\n")
    put(tmp_path, "extra.txt", text="i/b.png l/b.png\n")
    put(tmp_path, "README.txt", text="My images of a road.\n\nThey are mine.\n" + "long " * 2000)
    put(tmp_path, "empty.txt", text="")
    (tmp_path / "latin.txt").write_bytes(b"stra\xdfe")
    assert names(list_all(target, tmp_path)) == {"train": ["a"], "extra": ["b"]}
    # A list by its name is one even if it names no image: figures must not come from elsewhere.
    put(tmp_path, "test.txt", text="gone\n")
    assert split_names(target, tmp_path) == ("train", "extra", "test")
    refuses(tmp_path, target, "test", "test.txt, line 1: no image", "gone.png")


def test_lists_as_people_write_them(tmp_path):
    put(tmp_path, "i/a b.png", "l/a b.png", "i/c.png", "l/c.png", "i/d,e.png", "l/d,e.png")
    target = target_of(
        "images: './i//{name}.png'\nlabels: 'l\\{name}.png'\nsplits: './{split}.txt'"
    )
    assert (target.images, target.labels, target.splits) == (
        "i/{name}.png",
        "l/{name}.png",
        "{split}.txt",
    )
    for line, name in {
        "./i/c.png": "c", "i\\c.png": "c", ".\\i\\c.png .\\l\\c.png": "c", "i//c.png": "c",
        "i/c.png,l/c.png": "c", "i/c.png, ./l/c.png": "c", "i/c.png;l/c.png": "c",
        "i/a b.png\tl/a b.png": "a b", "i/a b.png,l/a b.png": "a b", "d,e": "d,e", "a b": "a b",
        "C:\\mine\\i\\c.png C:\\mine\\l\\c.png": "c",
    }.items():  # fmt: skip
        put(tmp_path, "train.txt", text=f"{line}\n")
        assert names(list_all(target, tmp_path)) == {"train": [name]}, line


def test_a_dot_in_a_name_is_no_suffix(tmp_path):
    for stem in ("frame_1", "frame_2", "1305.175304"):
        put(tmp_path, f"i/{stem}.png", f"l/{stem}.png")
    for ending in ("", ".png"):
        target = target_of(
            f"images: 'i/{{name}}{ending}'\nlabels: 'l/{{name}}{ending}'\nsplits: '{{split}}.txt'"
        )
        for line in (
            "1305.175304", "1305.175304.png", "i/1305.175304", "i/1305.175304 l/1305.175304",
            "/data/i/1305.175304.jpg /data/l/1305.175304.jpg",
        ):  # fmt: skip
            put(tmp_path, "train.txt", text=f"{line}\n")
            [entry] = list_split(target, tmp_path, "train")
            assert entry.name == "1305.175304" and entry.label_path.name == "1305.175304.png"
        put(tmp_path, "train.txt", text="i/frame_1.5 l/frame_1.5\n")
        refuses(
            tmp_path, target, "train", "line 1: no image", "i/frame_1.5, whatever the extension"
        )


@pytest.mark.parametrize("ending", [".PNG", ".Png", ".Tif"])
def test_the_case_of_an_extension_does_not_matter(tmp_path, ending):
    put(tmp_path, f"i/a{ending}", f"l/a{ending}")
    target = target_of("images: 'i/{name}'\nlabels: 'l/{name}'")
    assert names(list_all(target, tmp_path)) == {"train": ["a"]}
    listed = target_of("images: 'i/{name}'\nlabels: 'l/{name}'\nsplits: '{split}.txt'")
    for line in ("a", f"a{ending}", "i/a", "i/a l/a", "i/a.jpg l/a.jpg"):
        put(tmp_path, "train.txt", text=line)
        assert names(list_all(listed, tmp_path)) == {"train": ["a"]}, line


@pytest.mark.parametrize("disk", ["NFC", "NFD"])
@pytest.mark.parametrize("text", ["NFC", "NFD"])
def test_accents_may_be_composed_or_not(tmp_path, disk, text):
    other = {"NFC": "NFD", "NFD": "NFC"}[disk]
    path, label = "größe/été/é1.png", "bäume/é1.png"
    put(tmp_path, normalize(disk, path), normalize(other, label))
    put(tmp_path, "train.txt", text=normalize(text, "é1\n"))
    pattern = "images: 'größe/{group}/{name}.png'\nlabels: 'bäume/{name}.png'\n"
    whole = target_of(normalize(text, pattern))
    listed = target_of(normalize(text, f"{pattern}splits: '{{split}}.txt'"))
    pairs = target_of(normalize(text, f"images: {{train: [{path}]}}\nlabels: {{train: [{label}]}}"))
    for target, name in ((whole, "été_é1"), (listed, "été_é1"), (pairs, "é1")):
        [entry] = list_split(target, tmp_path, "train")
        assert entry.name == name and entry.image_path.is_file() and entry.label_path.is_file()


def test_no_place_of_a_pattern_leads_out(tmp_path):
    root = tmp_path / "data"
    put(tmp_path, "secret.png", "labels/secret.png", "x/a.png", "x.txt", text="a\n")
    put(root, "a/b.png", "labels/a.png", "labels/b.png", "labels/secret.png")
    target = target_of(
        "images: '{group}/{name}.png'\nlabels: 'labels/{name}.png'\nsplits: '{split}.txt'"
    )
    put(root, "train.txt", text="../secret.png\n")
    refuses(root, target, "train", "line 1", "../secret.png")
    target = target_of(
        "images: '{split}/{name}.png'\nlabels: 'labels/{name}.png'\nsplits: '{split}.txt'"
    )
    for split in ("..", "../x", "../data/a", str(tmp_path / "x")):
        refuses(root, target, split, f"no split {split!r}; expected a name, not a path")
    target = target_of("images: {'..': '{split}/{name}.png'}\nlabels: {'..': 'labels/{name}.png'}")
    refuses(root, target, "..", "secret.png is outside")


def test_an_image_without_a_label_names_the_field_that_leaves_it_out(tmp_path):
    put(tmp_path, "i/a.png", "l/a.png", "i/b.png")
    target = target_of("images: 'i/{name}.png'\nlabels: 'l/{name}.png'")
    words = "b.png: image without label; expected", "'unlabelled: skip' in t.yaml leaves such"
    refuses(tmp_path, target, "train", *words)
    target = msgspec.structs.replace(target, unlabelled="skip")
    assert names(list_all(target, tmp_path)) == {"train": ["a"]}


@pytest.mark.parametrize(
    "text", ["a\nb", "i/a.png\ni/b.png", "i/a.png l/a.png\ni/b.png l/b.png", ""]
)
def test_lists_leave_images_without_a_label_out_if_the_file_says_so(tmp_path, text):
    put(tmp_path, "i/a.png", "l/a.png", "i/b.png")
    put(tmp_path, "train.txt", text=text)
    listed = "images: 'i/{name}.png'\nlabels: 'l/{name}.png'\nsplits: {train: train.txt}"
    table = "images: {train: [i/a.png, i/b.png]}\nlabels: {train: [l/a.png, l/b.png]}"
    target = target_of(listed if text else table)
    words = "b.png: image without label; expected", "'unlabelled: skip' in t.yaml leaves such"
    refuses(tmp_path, target, "train", *words)
    target = msgspec.structs.replace(target, unlabelled="skip")
    assert names(list_all(target, tmp_path)) == {"train": ["a"]}


def test_equal_names_in_several_folders(tmp_path):
    paths = ["s1/rgb/0", "s1/rgb/1", "s2/rgb/0"]
    pairs = [f"{path}.png {path.replace('rgb', 'gt')}.png" for path in paths]
    put(tmp_path, *(path for pair in pairs for path in pair.split()))
    plain = target_of("images: 'rgb/{name}.png'\nlabels: 'gt/{name}.png'\nsplits: '{split}.txt'")
    grouped = target_of(
        "images: '{group}/rgb/{name}'\nlabels: '{group}/gt/{name}'\nsplits: '{split}.txt'"
    )
    columns = (", ".join(column) for column in zip(*map(str.split, pairs), strict=True))
    table = target_of("images: {{train: [{}]}}\nlabels: {{train: [{}]}}".format(*columns))
    by_path = ["s1_rgb_0", "s1_rgb_1", "s2_rgb_0"]
    for lines in (pairs, pairs[::-1]):
        put(tmp_path, "train.txt", text="\n".join(lines))
        for target in (plain, table):
            assert names(list_all(target, tmp_path)) == {"train": by_path}
        by_folder = {"s1_0": "s1", "s1_1": "s1", "s2_0": "s2"}
        assert groups(list_all(grouped, tmp_path)) == by_folder
    # Names stay short where they differ.
    put(tmp_path, "train.txt", text="\n".join(pairs[:2]))
    assert names(list_all(plain, tmp_path)) == {"train": ["0", "1"]}
    put(tmp_path, "train.txt", text="\n".join([*pairs, pairs[0]]))
    for target in (plain, grouped):
        refuses(tmp_path, target, "train", "train.txt, line 4:", "0 is listed twice; remove one")
    twice = target_of("images: {train: [s1/rgb/0, s1/rgb/0]}\nlabels: {train: [s1/gt/0, s1/gt/1]}")
    refuses(tmp_path, twice, "train", "t.yaml, images.train[1]: 0 is listed twice; remove one")


def test_a_pair_with_an_empty_side_is_refused(tmp_path, monkeypatch):
    put(tmp_path, "i/a.png")
    monkeypatch.chdir(tmp_path)
    target = target_of("images: 'i/{name}.png'\nlabels: 'l/{name}.png'\nsplits: '{split}.txt'")
    for line, words in (
        ("i/a.png,", "i/a.png: image without label"),
        (",i/a.png", "train.txt, line 1: no image"),
    ):
        put(tmp_path, "train.txt", text=line)
        for root in (tmp_path, Path(".")):
            refuses(root, target, "train", words)


def test_a_pair_whose_names_have_spaces_needs_a_comma_or_a_tab(tmp_path):
    put(tmp_path, "i/a b.png", "l/a b.png")
    target = target_of("images: 'i/{name}.png'\nlabels: 'l/{name}.png'\nsplits: '{split}.txt'")
    put(tmp_path, "train.txt", text="i/a b.png l/a b.png")
    refuses(
        tmp_path,
        target,
        "train",
        "train.txt, line 1: no image i/a b.png l/a b.png; expected a name, a path, or an image and its "
        "label, with a comma or a tab between them if names have spaces",
    )
