"""What studies share: attributes from a file or by search, nets scored once, reports derived anew."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from common.errors import UserError
from common.files import read_json
from experiments import session
from experiments.config import LearntConfig, read_attributes
from experiments.config.jobs import defaults_of
from experiments.config.presets import defaults
from experiments.evaluation import pace as paces
from experiments.evaluation import renders
from experiments.evaluation.cost import Cost, cost_of, training_cost
from experiments.evaluation.job import Result
from experiments.evaluation.pace import REFERENCE, Crew, Pace
from experiments.evaluation.store import LOGS, Store
from experiments.session.session import Work, plan_text
from experiments.tables import form
from experiments.tables.bins import random_bins
from experiments.tables.nets import paired_seeds, training_sets
from experiments.tables.skeleton import (
    Row,
    Study,
    check,
    do,
    learnt_attributes,
    learnt_work,
    of_rows,
)
from experiments.tables.stats import over_units, statistics
from scene.proposal import random_proposal
from tests.conftest import refused

from .conftest import (
    ROOT,
    Counted,
    Killed,
    by_preset,
    job_of,
    lines,
    main_job,
    never,
    results_of,
    searching,
    startable,
    study,
    transferred,
)

TRAINED = ("table", "pretrain", "assets", "ablation", "labels")  # their rows are of nets
RESULTS = ROOT / "docs" / "results"


def recorded_reports():
    """The reports of the page of results; those after the first of a study are slow."""
    studies = set()
    for name in read_json(RESULTS / "parts.json"):
        study_name = study_of(RESULTS / f"{name}.json")
        yield pytest.param(name, marks=[pytest.mark.slow] if study_name in studies else [])
        studies.add(study_name)


def study_of(path: Path) -> str:
    """The study of a report; some are from before reports named it."""
    return read_json(path).get("study", re.split("[-_]", path.stem)[0])


FORM = form.Form(
    "some", lambda report: {**report, "mean": float(np.mean(report["scores"]))},
    lambda report: f"{report['mean']}", {"some.png": lambda report: b"picture"},
)  # fmt: skip
SOME = Study(
    FORM, lambda config, prepared: [],
    lambda run, prepared: {**form.about(run, run.config.final), "scores": [1, 2]},
)  # fmt: skip


@pytest.fixture
def config(tiny) -> LearntConfig:
    return searching(tiny(partial(defaults, LearntConfig)), method="random_search")


@by_preset
@pytest.mark.parametrize("name", (*TRAINED, "searches", "fidelity", "sensitivity"))
def test_presets_are_sound(name, target, preset):
    job = job_of(name)
    check(job.STUDY, startable(defaults_of(name, target, preset)))


@pytest.mark.parametrize(("name", "counts", "flags"), [
    pytest.param("table", (3,), "--learnt FILE", marks=pytest.mark.slow),
    # Between the scores of one network.
    pytest.param("pretrain", (3,), "--learnt FILE", marks=pytest.mark.slow),
    pytest.param("assets", (3,), "", marks=pytest.mark.slow),
    ("labels", (3,), "--learnt FILE --renders default learnt"),
    # Within a search, and within the networks.
    pytest.param(
        "ablation", (3, 3), "--variants full no_positions --search.method random_search",
        marks=pytest.mark.slow,
    ),
    ("searches", (6, 10), "--methods random_search --few 2"),  # within a search, and in the next one
    ("fidelity", (7,), ""), ("sensitivity", (5,), ""),
])  # fmt: skip
def test_killed_it_goes_on_ends_the_same_and_is_derived_anew(
    name, counts, flags, command, tmp_path, learnt_file, monkeypatch, capsys
):
    scored, tuned = Counted(), Counted(transferred)
    tuned.calls = scored.calls

    def work(out, *flags):
        return command(name, out, *flags, evaluate=scored, transfer=tuned)

    flags = flags.replace("FILE", str(learnt_file)).split()
    whole, broken, again = tmp_path / "whole", tmp_path / "broken", tmp_path / "again"
    assert work(whole, *flags) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[1] == "Plan, in CPU seconds:" and " left" in printed
    calls = len(scored.calls)
    for count in counts:
        dying = Counted(Store.add, limit=count)
        with monkeypatch.context() as patch, pytest.raises(Killed):
            patch.setattr(Store, "add", lambda *record, dying=dying: dying(*record))
            work(broken, *flags)
    assert sum(len(lines(broken / log)) for log in LOGS) == sum(counts)
    assert work(broken, *flags) == 0
    # What is finished is not redone, but for what was never written; nor does a report need any net.
    assert len(scored.calls) == 2 * calls + len(counts)
    assert command(name, broken, *flags, evaluate=never, transfer=never) == 0
    assert study(name, "--rederive", str(whole / f"{name}.json"), "--out", str(again)) == 0
    for file in (f"{name}.json", f"{name}.md", f"{name}.png"):
        one, *others = ((out / file).read_bytes() for out in (whole, broken, again))
        assert others == [one, one]
    assert min(Image.open(whole / f"{name}.png").size) > 200


@pytest.mark.parametrize("flags", [("--few", "2"), ("--reward-images", "2")])
def test_a_search_of_the_study_is_the_main_jobs_of_its_seed(flags, command, camvid, tmp_path):
    store = tmp_path / "store.jsonl"
    flags = (*flags, "--store", str(store))
    searches = ("--methods", "random_search", "--searches", "2")
    assert command("searches", tmp_path / "study", *searches, *flags) == 0
    study_keys = {line["key"] for line in lines(store)[1:]}
    main_flags = ("--seed", "1", "--search.method", "random_search", "--data", str(camvid))
    assert main_job("camvid", "--out", str(tmp_path / "main"), *main_flags, *flags) == 0
    scored = [
        line for log in LOGS for line in lines(tmp_path / "main" / log) if line["side"] == "reward"
    ]
    assert len(scored) == 12 and {line["key"] for line in scored} <= study_keys


@pytest.mark.parametrize("report", list(recorded_reports()))
def test_a_recorded_report_is_derived_anew(report, out):
    recorded = RESULTS / f"{report}.json"
    name = study_of(recorded)
    assert study(name, "--rederive", str(recorded), "--out", str(out)) == 0
    assert {**read_json(recorded), "study": name} == read_json(out / f"{name}.json")
    assert min(Image.open(out / f"{name}.png").size) > 200


@pytest.mark.parametrize(("name", "flags", "complaint"), [
    ("table", ("--nets", "compact", "compact"), "has a value twice"),
    ("table", ("--gta5", "/nowhere"), "/nowhere: no such folder; expected gta5"),
    ("table", ("--synthia", "/nowhere"), "/nowhere: no such folder; expected synthia"),
    ("table", ("--kitti", "/nowhere"), "/nowhere: no such folder; expected kitti"),
    ("table", ("--weights", "/nowhere.npz"), "--weights is for VGG networks"),
    ("table", ("--weights", "/no.npz", "--nets", "fcn8s"), "/no.npz: No such file"),
    ("table", ("--learnt", "/nowhere.json"), "--learnt /nowhere.json: No such file"),
    ("table", ("--data", "/nowhere"), "/nowhere"),
    ("pretrain", ("--fractions", "0.1"), "0.1 selects none of the 4 real images; 0.25 or"),
    ("pretrain", ("--fractions", "nan"), "--fractions must lie in (0, 1], not nan"),
    ("pretrain", ("--rows", "scratch", "scratch"), "has a value twice"),
    ("pretrain", ("--finetune-steps", "0"), "--finetune-steps must be 1 or more"),
    ("pretrain", ("--finetune-lr", "-1"), "--finetune-lr must be positive"),
    ("assets", ("--images", "3"), "--images must be multiples of --final.shots 2"),
    ("assets", ("--images", "0"), "--images must be 1 or more, not 0"),
    ("assets", ("--images", "4", "4"), "--images 4 4 has a value twice"),
    ("assets", ("--fractions", "0.5", "0.5"), "--fractions 0.5 0.5 has a value twice"),
    ("assets", ("--fractions", "0"), "--fractions must lie in (0, 1], not 0"),
    ("assets", ("--fractions", "1.5"), "--fractions must lie in (0, 1], not 1.5"),
    ("assets", ("--learnt", "FILE"), "--learnt has no effect with --attributes default"),
    ("labels", ("--counts", "0", "2"), "--counts needs two or more numbers above 0"),
    ("labels", ("--counts", "2", "5"), "--counts 5 is more than the 4 labelled images of camvid"),
    ("labels", ("--counts", "1", "2", "-1"), "--counts must be 0 or more, not -1"),
    ("labels", ("--renders", "random", "--learnt", "FILE"), "has no effect with --renders random"),
    ("labels", ("--few-share", "1"), "--few-share must lie in (0, 1), not 1"),
    ("searches", ("--searches", "0"), "--searches must be 1 or more, not 0"),
    ("searches", ("--methods", "sdr", "sdr"), "--methods sdr sdr has a value twice"),
    ("searches", ("--methods", "random_attributes"), "does not search"),
    ("searches", ("--groups", "car_position"), "--groups: in no group"),
    ("searches", ("--core-minutes", "0.0001"), "0.0001 are too few for one update of intervals"),
    ("searches", ("--subset", "car_position"), "--subset needs --core-minutes"),
    ("searches", ("--subset", "fog", "--core-minutes", "1"), "--subset: unknown attribute 'fog'"),
    ("searches", ("--subset", "bend", "bend", "--core-minutes", "1"), "--subset bend bend has a value twice"),
    ("table", ("--few", "4"), "--few 4 selects all 4 labelled images of camvid"),
    ("ablation", ("--variants", "full", "full"), "--variants full full has a value twice"),
    ("ablation", ("--variants", "no_groups"), "--variants must include full"),
    ("ablation", ("--method", "sdr"), "--evaluations 4 are too few for sdr on 23 attributes"),
    ("ablation", ("--method", "random_attributes"), "random_attributes does not search"),
    ("ablation", ("--evaluations", "0"), "--evaluations must be 1 or more, not 0"),
    ("ablation", ("--evaluations", "3"), "multiple of --search.datasets-per-update 2, not 3"),
    ("fidelity", ("--proposals", "1"), "--proposals must be 2 or more"),
    ("fidelity", ("--repeated", "9"), "--repeated must be 5 or less, the number of proposals, not 9"),
    ("fidelity", ("--repeats", "1"), "--repeats must lie in [2, "),
    ("fidelity", ("--rungs", "0"), "--rungs must be 1 or more"),
    ("fidelity", ("--require-signal", "0"), "--require-signal must be positive"),
    ("fidelity", ("--require-signal", "nan"), "--require-signal must be positive"),
    ("fidelity", ("--search.relaxation", "2"), "--search.relaxation must lie in [0, 1]"),
    ("fidelity", ("--target", "cityscapes", "--data", "None"), "Cityscapes needs its folder"),
    ("fidelity", ("--target", "twin"), "--data has no effect with --target twin"),
    ("fidelity", ("--rederive", "none.json"), "--rederive none.json: No such file"),
])  # fmt: skip
def test_bad_input_is_one_line(name, flags, complaint, command, out, error_line, learnt_file):
    flags = [str(learnt_file) if flag == "FILE" else flag for flag in flags]
    assert command(name, out, *flags, evaluate=never, transfer=never) == 2
    assert complaint in error_line() and not out.exists()


@pytest.mark.parametrize(("name", "flags"), [
    ("table", ("--nets", "resnet")),
    ("pretrain", ("--rows", "imagenet")),
    ("assets", ("--asset-fraction", "0.5")),
    ("ablation", ("--variants", "no_fog")), ("ablation", ("--learnt", "x.json")),
    ("searches", ("--methods", "descent")), ("searches", ("--search.method", "sdr")),
    ("searches", ("--method", "sdr")), ("ablation", ("--search.updates-per-group", "3")),
])  # fmt: skip
def test_flags_that_cannot_be_are_refused_by_name(name, flags, command, out, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        command(name, out, *flags)
    assert flags[0] in capsys.readouterr().err


def test_learnt_attributes_are_made_once(config, counted, tmp_path):
    shared = replace(config, store=tmp_path / "shared.jsonl")
    with session.open(shared) as run:
        plan = learnt_work(shared)
        run.begin(plan)
        learnt = learnt_attributes(run)
        assert len(counted.calls) == sum(work.number for work in plan) == 12
    again = replace(shared, out=tmp_path / "again")
    with session.open(again) as run:
        streets = learnt_attributes(run)
    assert len(counted.calls) == 12
    for other in (streets, read_attributes("--learnt", again.out / "attributes.json", "scenex")):
        np.testing.assert_array_equal(np.stack(other), np.stack(learnt))


def test_seeds_of_nets_and_of_random_bins_begin_at_the_jobs_own(config):
    def seeds(seed):
        return paired_seeds(SimpleNamespace(config=replace(config, seed=seed, seeds=3)))

    assert (seeds(0), seeds(5)) == ([0, 1, 2], [5, 6, 7])
    one, other, again = (random_bins(replace(config, seed=seed), 2) for seed in (0, 5, 5))
    assert not np.array_equal(one, other)
    np.testing.assert_array_equal(other, again)


def test_nets_are_paired_and_made_once(config, counted):
    with session.open(config) as run:
        recipe, seeds = run.recipe(config.final), paired_seeds(run)
        sources = training_sets(run, random_proposal())
        assert list(sources) == ["random", "default", "learnt", "real"]
        results = results_of(run, "some", sources, recipe, seeds)
        # Random and optimised attributes are the same here.
        assert [task[2] for task in counted.calls] == [0, 0, 1, 1, 0, 1]  # the longest first
        again = results_of(run, "others", sources, recipe, seeds)
        assert len(counted.calls) == 6 and list(results) == list(again) == list(sources)
        for name, row_results in results.items():
            assert again[name] == [outcome._replace(stored=True) for outcome in row_results]
        # Other assets are other nets.
        half = run.recipe(config.final, fraction=0.5)
        results_of(run, "some", {"random": random_proposal()}, half, seeds)
        assert len(counted.calls) == 8
    with session.open(config) as run:
        results_of(run, "some", sources, recipe, seeds)
    keys = {line["key"] for line in lines(config.out / "finals.jsonl")}
    assert len(counted.calls) == len(keys) == 8


def test_rows_of_one_kind_keep_their_own_recipes(config, counted):
    """The words of a kind are for people: rows that read alike may differ."""
    fields = ((config.final, 0.5), (replace(config.final, samples=3), 1.0))
    rows = [
        Row({"row": k}, lambda *_: random_proposal(), fidelity, "nets", str(k), pool={"fraction": share})
        for k, (fidelity, share) in enumerate(fields)
    ]  # fmt: skip
    bare_form = FORM._replace(derive=lambda report: report, text=lambda report: "", figures={})
    rows_study = of_rows(bare_form, lambda *_: rows, lambda run, answers, scored: {"rows": scored})
    do(rows_study, config)
    recipes = [(recipe.fidelity, recipe.pool.fraction) for recipe, *_ in counted.calls]
    assert sorted(recipes, key=fields.index) == [fields[0]] * 2 + [fields[1]] * 2


@pytest.mark.parametrize(("name", "flags", "message"), [
    ("table", ("--learnt", "FILE", "--method", "sdr"), "--search.method has no effect with --learnt"),
    ("table", ("--all-images",), "--all-images needs --gta5 or --synthia or --kitti"),
    ("table", ("--few-share", "0.4"), "--few-share needs --few"),
    ("table", ("--twin-seed", "3"), "--twin-seed is for --target twin, not camvid"),
    ("table", ("--twin", "near"), "--twin is for --target twin, not camvid"),
    ("labels", ("--method", "gaussian", "--start", "random"), "--search.start is for intervals, not gau"),
    ("searches", ("--methods", "tpe", "cma_es", "--search.squared-reward"),
     "--search.squared-reward is for sdr, not tpe, cma_es"),
    ("ablation", ("--method", "intervals", "--search.learning-rate", "1"),
     "--search.learning-rate is for sdr, not intervals"),
    ("pretrain", ("--learnt", "FILE", "--rows", "random"), "--learnt has no effect with --rows random"),
    ("sensitivity", ("--records", "FILE", "--evaluations", "9"), "--evaluations has no effect with --rec"),
    ("table", ("--from-scratch",), "--from-scratch is for --preset paper, not smoke"),
    ("labels", ("--weights", "x.npz"), "--weights is for VGG networks and dinov2; this job trains compact"),
])  # fmt: skip
def test_a_flag_without_effect_is_refused(
    name, flags, message, command, out, error_line, learnt_file
):
    flags = [str(learnt_file) if flag == "FILE" else flag for flag in flags]
    assert command(name, out, *flags, evaluate=never, transfer=never) == 2
    assert message in error_line() and not out.exists()


def test_what_cannot_be_done_shows_before_the_folder_is_made(config):
    def refuse(config, target):
        raise UserError(f"not on {target.name}")

    with pytest.raises(UserError, match="not on camvid"):
        do(replace(SOME, prepare=refuse), config)
    assert not config.out.exists()


def test_the_plan_tells_nets_seconds_and_time_and_what_nets_start_from(tmp_path):
    final = defaults(LearntConfig, "camvid", "quick").final
    plan = [Work.at("nets, 3 sets x 5 seeds", 15, final), Work("b", 10, final, Cost(2.0, 4.0))]
    text = plan_text(plan, Crew(REFERENCE, 2), Cost())
    # 400 x (0.035 + 0.025) s of rendering, 42240 pixels x (800 views x 2.5e-7 s + 4000 in updates x 4.5e-8 s)
    assert "15 x   39.9  nets, 3 sets x 5 seeds (lite0, 240x176, 400 images, 1000 steps)" in text
    # (15 x 39.9 + 10 x 6) / 2 + 12 = 341 s, then (15 x (23.8 + 2 x 16.1) + 10 x 10) / 2 + 31 = 501 s
    assert "About 6 min on 2 workers, 12 s of it to start and compile" in text
    text = plan_text(plan, Crew(Pace(1.0, 2.0), 2), Cost(5.0, 2.0))
    assert "About 8 min on 2 workers, 31 s of it to start and compile" in text
    assert "10 x   10.0  b" in text
    path = tmp_path / "hed.npz"
    np.savez(path, normalisation="hed", source="VGG16, fine-tuned")
    other = replace(final, train=replace(final.train, net="fcn8s", weights=str(path)))
    alone = "the 13 convolutions alone, fc6 and fc7 start at random"
    sentence = f"fcn8s starts from {path}: VGG16, fine-tuned; {alone}"
    assert (
        plan_text(
            [Work("a", 1, f, Cost()) for f in (final, other, other)], Crew(REFERENCE, 2), Cost()
        ).count(sentence)
        == 1
    )
    assert form.starts({"starts": [sentence]}) == f" {sentence}." and form.starts({}) == ""


def test_a_gain_over_tested_images_by_hand():
    good, bad = np.diag([8, 8]), np.array([[4, 4], [0, 8]])
    ours, theirs = np.array([good] * 15), np.array([good] * 5 + [bad] * 10)
    estimate = over_units(ours, theirs)
    assert estimate.value == pytest.approx(100 * (1 - (80 / 120 + 120 / 160) / 2))
    # Without one of the five good images, and without one of the ten bad ones.
    without = [1 - (72 / 112 + 112 / 152) / 2] * 5 + [1 - (76 / 112 + 112 / 148) / 2] * 10
    half = 100 * 2.14479 * np.sqrt(14 * np.var(without))  # Student's t of 14 degrees of freedom
    assert estimate.ci95 == pytest.approx([estimate.value - half, estimate.value + half], rel=1e-4)
    assert over_units(ours, ours) == (0.0, [0.0, 0.0])
    few = over_units(ours[:13], theirs[:13])
    assert few.value > 0 and few.ci95 is None


def test_statistics_leave_failed_nets_out_and_figures_in_tables_by_hand():
    summary = statistics([10.0, None, 14.0], [9.0, 5.0, 11.0])
    assert summary["mean"] == 12 and summary["gain"]["mean"] == 2  # of 1 and 3
    assert statistics([None, 3.0], [1.0, None])["gain"] is None
    assert statistics([None], None) == {"mean": None, "ci95": None, "gain": None}
    outcomes = [Result(v, [v, None], 1, 1) for v in (0.2, 0.4)]
    scored = form.nets([*outcomes, Result(np.nan, [], 1, 1, "the loss is nan")])
    assert form.class_means(scored, ["a", "b"]) == {"a": pytest.approx(30), "b": None}
    assert form.miou(scored) == pytest.approx([20, 40, None]) and scored[2] is None
    assert form.failures([{"nets": scored}])[1].endswith(" failed: 1.")
    together = Result(0.5, [0.5, None], 1, 1, heads=([0.25, None], [0.5, 1.0]))
    failed = Result(np.nan, [], 1, 1, "the loss is nan")
    assert form.miou(form.nets([together, failed], 2)) == [25.0, 75.0, None, None]
    assert form.miou(form.nets([together])) == [50.0]
    assert form.failures([{"nets": scored[:2]}]) == []
    row = {"mean": 12.34, "ci95": [11.0, 13.68]}
    assert form.cells(row) == ["12.3", "11.0 to 13.7"] and form.error_bars([row]) == (
        pytest.approx([1.34]),
        pytest.approx([1.34]),
    )
    assert form.cells(row, "+.2f") == ["+12.34", "11.00 to 13.68"]
    none = "too few networks for an interval"
    assert form.cells({"mean": 12.0, "ci95": None}) == ["12.0", none]  # one net
    # 3 and 6: 4.5 +- 12.706 x 1.5, cut at 0; a gain may be below.
    wide = statistics([3.0, 6.0])
    assert form.cells(wide) == ["4.5", "0.0 to 23.6"]
    assert form.error_bars([wide]) == ([4.5], pytest.approx([19.06], abs=0.01))
    assert form.cells(statistics([3.0, 6.0], [0.0, 0.0])["gain"]) == ["4.5", "-14.6 to 23.6"]
    assert form.cells(statistics([97.0, 94.0]))[1] == "76.4 to 100.0"
    assert form.cells(statistics([0.2, 0, 1.1, 0.4, 0.1])) == ["0.4", "0.0 to 0.9"]
    assert form.cells(statistics([None]))[1] == "" and form.cells(None) == ["", ""]
    assert form.error_bars([{"mean": 1.0, "ci95": None}]) == ([0.0], [0.0])
    assert form.markdown(["a", "b"], [["1", "2"]]) == ["| a | b |", "| --- | --- |", "| 1 | 2 |"]


def test_a_report_is_derived_anew_from_its_scores(config, tmp_path, capsys):
    report = do(SOME, config)
    assert (report["study"], report["target"], report["scored_at"]) == ("some", "camvid", "64x48")
    assert (report["reward_images"], report["test_images"], len(report["classes"])) == (4, 2, 11)
    assert report["mean"] == 1.5 and (config.out / "some.md").read_text() == "1.5\n"
    file = config.out / "some.json"
    file.write_text(file.read_text().replace("1.5", "99"))  # only scores count
    out = tmp_path / "b" / "c"
    assert do(SOME, replace(config, rederive=file, out=out, data=None)) == report
    other = out.parent / "other"
    other.mkdir()
    (other / "config.json").write_text("{}")
    refused(
        UserError, "other holds another run, whose report --rederive would replace",
        do, SOME, replace(config, rederive=file, out=other, data=None),
    )  # fmt: skip
    assert [path.name for path in other.iterdir()] == ["config.json"]
    assert (out / "some.png").read_bytes() == b"picture"
    assert capsys.readouterr().out.endswith("1.5\n")


@pytest.mark.parametrize(("content", "attributes", "report"), [
    (None, "No such file .*expected the attributes.json of a run", "; expected the some.json of a run"),
    ("{", "is not a JSON file", "is not a JSON file"),
    ('{"fog": 0.5}', "unknown attribute 'fog'", "the study some"),
    ('{"study": "other"}', "unknown attribute 'study'", "is not a report of the study some"),
    ('{"study": "some"}', "unknown", "is not a complete report of the study some"),
])  # fmt: skip
def test_other_files_are_neither_attributes_nor_reports(config, out, content, attributes, report):
    file = out.with_name("some.json")
    if content is not None:
        file.write_text(content)
    with pytest.raises(UserError, match=f"--learnt {file}.*{attributes}"):
        check(SOME, replace(config, learnt=file))
    with pytest.raises(UserError, match=report):
        form.rewrite(FORM, file, out)
    assert not out.exists()


@pytest.mark.parametrize("part", ["text", "figures"])
def test_a_report_of_other_types_is_refused_before_a_file_is_written(out, part):
    def fail(report):
        return report["mean"].items()  # an AttributeError

    file = out.with_name("some.json")
    file.write_text('{"study": "some", "scores": [1, 2]}')
    failing = FORM._replace(**{part: fail if part == "text" else {"some.png": fail}})
    with pytest.raises(UserError, match="is not a complete report of the study some"):
        form.rewrite(failing, file, out)
    assert not out.exists()


def test_separate_trainers_train_while_renderers_render(tmp_path):
    final = defaults(LearntConfig, "camvid", "quick").final
    pace, cost = Pace(2.0, 3.0), Cost(160.0, 70.0)
    crews = Crew(pace, 16), Crew(pace, 16, 1), Crew(pace, 2, 2)
    assert [crew.wall(cost) for crew in crews] == [(320 + 210) / 16, 210, 160]
    text = plan_text([Work("nets", 1, final, cost)], crews[-1], Cost())
    # max(320 / 2, 210 / 2) + 3 x 12 s of start
    assert "About 3 min on 2 renderers and 2 trainers, 36 s of it to start" in text


@pytest.mark.parametrize("trainers", [None, 1])
def test_the_pace_is_measured_with_all_workers_busy(trainers):
    class TwoWorkers:
        workers = 2

        def map(self, function, tasks, *, net=False):
            if net:
                assert function is paces.training_pace
                yield from enumerate([3.0, 4.0][: len(tasks)])
            else:
                assert function is renders.mean_seconds and {work for work, *_ in tasks} == {
                    renders.render_part
                }
                yield from enumerate([expected, 3 * expected][: len(tasks)])

    fidelity = paces._MEASURED
    expected = cost_of(fidelity) - training_cost(fidelity)
    busy = TwoWorkers()
    busy.trainers = trainers
    assert paces.measured_by(busy) == Pace(pytest.approx(2.0), 3.0 if trainers else 3.5)


def test_a_long_job_measures_the_pace_of_the_machine_once(config, monkeypatch, tmp_path, capsys):
    measured = []

    def measure(workers):
        measured.append(workers)
        return Pace(2.0, 3.0)

    monkeypatch.setattr(paces, "cache_file", lambda name: tmp_path / name)
    monkeypatch.setattr(paces, "measured_by", measure)
    kind = paces.kind("processes", "cpu")
    brief, long = (Work("nets", 10, config.final, Cost(n, n)) for n in (1.0, 30.0))
    with session.open(config) as run:
        run.begin([brief])
        assert not measured and paces.read(kind) is None
        run.begin([long])
        assert len(measured) == 1 and paces.read(kind) == Pace(2.0, 3.0)
        # 10 x (2 x 30 + 3 x 30) on one worker, and 36 s of start
        assert run.progress.left == pytest.approx(1536, abs=5)
        run.begin([long])
    assert len(measured) == 1
    out = capsys.readouterr().out
    assert out.count("Measuring how fast this machine is") == 1 and out.count("About 26 min") == 2
    monkeypatch.setenv("XLA_FLAGS", "--slow")  # compiled otherwise, trained at another pace
    assert paces.read(paces.kind("processes", "cpu")) is None
    (tmp_path / f"pace-{kind}.json").write_text('{"render": -1, "train": 1}')
    assert paces.read(kind) is None  # and so is any other content
    for text in ("", "[1, 2]", '{"render": 1}', '{"render": "x", "train": 1}'):
        (tmp_path / f"pace-{kind}.json").write_text(text)
        assert paces.read(kind) is None
