"""Files that describe targets: their fields, those of the package, and everything that can be wrong."""

import gc
from collections.abc import Callable, Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import UserError
from common.labels import classes as engine
from common.labels.target_file import SHIPPED, TargetFile, find_target, parse_target, shipped
from tests.conftest import refuses as refuses_call

TEXT = """\
images: images/{name}.jpg
labels: labels/{name}.png
splits: {train: train.txt, test: test.txt}
group: "^(.*)__"
void: [255]
classes:
  road: {ids: [0], renders: [road]}
  building:
    ids: [1, 7]
    renders: [building, wall, fence]
  lane mark: {ids: [3]}
"""


def refuses(text: str, *words: str) -> None:
    """One line that begins with the file and its line, and has all words."""
    with pytest.raises(UserError) as caught:
        parse_target(text, "x/target.yaml")
    message = str(caught.value)
    assert message.startswith("x/target.yaml") and "\n" not in message
    assert all(word in message for word in words), message


def test_fields_of_a_file():
    target = parse_target(TEXT, "mine/target.yaml")
    assert (target.name, target.format, target.kind, target.fit) == ("mine", "ids", "ids", "pad")
    assert target.class_names == ("road", "building", "lane mark")
    assert target.rendered == (True, True, False)
    by_name = dict(zip(engine.NAMES, target.of_engine, strict=True))
    rendered = {name: k for name, k in by_name.items() if k != 255}
    assert rendered == {"road": 0, "building": 1, "wall": 1, "fence": 1}
    assert target.palette[:2] == ((128, 64, 128), (70, 70, 70))  # the engine's
    assert len(set(target.palette)) == 3
    assert target.splits == {"train": "train.txt", "test": "test.txt"} and target.void == (255,)


def test_outlines_are_shares_of_the_width_by_engine_class():
    outlines = "outlines: {building: 2.5%, road: 10 %}"
    target = parse_target(f"{TEXT}{outlines}", "t.yaml")
    assert target.outlines == {"building": 0.025, "road": 0.1}
    assert target.engine_outlines == (((0,), 0.1), ((2, 3, 4), 0.025))
    exact = parse_target(TEXT, "t.yaml")
    assert exact.engine_outlines == () == shipped("kitti").engine_outlines
    assert parse_target(f"{TEXT}outlines: {{road: 0 %}}", "t.yaml") == exact
    rest = parse_target(f"{TEXT}rest: other\noutlines: {{other: 1 %}}", "t.yaml")
    assert rest.engine_outlines == (((1, *range(5, 19)), 0.01),)


def test_the_format_follows_from_the_classes():
    for field, value, kind, label_format in (
        ("ids", "[4]", "ids", "ids"), ("colours", "[[1, 2, 3]]", "colours", "colours"),
        ("names", "[Road]", "names", "labelme-json"),
    ):  # fmt: skip
        text = f"images: i/{{name}}.png\nlabels: l/{{name}}\nrest: b\nclasses: {{road: {{{field}: {value}}}}}"
        target = parse_target(text, "t.yaml")
        assert (target.format, target.kind, target.name) == (label_format, kind, "t")
    both = text.replace("{names", "{ids: [1], names").replace(
        "[Road]", "[Road], colours: [[1, 2, 3]]"
    )
    assert parse_target(both, "t.yaml").format == "ids"
    assert parse_target(f"format: colours\n{both}", "t.yaml").kind == "colours"


