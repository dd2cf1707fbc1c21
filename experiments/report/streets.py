"""The learnt attributes, streets drawn from them, and the test images that nets are worst on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from experiments.main.pictures import PICTURES
from experiments.report import searching
from experiments.report.figures import NAMES, ordered
from experiments.report.html import Section, missing, picture, plot, table, text
from experiments.report.kept import Kept
from experiments.study.form import Report, words
from scene.proposal import default_proposal, describe

THIN = 0.02
"""As dense as an interval of this width is drawn what is narrower: 3 of 170 pixels."""
OLD = "This run is older than these pictures, or was cut off; its command writes them."


def sections(run: Kept) -> Iterator[Section]:
    """Attributes, streets, predictions."""
    yield attributes(run)
    yield streets(run)
    yield worst(run)


def attributes(run: Kept) -> Section:
    """The interval that each attribute was learnt to lie in, beside that of the street set by eye."""
    components = run.summary["components"]
    config, space = run.config, run.config.get("space", "scenex")
    eye = describe(default_proposal(config.get("default_width", 0.15), space))["components"][0]
    hidden = run.summary["hidden_centres"]
    rows = []
    for k, (name, first) in enumerate(components[0]["attributes"].items()):
        own, by_eye = [c["attributes"][name] for c in components], eye["attributes"].get(name)
        # A near twin hides the attributes of the smaller space.
        place = hidden[k] if hidden is not None and k < len(hidden) else None
        rows.append(
            [
                text(words(name)),
                _track(own, by_eye, place),
                *(_range(entry) for entry in own),
                "" if by_eye is None else _range(by_eye),
                text(first["physical"]["unit"]),
                text(first["meaning"]),
            ]
        )
    shares = [f"{100 * c['share']:.0f} % of streets" for c in components]
    heads = ["learnt, from – to"] if len(shares) == 1 else shares
    body = _key(hidden is not None) + table(
        ("attribute", "range", *heads, "by eye", "unit", "meaning"), rows, "attributes"
    )
    found = searching.policy(run)
    if found is not None:
        figure, height = found
        recorded = run.probabilities is not None
        what = (
            "How likely the search held each part of an attribute's range, update by update"
            if recorded
            else "Centres of what the search proposed, evaluation by evaluation; wide intervals are pale"
        )
        body += f"<h3>{what}</h3>" + plot(figure, height)
    mixed = (
        f" The answer is a mixture of {len(shares)} kinds of streets." if len(shares) > 1 else ""
    )
    binned = any(_binned(entry) for c in components for entry in c["attributes"].values())
    drawn = (
        "densities; from – to is the interval with their mean and variance"
        if binned
        else "intervals"
    )
    note = f"Each street draws its attributes from these {drawn}.{mixed}{_recovered(run.summary)}"
    return Section("attributes", "Learnt attributes", body, note)


def _recovered(report: Report) -> str:
    found = report.get("recovery")
    if found is None:
        return ""
    return (
        f" They lie {found['learnt_error']:.2f} of their range from the twin's hidden ones on average; all "
        f"centres at one half would lie {found['centre_error']:.2f}."
    )


def _key(hidden: bool) -> str:
    told = [("learnt", "learnt"), ("default", "set by eye")] + [
        ("hidden", "the twin's hidden centre")
    ] * hidden
    return (
        '<div class="key">'
        + "".join(f'<span><i style="background:var(--{k})"></i>{name}</span>' for k, name in told)
        + "</div>"
    )


def _track(own: list[Report], by_eye: Report | None, hidden: float | None) -> str:
    """Intervals within an attribute's whole range, as bars; beside probabilities, densities."""
    binned = any(map(_binned, own))
    drawn = _densities(own) if binned else "".join(_bar("learnt", *_ends(entry)) for entry in own)
    drawn += "" if by_eye is None else _bar("default", *_ends(by_eye))
    if hidden is not None:
        drawn += f'<i class="hidden" style="left:{100 * hidden:.1f}%"></i>'
    return f'<span class="track{" tall" * binned}">{drawn}</span>'


def _bar(kind: str, low: float, high: float, more: str = "") -> str:
    return f'<i class="{kind}" style="left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%{more}"></i>'


