"""The page of results: `page.md` with its numbers and tables, from the recorded reports.

python -m scripts.results.page docs    # write docs/results.md again from docs/results/
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from common import files
from common.files import read_json, write_json
from common.progress import duration
from experiments.evaluation.store import LOGS, read, result_of
from experiments.studies.table import PAPER
from experiments.tables.form import Report, markdown, miou, number, words
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.stats import gain
from scene.version import ENGINE
from scripts.results.claims import FAR, RECORDS, TARGETS, Claims, signed
from scripts.results.parts import HOLDOUT, METHODS, Part

NAME = "results.md"
TEMPLATE = Path(__file__).with_name("page.md")
RENDERS = ("none", "random", "default", "mixed", "learnt")
SEARCHED = ("camvid", f"camvid-{HOLDOUT}", "labelmefacade")
"""Reports of searches by the default method on real images."""
SDR = {
    **{f"paper-{method}": "CamVid, 300 rewards" for method in METHODS},
    "paper-no-relaxation": "CamVid, 300 rewards, no relaxation",
    "paper-no-groups": "CamVid, 300 rewards, one group",
    "paper-squared-reward": "CamVid, 300 rewards, squared",
    "paper-3000-rewards": "CamVid, 3,000 rewards",
    "rivals-labelmefacade": "LabelMeFacade, 200 rewards, 40 attributes",
    "rivals-far": "far twin 0, 228 rewards, 40 attributes",
}
"""Reports of searches that include the paper's method, in the order of the table."""


def record(part: Part, run: Path, commit: str, docs: Path) -> None:
    """Copy the report and plot of a finished part to the pages, and note what made them.

    Args:
        part: the part.
        run: its folder.
        commit: commit of the program.
        docs: folder of the pages; reports and plots go into ``results/``.
    """
    folder = docs / "results"
    folder.mkdir(parents=True, exist_ok=True)
    for suffix in ("json", "png"):
        shutil.copyfile(run / f"{part.study}.{suffix}", folder / f"{part.name}.{suffix}")
    file = folder / RECORDS
    records: dict[str, Report] = read_json(file) if file.exists() else {}
    evaluations = read(run) if any((run / log).exists() for log in LOGS) else {}
    records[part.name] = {
        "command": part.shown,
        "commit": commit,
        "engine": ENGINE,
        "evaluations": len(evaluations),
        "core_seconds": round(sum(result_of(line).seconds for line, _ in evaluations.values())),
    }
    write_json(file, records)


def text(docs: Path) -> str:
    """Write the page from the reports in a folder of pages."""
    claims = Claims(docs / "results")
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    tables = {
        "fit": fit_table(claims),
        "labels": labels_table(claims),
        "streets": streets_table(claims),
        "paper": paper_table(claims),
        "cost": cost_table(claims),
        "published": published_table(claims),
        "index": index(claims),
        "aims": claims.aims(),
    }
    lines = {name: "\n".join(table) for name, table in tables.items()}
    return template.render(
        claims=claims,
        tables=lines,
        reports=claims.reports,
        m=claims.measured,
        signed=signed,
        rivals=METHODS[1:],
        missing=[name for name in SDR if name not in claims.reports],
    )


def origin(claims: Claims, names: Sequence[str], basis: str) -> list[str]:
    """Write the lines below a table: its command, engine and commit, what it rests on, and its cost.

    Args:
        claims: the reports.
        names: the table's reports; the command is that of the first.
        basis: numbers of searches and networks.
    """
    parts = [claims.parts[name] for name in names]
    made_by: dict[int, dict[str, None]] = {}
    for part in parts:
        made_by.setdefault(part["engine"], {})[part["commit"]] = None
    engines = "; ".join(
        f"engine {engine}, commit{'s' * (len(commits) > 1)} {', '.join(commits)}"
        for engine, commits in made_by.items()
    )
    seconds = sum(part["core_seconds"] or 0 for part in parts)
    has_cost = all(part["core_seconds"] for part in parts)
    cost = f" {duration(seconds)} of a core." if has_cost else ""
    return ["", f"{basis} E{engines[1:]}.{cost} `{parts[0]['command']}`"]