@pytest.mark.parametrize(("old", "new", "words"), [
    (TEXT, "", ("line 1:", "missing field images")),
    (TEXT, "- images", ("line 1:", "expected fields such as")),
    (TEXT, "a: [", ("line ", "not valid YAML")),
    (TEXT, "a: \x00", ("not valid YAML",)),
    ("void: [255]", "voids: [255]", ("line 5: voids:", "unknown field; expected one of images, la")),
    ("void: [255]", "source: a", ("line 5: source:", "unknown field")),
    ("void: [255]", "void: 255", ("line 5: void:", "expected list, not whole number")),
    ("void: [255]", "void: [65536]", ("line 5: void[0]:", "whole number from 0 to 65535")),
    ("void: [255]", "void: [[0, 0, 0]]", ("line 5: void[0]:", "expected a whole number from 0", "ids")),
    ("void: [255]", "void: [1]", ("line 9: classes.building.ids[0]:", "1 is also in void; keep one")),
    ("void: [255]", "void: [9, 255, 255]", ("line 5: void[2]:", "255 appears twice; remove one")),
    ("[1, 7]", "[1, -7]", ("line 9: classes.building.ids[1]:", "expected whole number >= 0")),
    ("[1, 7]", "[1, two]", ("line 9: classes.building.ids[1]:", "expected whole number, not text")),
    ("[1, 7]", "[1, 0]", ("line 9: classes.building.ids[1]:", "0 is also in road; keep one")),
    ("    ids: [1, 7]\n", "", ("line 8: classes.building:", "missing ids, its values in labels")),
    ("wall", "walls", ("line 10: classes.building.renders[1]:", "class 'walls'; it has road", "mean wall?")),
    ("wall", "road", ("line 10: classes.building.renders[1]:", "'road' is also in the renders of road")),
    ("    ids: [1, 7]", "    id: [1, 7]", ("line 9: classes.building.id:", "unknown field", "ids, colours")),
    ("lane mark", "void", ("line 11: classes.void: void is the name of ignored pixels",)),
    ("lane mark", "road", ("line 11: classes.road:", "appears twice; remove one")),
    ("lane mark", "[a, b]", ("line 11:", "expected a name, not a list")),
    ("{ids: [3]}", "[3]", ("line 11: classes.lane mark:", "expected table, not list")),
    ("road: {ids: [0], renders: [road]}", "road: &a {ids: [0]}\n  other: *a",
     ("line 7: classes.other:", "write it out")),
    ("images/{name}", "images/{nam}", ("line 1: images:", "unknown placeholder {nam}; expected {split}")),
    ("images/{name}", "images/all", ("line 1: images:", "expected {name} in the pattern")),
    ("labels/{name}", "../labels/{name}", ("line 2: labels:", "without '..'")),
    ("test: test.txt", "test: ../test.txt", ("line 3: splits.test:", "without '..'")),
    ("{train: train.txt, test: test.txt}", "'/{split}.txt'", ("line 3: splits:", "inside the data folder")),
    ("labels/{name}", "/labels/{name}", ("line 2: labels:", "inside the data folder")),
    ("labels/{name}.png", "{train: a/{name}.png}", ("line 2:", "not valid YAML")),
    ("labels/{name}.png", "{train: 'a/{name}.png'}", ("line 2: labels:", "must both be one pattern")),
    ("^(.*)__", "^(.*__", ("line 4: group:", "not a regular expression: missing )")),
    ("{train: train.txt, test: test.txt}", "train.txt", ("line 3: splits:", "expected {split} in the")),
    ("{train: train.txt, test: test.txt}", "{train: train.txt, test: 0.2}", ("line 3: splits:", "one kind")),
    ("{train: train.txt, test: test.txt}", "{train: 0.5}", ("line 3: splits.train:", "remove its share")),
    ("{train: train.txt, test: test.txt}", "{val: 0.5, test: 0.5}", ("line 3: splits:", "leave nothing")),
    ("{train: train.txt, test: test.txt}", "{test: 1.5}", ("line 3: splits.test:", "number < 1")),
    ("{train: train.txt, test: test.txt}", "{test: []}", ("line 3: splits.test:", "length >= 1")),
    ("{train: train.txt, test: test.txt}", "{a: [x], b: [y, x]}", ("splits.b[1]:", "'x' is also in a")),
    ("void: [255]", "fit: squash", ("line 5: fit:", "unknown value 'squash'")),
    ("void: [255]", "fit: blueprint", ("line 5: fit:", "unknown value 'blueprint'")),
    ("void: [255]", "name: 7", ("line 5: name:", "expected text, not whole number")),
    ("void: [255]", "name: 2024-13-45", ("line 5: name:", "cannot be read")),
    ("void: [255]", "format: colours\nvoid: [255]", ("void[0]: expected a colour [red, green, blue]",)),
    ("void: [255]", "outlines: 3 %", ("line 5: outlines:", "expected table, not text")),
    ("void: [255]", "outlines: {road: 3}", ("line 5: outlines.road:", "0 to 10 % of the image's width")),
    ("void: [255]", "outlines: {road: 10.1 %}", ("outlines.road:", "such as 3 %, not 10.1 %")),
    ("void: [255]", "outlines: {road: -1 %}", ("line 5: outlines.road:", "0 to 10 %")),
    ("void: [255]", "outlines:\n  road: 3 %\n  oak: 3 %", ("line 7: outlines.oak: not a class; expected "
     "one of road, building",)),
    ("void: [255]", "outlines: {lane mark: 3 %}", ("line 5: outlines.lane mark: has no 'renders'",)),
    ("void: [255]", "format: colours", ("line 7: classes.road:", "missing colours")),
])  # fmt: skip
def test_errors_name_line_and_field(old, new, words):
    assert old in TEXT
    refuses(TEXT.replace(old, new), *words)


