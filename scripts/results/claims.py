"""Numbers that README and the page of results state, computed from the recorded reports.

    claims = Claims(Path("docs/results"))
    claims.gain("camvid", over="default")  # "+2.3 (-0.4 to 5.1)"
    claims.what_to_expect()                # the rows of README's table

The page (`page.md`) calls these in its sentences, so that no number on it is typed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from common.files import read_json
from experiments.studies.search_columns import thirds
from experiments.tables.form import Report, interval, markdown, miou, number, open_interval, words
from experiments.tables.stats import estimated, gain, mean, welch
from scripts.results.parts import HOLDOUT

RECORDS = "parts.json"
"""File in the folder of reports: the command, commit, engine and cost of each of them."""
MEASURED = "measured.json"
"""File in that folder: what no study reports, such as minutes."""
FAR = "far"
"""The mean over far twins, where a target is named."""
TARGETS = {
    f"camvid-{HOLDOUT}": f"CamVid {HOLDOUT}",
    "labelmefacade": "LabelMeFacade",
    "camvid": "CamVid test images",
    FAR: "far twins",
}
"""Targets as the page names them."""
EXPECTED = {
    f"camvid-{HOLDOUT}": f"CamVid ({{}} labels, tested on sequence {HOLDOUT})",
    "labelmefacade": "LabelMeFacade ({} labels, photos by pedestrians)",
    "camvid": "CamVid ({} labels, its test images)",
}
"""Targets as README names them, with the number of all labels."""


class Claims:
    """All claims of a folder of reports."""

    def __init__(self, folder: Path) -> None:
        self.parts: dict[str, Report] = read_json(folder / RECORDS)
        self.measured: Report = read_json(folder / MEASURED)
        self.reports: dict[str, Report] = {
            name: read_json(folder / f"{name}.json") for name in self.parts
        }

    def row(self, report: str, /, **place: Any) -> Report:
        """Return the row of a report with some fields."""
        for row in self.reports[report]["rows"]:
            if all(row.get(name) == value for name, value in place.items()):
                return row  # type: ignore[no-any-return]
        raise LookupError(f"{report}.json has no row {place}")

    def miou(self, report: str, /, **place: Any) -> str:
        """Write the mIoU of a row."""
        return number(self.row(report, **place)["mean"])

    def estimate(self, target: str, row: str = "intervals", field: str | None = None) -> Report:
        """Return a row of searches or one of its gains; for far or near twins, the mean over them."""
        if target in self.reports:
            entry = self.row(target, name=row)
            return entry[field] if field else entry
        twins = [name for name in self.reports if name.rpartition("-")[0] == target]
        return estimated([self.estimate(name, row, field)["mean"] for name in twins])

    def gain(self, target: str, method: str = "intervals", over: str = "random") -> str:
        """Write the gain of streets that a search method has optimised over others."""
        return signed(self.estimate(target, method, f"gain_over_{over}"))

    def engines(self, *parts: str) -> str:
        """Write the engines of some parts: "engine 9", or "engines 9 and 7" in the order of the parts."""
        numbers = dict.fromkeys(str(self.parts[part]["engine"]) for part in parts)
        return f"engine{'s' * (len(numbers) > 1)} {' and '.join(numbers)}"

    def above_default(self, *targets: str) -> str:
        """Write how many searches of some targets train better networks than default streets."""
        above = [
            search["learnt"] > self.row(target, name="default")["mean"]
            for target in targets
            for search in self.reports[target]["searches"]
        ]
        return f"{sum(above)} of {len(above)}"

    def verdict(self, report: str, method: str) -> str:
        """Say whether streets of a search method are better than random ones."""
        low, high = self.row(report, name=method)["gain_over_random"]["ci95"]
        if low > 0:
            return "better than"
        return "worse than" if high < 0 else "within noise of"

    def significant(self, over: str) -> str:
        """Name the targets on which the gain of optimised streets is significant, and the others."""
        better: dict[bool, list[str]] = {True: [], False: []}
        for target, name in TARGETS.items():
            entry = self.estimate(target, field=f"gain_over_{over}")
            better[entry["ci95"][0] > 0].append(name)
        yes, no = (" and ".join(better[found]).replace(" and ", ", ", len(better[found]) - 2)
                   for found in (True, False))  # fmt: skip
        return f"on {yes}, not on {no}" if yes and no else f"on {yes}" if yes else "on no target"

    def lead(self, name: str, over: str) -> str:
        """Write the lead of one of the paper's methods or variants, with Welch's test over searches."""

        def of(part: str) -> list[float]:
            searches = self.reports[f"paper-{part}"]["searches"]
            by_method = [search for search in searches if search["method"] == part]
            return [search["learnt"] for search in by_method or searches]  # all of a variant

        ours, theirs = of(name), of(over)
        test = welch(ours, theirs)
        return "" if test is None else f"{test.difference:+.1f} (p = {test.p_value:.2f})"

    def rewards(self, report: str) -> tuple[str, str]:
        """Write the mean rewards of the first and of the last third of a report's searches."""
        first, last = zip(
            *(thirds(search["rewards"]) for search in self.reports[report]["searches"]),
            strict=True,
        )
        return number(mean(first)), number(mean(last))

    def fit_row(self, target: str, trained_on: str) -> Report:
        """Return the row of networks trained as `fit` does: labels, both, renders, all or all+renders."""
        name = f"fit-{target}"
        every = self.reports[name]["reward_images"]
        labels, renders = {
            "labels": (14, "none"), "both": (14, "mixed"),
            "renders": (0, "mixed"), "all": (every, "none"), "all+renders": (every, "mixed"),
        }[trained_on]  # fmt: skip
        return self.row(name, labels=labels, renders=renders)

    def kind_gain(self, target: str, labels: int, streets: str, over: str) -> Report:
        """Compare two kinds of streets, rendered for so many labels: a gain with its interval."""
        nets = [
            self.row(f"kinds-{target}", labels=labels, renders=kind)["nets"]
            for kind in (streets, over)
        ]
        return gain(*map(miou, nets)) or {}

    def share(self, target: str, trained_on: str) -> str:
        """Write the mIoU of such networks in percent of that with all labels."""
        return number(self.fit_row(target, trained_on)["of_all"], ".1f")

    def worth(self, target: str, labels: int) -> str:
        """Write how many labels alone reach the mIoU of so many labels plus renders."""
        for entry in self.reports[f"labels-{target}"]["worth"]:
            if entry["beside"] == labels:
                count = f"{entry['bound']} {entry['labels']:.0f}".lstrip()
                return f"{count} (interval {open_interval(*entry['ci95'])})"
        raise LookupError(f"labels-{target}.json does not say what {labels} labels are worth")

    def what_to_expect(self) -> list[str]:
        """Write the rows of README's table."""
        lines = []
        for target, name in EXPECTED.items():
            if f"fit-{target}" in self.reports:
                rows = {
                    key: self.fit_row(target, key) for key in ("labels", "both", "renders", "all")
                }
                labels, both, renders, every = (number(row["mean"]) for row in rows.values())
                gain = signed(rows["both"]["renders_add"])
                title = name.format(rows["all"]["labels"])
                lines.append(f"| {title} | {labels} | **{both}** | {gain} | {renders} | {every} |")
        return lines

    def example(self) -> str:
        """Write what the report of `fit` with 14 labels of CamVid begins with."""
        run = self.measured["fit"][f"camvid-{HOLDOUT}"]
        mean, ci95 = run["gain"]["mean"], interval(run["gain"]["ci95"])
        return f"Renders add {mean:.1f} points ({ci95}) to your {run['labels']} labels."

    def selection(self) -> str:
        """Write what model selection gained over the methods' own solutions."""
        return signed(estimated(self.measured["model selection"]["gains"]))

    def attributes(self, count: int) -> list[str]:
        """Write the attributes that matter most, with their share of the signal."""
        entries = self.reports["sensitivity"]["attributes"]
        most = sorted(entries, key=lambda entry: -entry["share"]["value"])[:count]
        shares = [(words(entry["name"]), entry["share"]) for entry in most]
        return [
            f"{name} {share['value']:.0f} % ({interval(share['ci95'], '.0f')})"
            for name, share in shares
        ]

    def aims(self) -> list[str]:
        """Tabulate the aims of these results on every target, as met or missed."""

        def share(target: str, trained_on: str, least: float) -> str:
            if f"fit-{target}" not in self.reports:
                return ""
            share = self.fit_row(target, trained_on)["of_all"]
            return _judged(f"{share:.1f} %", share >= least)

        def gain(target: str, over: str, least: float) -> str:
            entry = self.estimate(target, field=f"gain_over_{over}")
            return _judged(signed(entry), entry["mean"] >= least and entry["ci95"][0] > 0)

        def width(target: str) -> str:
            entry = self.estimate(target, field="gain_over_random")
            width = entry["ci95"][1] - entry["ci95"][0]
            return _judged(f"{width:.1f}", width < entry["mean"])

        rows = {
            "14 labels + renders: 95 % of all labels": lambda name: share(name, "both", 95),
            "renders alone: 85 % of all labels": lambda name: share(name, "renders", 85),
            "optimised over random: +5, interval above 0": lambda name: gain(name, "random", 5),
            "optimised over default: +4, interval above 0": lambda name: gain(name, "default", 4),
            "interval over random narrower than the gain": width,
        }
        lines = [[aim, *(cell(name) for name in TARGETS)] for aim, cell in rows.items()]
        return markdown(["aim", *TARGETS.values()], lines)


def signed(entry: Report | None) -> str:
    """Write a gain with its interval in brackets."""
    if entry is None or entry["mean"] is None:
        return ""
    return f"{entry['mean']:+.1f}" + (f" ({interval(entry['ci95'])})" if entry["ci95"] else "")


def _judged(value: str, met: bool) -> str:
    return f"{value} **{'met' if met else 'missed'}**"
