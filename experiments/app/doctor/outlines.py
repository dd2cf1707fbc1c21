"""Compares the outlines of labels with those of renders, and proposes outlines for target.yaml.

Rendered labels are exact to the pixel; annotators outline a whole crown. The measure is the boundary of a
class with the sky: the sides of its pixels that touch the sky, per pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from PIL import Image

from common.labels.classes import Outline
from common.labels.target_file import WIDEST, TargetFile
from common.workers.pool import WorkerPool
from experiments.app.doctor.pairs import quoted
from scene.assets.catalogue import AssetPool
from scene.classes import TrainId
from scene.dataset.render import compile_first, render_street
from scene.outline import sources
from scene.proposal import draw, streets_named
from scene.render import RenderSettings
from seg.boundary import perimeters
from seg.classes import colorize, table_of

STREETS = 36
"""Number of rendered images."""
CLEAR = 1.5
"""The least factor by which renders exceed labels, and by which closing shortens their boundary more."""
TYPICAL = 0.03
"""Width of the holes, as a share of the image's, by which a class counts as drawn without holes."""
LEAST = 2000
"""The fewest pixels of a class whose boundary is measured."""
RAGGED = 0.05
"""The least boundary per pixel of renders that an outline may shorten."""
WIDTHS = tuple(percent / 100 for percent in range(1, round(100 * WIDEST) + 1))


class RenderedLabels(NamedTuple):
    """Labels and depth of renders."""

    labels: np.ndarray  # u8[n, h, w] train ids
    depths: np.ndarray  # f32[n, h, w]

    def classes(self, target: TargetFile, outlines: Sequence[Outline]) -> np.ndarray:
        """Labels u8[n, h, w] of a target."""
        pairs = zip(self.labels, self.depths, strict=True)
        labels = [label.take(sources(label, depth, outlines)) for label, depth in pairs]
        return table_of(target).from_train_id[np.stack(labels)]


class Compared(NamedTuple):
    """The boundary of a class with the sky, per pixel of the class."""

    name: str
    real: float
    exact: float  # of renders
    outlined: float  # of renders with all outlines
    outline: float  # share of the image's width, 0 for none


def renders(size: tuple[int, int], streets: int = STREETS) -> RenderedLabels:
    """Render default streets at a size (width, height).

    Raises:
        RendererError: this machine lacks what the renderer needs.
    """
    compile_first(WorkerPool(0), "embree")
    settings, pool = RenderSettings(*size, 1), AssetPool()
    units = draw(streets_named("default", "extended"), 0, streets)
    frames = [render_street(u, 0, k, 1, settings, "embree", pool)[0] for k, u in enumerate(units)]
    return RenderedLabels(np.stack([f.label for f in frames]), np.stack([f.depth for f in frames]))


def compare(
    target: TargetFile, labels: np.ndarray, rendered: RenderedLabels, propose: bool = True
) -> list[Compared]:
    """Compare labels u8[n, h, w] with renders, with the target's outlines or, on request, with proposed ones.

    Annotators draw a class without holes if its boundary is longer in renders than in labels, and if closing
    holes shortens it in renders but hardly in labels, whatever streets they show. Such a class gets the
    smallest outline with which the boundary of renders is no longer, or the widest. The class with the
    largest excess comes first, since its outline changes others, too.
    """
    names = target.class_names
    exact_labels = rendered.classes(target, ())
    sky = int(table_of(target).from_train_id[TrainId.SKY])
    real, exact = (_boundaries(ids, len(names), sky) for ids in (labels, exact_labels))
    shares = dict(target.outlines)

    def outlined(shares: dict[str, float]) -> np.ndarray:
        outlines = _with_outlines(target, shares).engine_outlines
        return _boundaries(rendered.classes(target, outlines), len(names), sky)

    current = outlined(shares) if shares else exact
    comparable = np.isfinite(real + exact) & target.rendered & (np.arange(len(names)) != sky)
    excess = np.divide(exact, real, out=np.full(len(names), np.inf), where=real > 0)
    for k in np.argsort(-excess, kind="stable") if propose else []:
        ragged = current[k] > max(RAGGED, CLEAR * real[k])
        if not (comparable[k] and ragged):
            continue
        closed_real, closed_exact = (_closed(ids, k, sky) for ids in (labels, exact_labels))
        if closed_real > CLEAR * closed_exact:
            for width in WIDTHS:
                current = outlined({**shares, names[k]: width})
                if current[k] <= real[k]:
                    break
            shares[names[k]] = width
    return [
        Compared(name, float(real[k]), float(exact[k]), float(current[k]), shares.get(name, 0.0))
        for k, name in enumerate(names)
        if comparable[k]
    ]


def _closed(labels: np.ndarray, k: int, sky: int) -> float:
    """The share of the boundary of a class with the sky that is left when its holes are closed."""
    train_ids = np.full(256, TrainId.ROAD, np.uint8)
    train_ids[[k, sky]] = TrainId.VEGETATION, TrainId.SKY
    before = train_ids[labels]
    outlines = (Outline((int(TrainId.VEGETATION),), TYPICAL),)
    pairs = ((label, label != TrainId.SKY) for label in before)
    after = np.stack([label.take(sources(label, near, outlines)) for label, near in pairs])
    sides = [perimeters(ids, 19, TrainId.SKY)[0][TrainId.VEGETATION] for ids in (after, before)]
    return float(sides[0] / max(sides[1], 1))


def _with_outlines(target: TargetFile, shares: dict[str, float]) -> TargetFile:
    return msgspec.structs.replace(target, outlines=shares)


def _boundaries(labels: np.ndarray, classes: int, sky: int) -> np.ndarray:
    """Boundary with the sky per pixel f64[classes], NaN for rare classes."""
    sides, areas = perimeters(labels, classes, sky)
    return np.where(areas >= LEAST, sides / np.maximum(areas, 1), np.nan)


def line(rows: Sequence[Compared]) -> str:
    """The line of a target's file with the outlines; empty without any."""
    shares = [f"{quoted(row.name)}: {100 * row.outline:g} %" for row in rows if row.outline]
    comment = "  # classes that your annotators draw without holes"
    return f"outlines: {{{', '.join(shares)}}}{comment}\n" if shares else ""


def pictures(
    target: TargetFile, labels: np.ndarray, rendered: RenderedLabels, rows: Sequence[Compared]
) -> list[tuple[str, Image.Image]]:
    """Images of rendered labels, exact and outlined, where outlines change most, and of real labels."""
    shares = {row.name: row.outline for row in rows if row.outline}
    exact = rendered.classes(target, ())
    outlined = rendered.classes(target, _with_outlines(target, shares).engine_outlines)
    changed = int((exact != outlined).sum(axis=(1, 2)).argmax())
    ids = [target.class_names.index(name) for name in shares]
    most = int(np.isin(labels, ids).sum(axis=(1, 2)).argmax())
    examples = [
        ("rendered labels, exact", exact[changed]),
        *([("rendered labels, outlined", outlined[changed])] if shares else []),
        ("your labels", labels[most]),
    ]
    return [(name, Image.fromarray(colorize(label, target.palette))) for name, label in examples]
