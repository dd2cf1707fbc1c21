"""Attributes that are held: in every row of every job, in its files, and against another command."""

import json

import numpy as np
import pytest

from experiments.evaluation.job import rendered_of
from scene.attributes import names
from scene.held import in_words, read_fixed
from scene.proposal import draw, streets_in
from seg.data import LabelledImages

from .conftest import Counted, lines, main_job, never, transferred

FIX = ("--space", "extended", "--fix", "field_of_view=90", "--fix", "camera_position_y=1.4")
HELD = read_fixed(FIX[3::2], "extended")
WORDS = f"Held in all streets: {in_words(HELD)}"
LEARNT = {"centre": 0.4, "width": 0.3}
WHERE = [names("extended").index(name) for name in HELD]


def checked(scores: Counted) -> int:
    """How many nets saw rendered streets; all of these have what is held."""
    count = 0
    for first, second, *_ in scores.calls:
        streets = first.streets if hasattr(first, "streets") else rendered_of(second)
        if streets is None or isinstance(streets, LabelledImages):
            continue
        count += 1
        found = draw(streets, 0, 4)
        np.testing.assert_array_equal(found[:, WHERE], [[*HELD.values()]] * 4)
        assert (np.ptp(np.delete(found, WHERE, axis=1), axis=0) > 0).sum() >= 21
    return count


@pytest.mark.parametrize(("name", "rendered", "flags"), [
    ("table", 6, "--learnt FILE"), ("pretrain", 2, "--learnt FILE"), ("assets", 4, ""),
    ("labels", 2, "--learnt FILE --renders default learnt"),
    ("ablation", 8, "--variants full random no_positions --search.method random_search"),
    ("searches", 20, "--methods random_search --few 2"),
    ("fidelity", 6, ""), pytest.param("sensitivity", 12, "", marks=pytest.mark.slow),
])  # fmt: skip
def test_every_row_of_a_study_holds_it_and_its_report_says_so(
    name, rendered, flags, command, tmp_path
):
    file = tmp_path / "learnt.json"
    file.write_text(json.dumps({name: LEARNT for name in names("extended")}))
    scored = Counted()
    tuned = Counted(transferred)
    tuned.calls = scored.calls
    own = flags.replace("FILE", str(file)).split()
    stubs = {"evaluate": scored, "transfer": tuned}
    assert command(name, tmp_path / "run", *FIX, *own, **stubs) == 0
    assert checked(scored) >= rendered
    assert WORDS in (tmp_path / "run" / f"{name}.md").read_text()


def test_a_run_keeps_what_is_held_and_is_not_continued_with_another_value(
    camvid, scored_by, tmp_path, error_line, capsys
):
    scores = Counted()
    scored_by(scores)
    flags = ["--data", str(camvid), "--out", str(tmp_path / "run")]
    flags += ["--method", "random_search"]
    assert main_job("camvid", *flags, *FIX) == 0
    assert WORDS in capsys.readouterr().out
    assert checked(scores) > 12
    learnt = streets_in(tmp_path / "run" / "attributes.json")
    np.testing.assert_array_equal(draw(learnt, 1, 3)[:, WHERE], [[*HELD.values()]] * 3)
    streets = json.loads((tmp_path / "run" / "dataset" / "dataset.json").read_bytes())["streets"]
    np.testing.assert_array_equal(np.float32(streets)[:, WHERE], [[*HELD.values()]] * len(streets))
    page = (tmp_path / "run" / "report.html").read_text()
    assert WORDS in page and "field of view, held" in page and "exposure, held" not in page
    for line in lines(tmp_path / "run" / "evaluations.jsonl"):
        assert [line["width"][k] for k in WHERE] == [0, 0]
    scored_by(never)
    other = [*FIX[:-1], "camera_position_y=1.5"]
    assert main_job("camvid", *flags, *other) == 2
    assert "a run with fix = [" in error_line()


@pytest.mark.parametrize(("flags", "words"), [
    (["--fix", "field_of_view=90"], "space scenex has no attribute field_of_view"),
    (["--fix", "camera_position_why=1"], "did you mean camera_position_y?"),
    (["--fix", "camera_position_y=9"], "must be a number from 0.8 to 4 (m)"),
    ([f for name in names("scenex") for f in ("--fix", f"{name}=9")], "illumination_intensity must"),
    ([*FIX, "--groups", "bend"], "--groups"),
])  # fmt: skip
def test_what_cannot_be_held_is_one_line(flags, words, error_line, out):
    assert main_job("twin", "--out", str(out), *flags) == 2
    assert words in error_line() and not out.exists()
