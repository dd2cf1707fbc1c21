"""The page of a run: one file that loads nothing, whose figures are those of summary.json."""

import io
import json
import re
import shlex
import shutil
import socket
import subprocess
import sys
from base64 import b64decode, b64encode
from http.client import HTTPConnection

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image

from common.files import read_json, write_json
from experiments.app.report import page
from experiments.app.report.command import main
from experiments.app.report.folder import RunFolder, read
from experiments.app.report.result import on_page
from experiments.app.report.summary import KIND, ROWS, verdict
from experiments.evaluation.predictions import file_of, load
from experiments.tables.form import interval
from experiments.tables.row_names import SHORT
from experiments.tables.stats import TOO_FEW
from scene import parsers
from seg.metrics import iou

from .conftest import Page, lines


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
    assert len(shown) == 4 * 6 * 2 + 6 * (2 + 4)  # streets with labels; test images, predictions
    assert {Image.open(io.BytesIO(data)).size for data in shown} == {(64, 32)}
    style = (run / "report.html").read_text().split("<style>")[1].split("</style>")[0]
    assert "url(" not in style and "@import" not in style


def test_only_pictures_of_the_run_are_shown(run):
    secret = run.with_name("secret.png")
    Image.new("RGB", (64, 32), (250, 3, 7)).save(secret)
    data = b64encode(secret.read_bytes()).decode()
    index = read_json(run / "pictures/seen.json")
    images = [image for shown in index["streets"].values() for image in shown]
    (run / "pictures/link.png").symlink_to(secret)
    (run / "pictures/text.txt").write_text("a secret text")
    names = (str(secret), "../../secret.png", "link.png", "text.txt", "../config.json")
    for image, name in zip(images, names, strict=False):
        image["image"] = name
    write_json(run / "pictures/seen.json", index)
    assert main([str(run)]) == 0
    text = (run / "report.html").read_text()
    assert data not in text and b64encode(b"a secret text").decode() not in text
    assert b64encode((run / "config.json").read_bytes()).decode() not in text


def test_the_figures_are_those_of_the_summary(run):
    summary, page = read_json(run / "summary.json"), Page(run / "report.html")
    assert "do not carry over to real data" in page.text and "sdr-jax cityscapes" in page.text
    for row in ROWS:
        entry = summary["rows"][row]
        cells_shown = [f"{entry['mean']:.1f}", interval(entry["ci95"]) or TOO_FEW]
        assert any(cells[1:] == cells_shown for cells in page.rows)
        means = [t["x"] for t in page.plots[0]["data"] if t["y"] == [SHORT[row]]]
        assert means == [[entry["mean"]]]
    for gain in summary["gains"]["learnt"].values():
        cells_shown = [f"{gain['mean']:+.1f}", interval(gain["ci95"]) or TOO_FEW]
        assert any(cells[1:] == cells_shown for cells in page.rows)
    assert verdict(summary) in page.texts
    assert "small marks single networks" in page.text
    traces = (trace for plot in page.plots for trace in plot.get("data", ()))
    (rewards,) = (trace["y"] for trace in traces if trace.get("name") == "reward")
    logged = sorted(
        (line["update"], line["dataset"], 100 * line["reward"])
        for line in lines(run / "evaluations.jsonl")
    )
    assert rewards == pytest.approx([reward for *_, reward in logged])
    for plot in page.plots:  # the library knows all that they ask for, but colours of the page
        for view in plot.get("views", [plot]):
            figure = json.loads(re.sub(r'"@[\w/.]+"', '"#123456"', json.dumps(view)))
            go.Figure(data=figure["data"], layout=figure["layout"])


def test_rewards_are_in_the_order_of_the_search_whichever_worker_finishes_first(run):
    log = run / "evaluations.jsonl"
    expected = read(run).rewards
    first, *others = log.read_text().splitlines(keepends=True)
    log.write_text("".join([*others, first]))
    np.testing.assert_array_equal(read(run).rewards, expected)


def test_confusions_and_predictions_are_those_of_the_nets_that_were_scored(run):
    summary, index = (read_json(run / name) for name in ("summary.json", "pictures/seen.json"))
    finals = [line for line in lines(run / "finals.jsonl") if line["nets"] == "final"]
    predictions = {line["key"]: load(file_of(run, line["key"])) for line in finals}
    for line in finals:
        expected = [np.nan if v is None else v for v in line["class_iou"]]
        np.testing.assert_allclose(iou(predictions[line["key"]].confusion), expected)
        assert (predictions[line["key"]].predictions is None) == (line["seed"] != 0)
    for row in ROWS:
        total = sum(predictions[line["key"]].confusion for line in finals if line["row"] == row)
        assert index["confusion"][row] == {"nets": 2, "pixels": total.tolist()}
    first = predictions[next(f["key"] for f in finals if (f["row"], f["seed"]) == ("learnt", 0))]
    shown = [image["predictions"]["learnt"]["miou"] for image in index["tested"]["images"]]
    ranked = sorted(100 * first.miou, reverse=True)
    assert shown == pytest.approx([ranked[k] for k in (0, 1, 2, 4, 5, 7)], abs=0.01)
    assert index["tested"]["of"] == summary["test_images"] == 8