def test_tables_of_splits():
    text = "images: {train: 'a/{name}.png', test: [b/x.png, b/y.png]}\n"
    labels = (
        "labels: {train: 'c/{name}.png', test: [d/x.png, d/y.png]}\n"
        "classes: {road: {ids: [0]}, sky: {ids: [1]}}"
    )
    target = parse_target(text + labels, "t.yaml")
    assert isinstance(target.images, dict) and target.images["test"] == ("b/x.png", "b/y.png")
    refuses(
        text + labels.replace("test", "val"), "line 2: labels:", "only one of them has test, val"
    )
    refuses(
        text + labels.replace(", d/y.png", ""), "line 2: labels.test:", "a list of the same length"
    )
    refuses(
        text + labels.replace("[d/x.png, d/y.png]", "'d/{name}.png'"),
        "labels.test:",
        "a list of the same length",
    )
    refuses(f"{text}{labels}\nsplits: {{test: 0.5}}", "line 4: splits:", "remove this field")
    refuses(text.replace("y.png", "y.png, 7") + labels, "line 1: images.test[2]:", "expected text")


def test_too_many_classes_and_none():
    refuses(
        "images: '{name}'\nlabels: '{name}'\nclasses: {}",
        "line 3: classes:",
        "2 to 254 classes, not 0",
    )
    alone = "images: '{name}'\nlabels: '{name}'\nclasses: {road: {ids: [1]}}"
    refuses(alone, "line 3: classes:", "2 to 254 classes, not 1; 'rest: background' makes a class")
    assert parse_target(f"{alone}\nrest: background", "x").class_names == ("road", "background")
    many = "".join(f"\n  c{k}: {{ids: [{k}]}}" for k in range(255))
    refuses(f"images: '{{name}}'\nlabels: '{{name}}'\nclasses:{many}", "classes:", "not 255")


def test_the_files_that_come_with_the_package():
    documented = {"camvid", "camvid-32", "cityscapes", "labelmefacade", "idd-lite", "kitti"}
    assert documented <= set(SHIPPED)
    for name in SHIPPED:
        target = shipped(name)
        assert target.name == target.source == name
        assert len(set(target.palette)) == len(target.classes)
        assert find_target(name) is target
    assert len(shipped("camvid-32").classes) == 31 and not shipped("camvid-32").rendered[0]
    assert shipped("cityscapes").class_names == engine.NAMES
    assert shipped("cityscapes").of_engine == tuple(range(19))
    assert all(shipped("idd-lite").rendered) and 255 not in shipped("idd-lite").of_engine
    for name in ("cityscapes", "kitti", "gta5"):
        ids = [target_class.ids for target_class in shipped(name).classes.values()]
        assert ids == [(row.file_id,) for row in engine.CLASSES]
        assert shipped(name).palette == tuple(row.colour for row in engine.CLASSES)


def test_a_file_with_the_images_or_anywhere(tmp_path):
    data = tmp_path / "my streets"
    refuses_call("no such folder", find_target, None, data, error=UserError)
    data.mkdir()
    message = (
        r"has no target\.yaml; sdr-jax doctor '.*my streets' --write .*names another file, "
        "or one of camvid"
    )
    refuses_call(message, find_target, None, data, error=UserError)
    refuses_call(
        r"--target .*a\.yaml: no such file", find_target, tmp_path / "a.yaml", error=UserError
    )
    refuses_call("name a target, or the folder of its images", find_target, None, error=UserError)
    (data / "target.yaml").write_text(TEXT)
    (tmp_path / "other.yaml").write_text(f"name: theirs\n{TEXT}")
    assert find_target(None, data).name == "my streets"
    assert find_target(tmp_path / "other.yaml", data).name == "theirs"
    (data / "target.yaml").write_text("#" * 1_000_001)
    refuses_call("more than 1,000,000 bytes", find_target, None, data, error=UserError)


@pytest.fixture
def collected() -> Iterator[Callable[[], int]]:
    """Collects garbage created since, without all that this process has imported."""
    gc.collect()
    gc.freeze()
    yield gc.collect
    gc.unfreeze()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(st.characters(codec="utf-8"), max_size=80), st.integers(0, len(TEXT)))
def test_no_text_ends_in_anything_but_a_target_or_one_error(collected, text, place):
    for whole in (text, TEXT[:place] + text + TEXT[place:], TEXT[:place]):
        try:
            target = parse_target(whole, "x.yaml")
        except UserError as error:
            assert str(error).startswith("x.yaml")
        else:
            assert isinstance(target, TargetFile)
    collected()  # a value that the library built wrongly ends the process here


@pytest.mark.parametrize("text", [
    "[" * 600, "[" * 40_000, "{a: " * 600, "images: " + "[" * 30 + "]" * 30, "- " * 400 + "a",
    "".join(f"{' ' * k}a:\n" for k in range(100)),
])  # fmt: skip
def test_deep_nesting_is_refused_before_it_is_read(text):
    refuses(text, "nested more than 20 deep")


def test_a_text_has_a_largest_size():
    refuses("# " + "x" * 1_000_000, "more than 1,000,000 bytes")


def test_wrong_expressions_are_refused():
    for expression in ("(", "a**", "a{99999999999}", "(" * 5000 + ")" * 5000):
        refuses(TEXT.replace("^(.*)__", expression), "line 4: group:", "not a regular expression")