def titles(claims: Claims, names: Mapping[str, str]) -> dict[str, str]:
    """Name targets, with engine and size where a table has reports of several.

    Args:
        claims: the reports.
        names: the name of each target's report.
    """
    origins = {
        target: f"engine {claims.parts[name]['engine']}, {claims.reports[name]['scored_at']}"
        for target, name in names.items()
    }
    several = len(set(origins.values())) > 1
    return {name: TARGETS[name] + f" ({origin})" * several for name, origin in origins.items()}


def distinct(values: Iterable[object]) -> str:
    """Write different values as alternatives."""
    *most, last = dict.fromkeys(map(str, values))
    return f"{', '.join(most)} or {last}" if most else last


def fit_table(claims: Claims) -> list[str]:
    """Tabulate what README shows, with the share of all labels."""
    names = [name for name in TARGETS if f"fit-{name}" in claims.reports]
    head = ["tested on", "14 labels", "14 labels + renders", "gain", "renders only", "all labels"]
    lines = [
        f"{line} {claims.share(name, 'both')} % |"
        for name, line in zip(names, claims.what_to_expect(), strict=True)
    ]
    reports = [claims.reports[f"fit-{name}"] for name in names]
    seeds, size, tested = (
        distinct(report[name] for report in reports)
        for name in ("seeds", "scored_at", "test_images")
    )
    basis = f"No search; {seeds} networks a row, at {size}, tested on {tested} images."
    return [
        *markdown([*head, "14 + renders, of all"], []),
        *lines,
        *origin(claims, [f"fit-{name}" for name in names], basis),
    ]


def labels_table(claims: Claims) -> list[str]:
    """Tabulate numbers of labels and kinds of streets, each target by its reports of the newest engine."""
    reports_of = {}
    for target in TARGETS:
        made = [n for n in (f"kinds-{target}", f"labels-{target}") if n in claims.reports]
        newest = max((claims.parts[name]["engine"] for name in made), default=None)
        if names := [name for name in made if claims.parts[name]["engine"] == newest]:
            reports_of[target] = names
    lines = []
    for target, title in titles(claims, {t: names[0] for t, names in reports_of.items()}).items():
        rows = {
            (row["labels"], row["renders"]): row
            for report in reports_of[target]
            for row in claims.reports[report]["rows"]
        }
        for count in sorted({labels for labels, _ in rows}):
            means = [number(rows.get((count, kind), {}).get("mean")) for kind in RENDERS]
            optimised, *others = (
                miou(rows[count, kind]["nets"]) if (count, kind) in rows else None
                for kind in ("learnt", "random", "default")
            )
            over = [
                signed(gain(optimised, other) if optimised and other else None) for other in others
            ]
            lines.append([title, str(count), *means, *over])
    head = ["tested on", "labels", "alone", "+ random", "+ default", "+ half of each"]
    names = [name for reports in reports_of.values() for name in reports]
    seeds, size = (
        distinct(claims.reports[report][name] for report in names)
        for name in ("seeds", "scored_at")
    )
    basis = (
        f"One search for the optimised streets; {seeds} networks a row, at {size}, each with its own "
        "labels, streets and first weights."
    )
    return [
        *markdown([*head, "+ optimised", "optimised over random", "over default"], lines),
        *origin(claims, names, basis),
    ]


def streets_table(claims: Claims) -> list[str]:
    """Tabulate networks on renders alone: random, default, optimised streets, and real images."""
    lines = []
    names = titles(claims, {name: name for name in SEARCHED}) | {FAR: TARGETS[FAR]}
    for name, title in names.items():
        means = {
            row: number(claims.estimate(name, row)["mean"])
            for row in ("random", "default", "intervals", "real")
        }
        if name in claims.reports:
            means_of_searches = [
                number(search["learnt"]) for search in claims.reports[name]["searches"]
            ]
            means["intervals"] += f" ({', '.join(means_of_searches)})"
        over = [claims.gain(name, over=base) for base in ("random", "default")]
        lines.append([title, *means.values(), *over])
    head = ["tested on", "random", "default", "optimised (each search)", "real"]
    reports = [claims.reports[name] for name in SEARCHED]
    searches = distinct(len(report["searches"]) for report in reports)
    rewards = distinct(len(report["searches"][0]["rewards"]) for report in reports)
    seeds, size = (distinct(report[name] for report in reports) for name in ("seeds", "scored_at"))
    far = claims.reports["far-0"]
    basis = (
        f"{searches} searches with {rewards} rewards each, {seeds} networks a row, at {size}; intervals over "
        f"searches and networks. Far twins: five twins of engine {claims.parts['far-0']['engine']} with a "
        f"search of {len(far['searches'][0]['rewards'])} rewards each, {far['seeds']} networks a row, at "
        f"{far['scored_at']}; intervals over twins."
    )
    return [
        *markdown([*head, "over random", "over default"], lines),
        *origin(claims, SEARCHED, basis),
    ]