def test_a_page_is_made_anew_from_the_folder_and_of_an_older_run_without_what_it_lacks(run, capsys):
    page = run / "report.html"
    before = page.read_bytes()
    page.unlink()
    assert main([str(run)]) == 0 and capsys.readouterr().out == f"{page}\n"
    assert page.read_bytes() == before
    for name in ("nets", "pictures"):
        shutil.rmtree(run / name)
    summary = read_json(run / "summary.json")
    chosen = {
        "chosen_candidate": "seen",
        "candidates": {"seen": [20.0, 30.0]},
    }  # by model selection
    rows, gains = summary["rows"], summary.pop("gains")
    earlier_keys = {  # of versions before `gains`
        **{row: rows[row] for row in ("random", "default", "learnt")},
        "gain": gains["learnt"]["random"],
        "gain_over_default": gains["learnt"]["default"],
        "searches": [{"seed": 0, "learnt": rows["learnt"]["mean"]}],
    }
    write_json(run / "summary.json", summary | chosen | earlier_keys)
    assert main([str(run), "--out", str(run / "old.html")]) == 0
    old = Page(run / "old.html")
    assert "Confusion:" not in old.text and verdict({**summary, "gains": gains}) in old.texts
    assert "Centre of each proposed interval" in old.text
    titles = [a["id"] for t, a in old.tags if t == "section"]
    sections = ["result", "search", "attributes", "classes", "cost", "made"]  # none is empty
    assert [title for title in titles if title != "importance"] == sections
    assert [a["href"] for t, a in old.tags if t == "a"] == [f"#{name}" for name in titles]
    assert not [t for t, _ in old.tags if t == "img"] and len(old.plots) >= 5


def test_a_few_labels_come_first_and_what_it_is_told_is_escaped(run):
    summary = read_json(run / "summary.json")
    with_few = {f"few+{row}": summary["nets"][row] for row in ("random", "default", "learnt")}
    summary["nets"] = {**summary["nets"], "few": summary["nets"]["random"], **with_few}
    write_json(run / "summary.json", summary | {
        "few_images": ["a", "b"], "few_share": 0.5, "note": "<script>alert(1)</script>",
    })  # fmt: skip
    assert main([str(run)]) == 0
    page = Page(run / "report.html")
    assert page.plots[0]["data"][-1]["y"] == ["labels"]  # the last is drawn at the top
    assert any(text.startswith("With 2 labelled images, optimised ") for text in page.texts)
    names = [cells[0] for cells in page.rows]
    assert names[1] == "2 labelled images alone" and "random streets" in names[5:9]
    for other in ("alone", "+ default streets", "+ random streets"):
        gain = f"2 labelled images + optimised streets over 2 labelled images {other}"
        assert gain in names and gain in page.texts
    assert "<script>alert" not in (run / "report.html").read_text()


@pytest.mark.parametrize(("file", "changes"), [
    ("summary.json", {"note": None}), ("summary.json", {"starts": 3}),
    ("config.json", {"space": "x"}), ("pictures/seen.json", {"tested": [3]}),
])  # fmt: skip
def test_a_changed_file_of_a_run_is_refused_and_the_page_stays(file, changes, run, error_line):
    before = (run / "report.html").read_bytes()
    write_json(run / file, read_json(run / file) | changes)
    assert main([str(run)]) == 2
    assert "has a file that this version did not write" in error_line(begun=True)
    assert (run / "report.html").read_bytes() == before


def test_an_array_that_is_none_is_left_out(run):
    (run / "pictures" / "probabilities.npy").write_bytes(b"PK\3\4no array")
    assert main([str(run)]) == 0


def gain(mean, *ci95):
    return {"mean": mean, "ci95": [*ci95] or None}


def row(mean):
    return {"mean": mean, "ci95": None}


@pytest.mark.parametrize(("changes", "cards"), [
    ({}, [("30.0", "% mIoU", "optimised streets"), ("60.0", "% mIoU", "labelled target images"),
          ("+3.0", "points", "optimised streets over default streets"),
          ("+0.4", "points", "optimised streets over random streets")]),
    ({"few_images": ["a"] * 14, "reward_images": 86,
      "rows": {"learnt": row(30.0), "few+learnt": row(40.0)},
      "gains": {"few+learnt": {"few": gain(1.0, 0.5, 1.5), "few+default": gain(None)}}},
     [("40.0", "% mIoU", "14 labelled images + optimised streets"),
      ("+1.0", "points", "14 labelled images + optimised streets over 14 labelled images alone"),
      ("", "points", "14 labelled images + optimised streets over 14 labelled images + default streets")]),
    ({"rows": {"learnt": row(None)}, "gains": {}}, [("", "% mIoU", "optimised streets")]),
])  # fmt: skip
def test_the_page_shows_the_main_scores_and_gains_first(changes, cards):
    report = {
        "nets": {}, "classes": [], "rows": {"learnt": row(30.0), "real": row(60.0)},
        "gains": {"learnt": {"default": gain(3.0, 1.0, 5.0), "random": gain(0.4, -1.0, 1.8)}},
    }  # fmt: skip
    kind = KIND._replace(verdict=lambda report: "", note=lambda report: "")
    assert [card[:3] for card in on_page(kind, report | changes, [])["cards"]] == cards


