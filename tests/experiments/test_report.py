"""The page of a run: one file that loads nothing, whose figures are those of summary.json."""

import io
import json
import re
import shutil
from base64 import b64decode
from html.parser import HTMLParser

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image

from experiments.evaluation.predictions import file_of, load
from experiments.main.summary import ROWS
from experiments.report.__main__ import main
from experiments.report.figures import NAMES
from scene.attributes import NAMES as ATTRIBUTES
from scene.proposal import Histogram, describe, mixture, random_proposal
from seg.metrics import iou
from shell.files import read_json, write_json

from .conftest import lines


class Page(HTMLParser):
    """What a browser would find in a page."""

    def __init__(self, path) -> None:
        super().__init__()
        self.tags, self.texts, self.rows, self.plots = [("", {})], [], [], []
        self.cell = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.cell = True

    def handle_endtag(self, tag):
        self.cell = self.cell and tag not in ("td", "th")

    def handle_data(self, data):
        tag, attributes = self.tags[-1]
        if not data.strip():
            return
        if attributes.get("type") == "application/json":
            self.plots.append(json.loads(data))
        elif tag not in ("script", "style"):
            self.texts.append(data)
            if self.cell:
                self.rows[-1][-1] += data

    @property
    def text(self) -> str:
        return " ".join(self.texts)


@pytest.fixture
def run(unbroken, tmp_path):
    """A copy of the folder of a whole tiny run."""
    return shutil.copytree(unbroken[0], tmp_path / "run", ignore=lambda *_: ["dataset", "shared"])


def test_the_page_is_one_file_that_loads_nothing_and_its_pictures_decode(run):
    page = Page(run / "report.html")
    (policy,) = (a["content"] for _, a in page.tags if "Content" in a.get("http-equiv", ""))
    assert policy.startswith("default-src 'none'") and "http" not in policy
    named = [a.get(k) for t, a in page.tags for k in ("src", "href", "data", "srcset") if a.get(k)]
    assert all(name.startswith(("data:image/", "#")) for name in named)
    assert not [t for t, _ in page.tags if t in ("link", "iframe", "object", "embed", "base")]
    shown = [b64decode(name.partition(",")[2]) for name in named if name.startswith("data:")]
    assert len(shown) == 4 * 6 * 2 + 6 * (2 + 4)  # streets with labels; worst images, predictions
    assert {Image.open(io.BytesIO(data)).size for data in shown} == {(64, 32)}
    style = (run / "report.html").read_text().split("<style>")[1].split("</style>")[0]
    assert "url(" not in style and "@import" not in style


def test_the_figures_are_those_of_the_summary(run):
    summary, page = read_json(run / "summary.json"), Page(run / "report.html")
    assert "not a result on real data" in page.text and "experiments.cityscapes" in page.text
    for row in ROWS:
        entry = summary["rows"][row]
        said = [f"{entry['mean']:.1f}", "{:.1f} to {:.1f}".format(*entry["ci95"])]
        assert any(cells[1:] == said for cells in page.rows)
        means = [t["x"] for t in page.plots[0]["data"] if t["y"] == [NAMES[row]]]
        assert means == [[entry["mean"]]]
    (score,) = summary["candidates"]["argmax"]
    by_part = summary["candidate_parts"]["argmax"]
    told = ["argmax ← answer", f"{score:.1f}", "", *(f"{own:.1f}" for own in by_part)]
    assert told in page.rows and len(by_part) == len(summary["parts"]) >= 2
    assert summary["selection"]["verdict"][1:] in page.text
    traces = (trace for plot in page.plots for trace in plot.get("data", ()))
    (rewards,) = (trace["y"] for trace in traces if trace.get("name") == "reward")
    logged = [100 * line["reward"] for line in lines(run / "evaluations.jsonl")]
    assert rewards == pytest.approx(logged)
    for plot in page.plots:  # the library knows all that they ask for, but colours of the page
        for view in plot.get("views", [plot]):
            plain = json.loads(re.sub(r'"@[\w/.]+"', '"#123456"', json.dumps(view)))
            go.Figure(data=plain["data"], layout=plain["layout"])


def test_confusions_and_predictions_are_those_of_the_nets_that_were_scored(run):
    summary, seen = (read_json(run / name) for name in ("summary.json", "pictures/seen.json"))
    finals = [line for line in lines(run / "finals.jsonl") if line["nets"] == "final"]
    found = {line["key"]: load(file_of(run, line["key"])) for line in finals}
    for line in finals:
        wanted = [np.nan if v is None else v for v in line["class_iou"]]
        np.testing.assert_allclose(iou(found[line["key"]].confusion), wanted)
        assert (found[line["key"]].predictions is None) == (line["seed"] != 0)
    for row in ROWS:
        total = sum(found[line["key"]].confusion for line in finals if line["row"] == row)
        assert seen["confusion"][row] == {"nets": 2, "pixels": total.tolist()}
    first = found[next(f["key"] for f in finals if (f["row"], f["seed"]) == ("learnt", 0))]
    told = [image["predictions"]["learnt"]["miou"] for image in seen["worst"]["images"]]
    assert told == pytest.approx(sorted(100 * first.miou)[:6], abs=0.01)
    assert seen["worst"]["of"] == summary["test_images"] == 8