def paper_table(claims: Claims) -> list[str]:
    """Tabulate the paper's search and those that it compares itself with."""
    names = [name for name in SDR if name in claims.reports]
    lines = []
    for name in names:
        for row in claims.reports[name]["rows"]:
            if row["name"] in METHODS:
                random, default = (
                    claims.gain(name, row["name"], over) for over in ("random", "default")
                )
                size = claims.reports[name]["scored_at"]
                method = [SDR[name], size, words(row["name"]), str(row["searches"])]
                lines.append([*method, number(row["mean"]), random, default])
    networks = distinct(claims.reports[name]["seeds"] for name in names)
    basis = f"{networks} networks a row; intervals over searches and networks."
    head = ["search", "at", "method", "searches", "mIoU", "over random", "over default"]
    return [*markdown(head, lines), *origin(claims, names, basis)]


def cost_table(claims: Claims) -> list[str]:
    """Tabulate minutes on two cores and minutes of a core."""
    measured, lines = claims.measured, []
    demo, fit = measured["demo"], measured["fit"]
    lines.append(["`make demo`", number(demo["minutes"], ".0f"), number(demo["core_minutes"])])
    for name, run in fit.items():
        for labels, minutes in ((14, run["minutes"]), (100, run["minutes with 100 labels"])):
            title = f"`fit`, {labels} labels of {TARGETS[name]}"
            lines.append([title, number(minutes, ".0f"), ""])
    search = [
        entry["core_seconds"] / 60
        for name in SEARCHED
        for entry in claims.reports[name]["searches"]
    ]
    rewards = distinct(len(claims.reports[name]["searches"][0]["rewards"]) for name in SEARCHED)
    low, high = (number(value, ".0f") for value in (min(search), max(search)))
    lines.append([f"a search with {rewards} rewards", "", f"{low} to {high}"])
    for name in TARGETS:
        part = claims.parts.get(f"labels-{name}")
        if part and part["core_seconds"]:
            title = f"table of labels, {TARGETS[name]}: {part['evaluations']} networks"
            lines.append([title, "", number(part["core_seconds"] / 60, ".0f")])
    making = measured["make results"]
    stored = making["from the store"]
    lines.append(["`make results`, as planned", "", f"{making['core_hours']:.0f} hours"])
    minutes = number(stored["minutes"], ".0f"), number(stored["core_minutes"])
    lines.append(["`make results` from the committed store", *minutes])
    return markdown(["what", "minutes on two cores", "minutes of a core"], lines)


def published_table(claims: Claims) -> list[str]:
    """Tabulate what others report on CamVid's test images."""
    lines = []
    for name, (images, *values) in PAPER["camvid"].items():
        title = name.upper() if name in ("gta5", "synthia") else f"SceneX, {TRAINED_ON[name]}"
        lines.append([title, f"{images:,}", "FCN8s, DeepLabv2", ", ".join(map(number, values))])
    for entry in claims.measured["published"]:
        lines.append(
            [entry["trained on"], str(entry["images"]), entry["network"], number(entry["miou"])]
        )
    return markdown(["trained on", "images", "networks", "mIoU"], lines)


def index(claims: Claims) -> list[str]:
    """List the reports of every study."""
    by_study: dict[str, list[str]] = {}
    for name, report in claims.reports.items():
        by_study.setdefault(report["study"], []).append(f"[{name}](results/{name}.json)")
    return [f"- `{study}`: {', '.join(links)}" for study, links in sorted(by_study.items())]


def write(docs: Path) -> None:
    """Write the page into a folder of pages, from the reports in it."""
    files.write(docs / NAME, text(docs))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