def _densities(own: list[Report]) -> str:
    """What each component draws from, to one scale."""
    found = [_density(entry) for entry in own]
    most = max(density for bars in found for *_, density in bars)
    return "".join(
        '<span class="learnt">'
        + "".join(_bar("bin", a, b, f";height:{100 * d / most:.0f}%") for a, b, d in bars if d)
        + "</span>"
        for bars in found
    )


def _density(entry: Report) -> list[tuple[float, float, float]]:
    """From, to and density of each bin, or of the one interval."""
    if not _binned(entry):
        low, high = _ends(entry)
        return [(low, high, 1 / max(high - low, THIN))]
    shares = entry["unit"]["probabilities"]
    bins = len(shares)
    return [(k / bins, (k + 1) / bins, bins * share) for k, share in enumerate(shares)]


def _binned(entry: Report) -> bool:
    return "probabilities" in entry["unit"]


def _ends(entry: Report) -> tuple[float, float]:
    """Where an interval begins and ends, as unit values."""
    centre, width = entry["unit"]["centre"], entry["unit"]["width"]
    return max(centre - width / 2, 0.0), min(centre + width / 2, 1.0)


def _range(entry: Report) -> str:
    low, high = (f"{entry['physical'][key]:.3g}" for key in ("low", "high"))
    return low if low == high else f"{low} – {high}"


def streets(run: Kept) -> Section:
    """Images of each kind with their labels."""
    title = ("streets", "Streets")
    if run.seen is None:
        return Section(*title, missing(OLD))
    rows = "".join(
        _row(run, NAMES[name], [entry[kind] for entry in own], kind)
        for name, own in run.seen["streets"].items()
        for kind in ("image", "labels")
    )
    return Section(
        *title,
        _palette(run.seen) + f'<div class="shots" style="{_columns(run)}">{rows}</div>',
        "What nets are trained on: images, and below them their labels.",
    )


def _columns(run: Kept) -> str:
    assert run.seen is not None
    most = max(len(own) for own in run.seen["streets"].values())
    return f"grid-template-columns:6.5rem repeat({most},1fr)"


def _row(run: Kept, name: str, files: list[str], kind: str) -> str:
    head = f"<h3>{text(name if kind == 'image' else '')}</h3>"
    folder = run.path / PICTURES
    return head + "".join(picture(folder / file, f"{name}, {kind}") for file in files)


def _palette(seen: dict[str, Any]) -> str:
    pairs = zip(seen["classes"], seen["colors"], strict=True)
    keys = "".join(
        f'<span><i style="background:rgb({r},{g},{b})"></i>{text(name)}</span>'
        for name, (r, g, b) in pairs
    )
    return f'<div class="key">{keys}</div>'


def worst(run: Kept) -> Section:
    """Test images with the predictions of each row's net, those first that learnt streets serve worst."""
    title = ("worst", "Worst images")
    found = None if run.seen is None else run.seen["worst"]
    if found is None:
        return Section(*title, missing(f"No predictions: {OLD[0].lower()}{OLD[1:]}"))
    folder, images = run.path / PICTURES, found["images"]
    rows = [row for row in ordered(run.summary) if images and row in images[0]["predictions"]]
    head = "".join(f"<h3>{text(name)}</h3>" for name in ("image", "truth", *map(NAMES.get, rows)))
    body = "".join(
        picture(folder / image["image"], image["name"], text(image["name"]))
        + picture(folder / image["labels"], f"{image['name']}, truth")
        + "".join(
            picture(folder / p["image"], f"{image['name']}, {NAMES[row]}", f"{p['miou']:.1f} %")
            for row, p in ((row, image["predictions"][row]) for row in rows)
        )
        for image in images
    )
    columns = f"grid-template-columns:repeat({2 + len(rows)},1fr)"
    grid = f'<div class="shots" style="{columns}">{head}{body}</div>'
    return Section(
        *title,
        _palette(run.seen or {}) + grid,
        f"Of {found['of']} test images, those where the first net of row “{NAMES[found['by']]}” has the "
        "lowest mIoU, the worst first; below each prediction the mIoU of that image alone, over the classes "
        "in it.",
    )