def test_the_next_commands_are_ones_that_there_are(run, capsys):
    summary, config = read_json(run / "summary.json"), read_json(run / "config.json")
    write_json(run / "config.json", config | {"out": str(run)})
    assert main([str(run)]) == 0
    flags = shlex.join(["--attributes", str(run / "attributes.json"), "--images", "1000"])
    texts = Page(run / "report.html").texts
    (command,) = (text for text in texts if text.startswith("sdr-jax render"))
    assert command == f"sdr-jax render {flags} --out {run / 'streets'}" and not summary["real"]
    assert parsers.render().parse_args(shlex.split(command)[2:]).images == 1000
    assert "sdr-jax doctor DATA" in texts


def test_the_page_of_a_run_under_way_has_what_is_known_and_is_read_anew(run):
    whole = read(run)
    first_fields = {
        key: whole.summary[key]
        for key in (
            "note",
            "real",
            "target",
            "preset",
            "reward_images",
            "test_images",
            "seeds",
            "scored_at",
            "starts",
        )
    }
    early = RunFolder(
        run, first_fields, whole.config, whole.evaluations[:5], [], None, None, None, None
    )
    for folder, sections in (
        (early._replace(evaluations=[]), ["made"]),
        (early, ["search", "cost", "made"]),
        (early._replace(finals=whole.finals), ["so_far", "search", "cost", "made"]),
    ):
        (run / "live.html").write_text(
            page.under_way(folder, page.Status(0.25, "search: update 2/6"))
        )
        shown = Page(run / "live.html")
        assert [a["id"] for t, a in shown.tags if t == "section"] == sections
        assert (
            "This run is not finished yet" in shown.text
            and "25 %: search: update 2/6." in shown.text
        )
        (refresh,) = (a for t, a in shown.tags if a.get("http-equiv") == "refresh")
        assert refresh["content"] == str(page.EVERY)
    assert ["final networks: random", "2"] in [row[:2] for row in shown.rows]


def test_the_page_is_served_to_this_machine_alone_as_it_is_at_the_moment(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (tmp_path / "config.json").write_text("{}")
    command = [sys.executable, "-m", "experiments", "report", str(tmp_path), "--serve", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout.readline() == f"http://127.0.0.1:{port} (press Ctrl-C to stop)\n"

            def get(path="/", **headers):
                connection = HTTPConnection("127.0.0.1", port)
                connection.request("GET", path, headers=headers)
                answer = connection.getresponse()
                return answer.status, answer.read().decode()

            assert get()[0] == 200 and "no report.html yet" in get()[1]
            (tmp_path / "report.html").write_text("so far")
            assert get() == (200, "so far")
            assert get("/config.json")[0] == 404
            assert get(host="elsewhere.example")[0] == 400
            assert get(origin="http://elsewhere.example")[0] == 403
        finally:
            server.terminate()


@pytest.mark.parametrize(("flags", "complaint"), [
    (["RUN", "--serve", "0"], "--serve must lie in 1..65535, not 0"),
    (["RUN", "--serve"], "is not the folder of a run: it has no config.json"),
    (["RUN/none", "--serve"], "does not exist; pass the --out folder of a run"),
    (["/dev/null", "--serve"], "/dev/null is a file; pass the --out folder of a run"),
    (["RUN", "--serve", "--out", "page.html"], "cannot be used with --out page.html"),
])  # fmt: skip
def test_what_cannot_be_served_is_refused(flags, complaint, tmp_path, error_line):
    assert main([flag.replace("RUN", str(tmp_path)) for flag in flags]) == 2
    assert complaint in error_line() and not [*tmp_path.iterdir()]


@pytest.mark.parametrize(("files", "complaint"), [
    (None, "does not exist; pass the --out folder of a run"),
    ({}, "is not the folder of a run: it has no config.json"),
    ({"config.json": {}}, "the run is not finished; run its command again"),
    ({"config.json": {}, "labels.json": {"study": "labels"}}, "a run of the study labels; read its report"),
    ({"config.json": [], "summary.json": {}}, "config.json is not a JSON object"),
    ({"config.json": {"version": 2}, "summary.json": {}}, "config.json has version 2, but this program"),
    ({"config.json": {}, "summary.json": {"nets": 3}}, "is not the result of a run"),
])  # fmt: skip
def test_a_folder_that_is_no_finished_run_is_refused(files, complaint, tmp_path, error_line):
    folder = tmp_path / "folder"
    if files is not None:
        folder.mkdir()
        for name, value in files.items():
            write_json(folder / name, value)
    assert main([str(folder)]) == 2
    message = error_line()
    assert str(folder) in message and complaint in message
    assert files is None or not (folder / "report.html").exists()