def test_a_page_is_made_anew_from_the_folder_and_of_an_older_run_without_what_it_lacks(run, capsys):
    page = run / "report.html"
    before = page.read_bytes()
    page.unlink()
    assert main([str(run)]) == 0 and capsys.readouterr().out == f"{page}\n"
    assert page.read_bytes() == before
    for name in ("nets", "pictures"):
        shutil.rmtree(run / name)
    kept = read_json(run / "summary.json")
    for name in ("selection", "candidate_parts"):
        del kept[name]
    write_json(run / "summary.json", {**kept, "candidates": {"spread": [[20.0, 30.0]]}})
    assert main([str(run), "--out", str(run / "old.html")]) == 0
    old = Page(run / "old.html")
    assert "Model selection:" not in old.text
    assert "left no confusion matrices" in old.text and "No predictions" in old.text
    assert "Centres of what the search proposed" in old.text
    assert not [t for t, _ in old.tags if t == "img"] and len(old.plots) >= 5


def test_a_few_labels_come_first_and_what_it_is_told_is_escaped(run):
    summary = read_json(run / "summary.json")
    own = {f"few+{row}": summary["nets"][row] for row in ("random", "default", "learnt")}
    summary["nets"] = {**summary["nets"], "few": summary["nets"]["random"], **own}
    write_json(run / "summary.json", summary | {
        "few_images": ["a", "b"], "few_share": 0.5, "note": "<script>alert(1)</script>",
    })  # fmt: skip
    assert main([str(run)]) == 0
    page = Page(run / "report.html")
    assert page.plots[0]["data"][-1]["y"] == ["few labels"]  # the last is drawn at the top
    assert "beside 2 labelled images" in page.text
    assert "<script>alert" not in (run / "report.html").read_text()


def test_probabilities_are_shown_as_densities(run):
    def bars():
        assert main([str(run)]) == 0
        tags = [attributes for name, attributes in Page(run / "report.html").tags if name == "i"]
        return [a["style"] for a in tags if a.get("class") == "bin"]

    assert not bars()
    summary, shares = read_json(run / "summary.json"), np.float32([0.5, 0, 0.25, 0.25])
    own = Histogram(np.tile(shares, (len(ATTRIBUTES), 1)))
    write_json(run / "summary.json", summary | describe(own))
    one = [f"left:{left}%;width:25.0%;height:{height}%" for left, height in (
        ("0.0", 100), ("50.0", 50), ("75.0", 50))]  # fmt: skip
    assert bars() == one * len(ATTRIBUTES)
    page = Page(run / "report.html")
    assert (
        "from these densities; from – to is the interval with their mean and variance" in page.text
    )
    mixed = mixture((0.5, 0.5), (own, random_proposal()))  # twice and once as dense
    write_json(run / "summary.json", summary | describe(mixed))
    assert bars() == [*one, "left:0.0%;width:100.0%;height:50%"] * len(ATTRIBUTES)
    shown = Page(run / "report.html")
    assert [told for told in shown.texts if told.startswith("learnt, ")] == [
        "learnt, 50 % of streets"
    ] * 2
    looks = [a.get("class") for name, a in shown.tags if name == "span" and a.get("class")]
    assert looks == ["track tall", "learnt area", "learnt step"] * len(ATTRIBUTES)


def test_the_rewards_of_a_search_by_pools_are_of_subsets_of_streets(run):
    config = read_json(run / "config.json")
    for method, told in (
        ("pool", "a subset of its round's streets"),
        ("sdr", "a dataset of its own"),
    ):
        config["search"]["method"] = method
        write_json(run / "config.json", config)
        assert main([str(run)]) == 0
        assert (
            f"rewards of {method}, each of a fresh net on {told}." in Page(run / "report.html").text
        )


@pytest.mark.parametrize(("left", "complaint"), [
    (None, "no such folder; name the --out of a run"),
    ({}, "it holds no config.json"),
    ({"config.json": {}}, "that run is not at its end"),
    ({"config.json": {}, "labels.json": {"study": "labels"}}, "a run of the study labels, whose report"),
    ({"config.json": [], "summary.json": {}}, "config.json is no JSON object"),
    ({"config.json": {"version": 2}, "summary.json": {}}, "config.json has version 2, and this program"),
    ({"config.json": {}, "summary.json": {"nets": 3}}, "does not hold what a run writes"),
])  # fmt: skip
def test_a_folder_that_is_no_finished_run_is_refused(left, complaint, tmp_path, error_line):
    folder = tmp_path / "folder"
    if left is not None:
        folder.mkdir()
        for name, value in left.items():
            write_json(folder / name, value)
    assert main([str(folder)]) == 2
    said = error_line()
    assert str(folder) in said and complaint in said
    assert left is None or not (folder / "report.html").exists()


@pytest.mark.parametrize("flags", [["other"], ["--tensorboard", "events"], ["--tensorboard="]])
def test_what_the_page_no_longer_does_is_one_line_that_says_what_replaces_it(
    flags, tmp_path, error_line
):
    assert main([str(tmp_path), *flags]) == 2
    said = error_line()
    assert "evaluations.jsonl and finals.jsonl in each run hold every evaluation" in said
    assert flags[0].rstrip("=") in said and not [*tmp_path.iterdir()]
