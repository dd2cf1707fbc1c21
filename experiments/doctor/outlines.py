"""Compares how annotators draw classes with how renders have them, and proposes outlines of target.yaml.

Rendered labels are exact to the pixel, and annotators outline a whole crown. The measure is the boundary per
area of a class: the sides of its pixels at which another class begins, over its pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from PIL import Image

from scene.assets.catalogue import AssetPool
from scene.dataset.render import compile_first, render_street
from scene.outline import Outlines, sources
from scene.proposal import draw, streets_named
from scene.render import RenderSettings
from scene.workers import WorkerPool
from seg.boundary import perimeters
from seg.classes import colorize, table_of
from shell.target_file import WIDEST, TargetFile

STREETS = 36
"""Number of rendered images."""
CLEAR = 1.5
"""The least factor by which renders exceed labels, and by which closing shortens their boundary more."""
TYPICAL = 0.03
"""Width of the holes, as a share of the image's, that tell whether a class is drawn as a whole."""
LEAST = 2000
"""The fewest pixels of a class with a figure."""
TINY = 1e-9
WIDTHS = tuple(percent / 100 for percent in range(1, round(100 * WIDEST) + 1))


class Drawn(NamedTuple):
    """Labels and depth of renders."""

    labels: np.ndarray  # u8[n, h, w] train ids
    depths: np.ndarray  # f32[n, h, w]

    def classes(self, target: TargetFile, outlines: Outlines) -> np.ndarray:
        """Labels u8[n, h, w] of a target."""
        pairs = zip(self.labels, self.depths, strict=True)
        labels = [label.take(sources(label, depth, outlines)) for label, depth in pairs]
        return table_of(target).from_train_id[np.stack(labels)]


class Compared(NamedTuple):
    """The boundary per area of a class that is not too rare."""

    name: str
    real: float
    exact: float  # of renders
    outlined: float  # of renders with all outlines
    outline: float  # share of the image's width, 0 for none


def renders(size: tuple[int, int], streets: int = STREETS) -> Drawn:
    """Render default streets at a size (width, height).

    Raises:
        RendererError: this machine lacks what the renderer needs.
    """
    compile_first(WorkerPool(0), "embree")
    settings, pool = RenderSettings(*size, 1), AssetPool()
    units = draw(streets_named("default", "extended"), 0, streets)
    frames = [render_street(u, 0, k, 1, settings, "embree", pool)[0] for k, u in enumerate(units)]
    return Drawn(np.stack([f.label for f in frames]), np.stack([f.depth for f in frames]))


def compare(target: TargetFile, labels: np.ndarray, drawn: Drawn) -> list[Compared]:
    """Compare labels u8[n, h, w] with renders, with the target's outlines or with proposed ones.

    A class is drawn as a whole if renders exceed labels, and if closing its holes shortens the boundary of
    renders but hardly that of labels, whatever streets they show. It gets the smallest outline with which
    renders are no longer above labels, if there is one. The class with the largest excess comes first, since
    its outline changes others, too.
    """
    names = target.class_names
    real, exact = _figures(labels, len(names)), _figures(drawn.classes(target, ()), len(names))
    shares = dict(target.outlines)

    def outlined(shares: dict[str, float]) -> np.ndarray:
        outlines = _with(target, shares).engine_outlines
        return _figures(drawn.classes(target, outlines), len(names))

    now = outlined(shares) if shares else exact
    for k in [] if shares else np.argsort(-exact / np.maximum(real, TINY), kind="stable"):
        whole = target.rendered[k] and now[k] > CLEAR * real[k]
        if whole and _left(labels, k) > CLEAR * _left(drawn.classes(target, ()), k):
            # The widest first, which is enough for classes that no outline makes smooth.
            if outlined({**shares, names[k]: WIDTHS[-1]})[k] <= real[k]:
                trials = ({**shares, names[k]: width} for width in WIDTHS)
                shares, now = next(
                    (trial, figures)
                    for trial in trials
                    if (figures := outlined(trial))[k] <= real[k]
                )
    return [
        Compared(name, float(real[k]), float(exact[k]), float(now[k]), shares.get(name, 0.0))
        for k, name in enumerate(names)
        if target.rendered[k] and np.isfinite(real[k] + exact[k])
    ]


def _left(labels: np.ndarray, k: int) -> float:
    """The share of the boundary of a class that is left when its holes are closed."""
    outlines = (((k,), TYPICAL),)
    pairs = ((label, np.where(label == k, 1, 2)) for label in labels)  # the class is in front
    closed = np.stack([label.take(sources(label, depth, outlines)) for label, depth in pairs])
    before, after = (perimeters(some, 256)[0][k] for some in (labels, closed))
    return float(after / before) if before else 1.0


def _with(target: TargetFile, shares: dict[str, float]) -> TargetFile:
    return msgspec.structs.replace(target, outlines=shares)


def _figures(labels: np.ndarray, classes: int) -> np.ndarray:
    """Boundary per area f64[classes], NaN for rare classes."""
    sides, areas = perimeters(labels, classes)
    return np.where(areas >= LEAST, sides / np.maximum(areas, 1), np.nan)


def line(rows: Sequence[Compared]) -> str:
    """The line of a target's file with the outlines; empty without any."""
    shares = [f"{_quoted(row.name)}: {100 * row.outline:g} %" for row in rows if row.outline]
    return f"outlines: {{{', '.join(shares)}}}\n" if shares else ""


def _quoted(text: str) -> str:
    return text if text.isidentifier() else "'" + text.replace("'", "''") + "'"


def pictures(
    target: TargetFile, labels: np.ndarray, drawn: Drawn, rows: Sequence[Compared]
) -> list[tuple[str, Image.Image]]:
    """Rendered labels, exact and outlined, where outlines change most; and real labels of these classes."""
    shares = {row.name: row.outline for row in rows if row.outline}
    exact = drawn.classes(target, ())
    outlined = drawn.classes(target, _with(target, shares).engine_outlines)
    shown = int((exact != outlined).sum(axis=(1, 2)).argmax())
    ids = [target.class_names.index(name) for name in shares]
    likely = int(np.isin(labels, ids).sum(axis=(1, 2)).argmax())
    chosen = [
        ("rendered labels, exact", exact[shown]),
        *([("rendered labels, outlined", outlined[shown])] if shares else []),
        ("your labels", labels[likely]),
    ]
    return [(name, Image.fromarray(colorize(label, target.palette))) for name, label in chosen]
