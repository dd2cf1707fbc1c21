"""The order in which images are to be labelled: what a net said of each, kept in a file, and what follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from experiments.prelabels.files import Ranked
from seg.data.frames import Source
from seg.model import As
from seg.uncertainty import ClassEntropy, uncertainties
from shell.errors import UserError
from shell.lines import CURE, JsonLines

SCORES = "scores.jsonl"
"""What a net says of each image."""


def refuse_unranked(
    sources: Sequence[Source], how: As | None, probabilities: bool, rank: int
) -> As:
    """How label pictures are written beside a ranking; UserError for what cannot be ranked."""
    if rank < 1:
        raise UserError(f"--first must be 1 or more, not {rank}")
    if how not in (None, "ids") or probabilities:
        flag = "--probabilities" if probabilities else f"--as {how}"
        raise UserError(f"--rank makes pre-labels from label pictures of ids; leave out {flag}")
    for source in sources:
        if source.video:
            raise UserError(
                f"--rank orders images, and {source.path} is a video; put its frames there as images"
            )
    return "ids"


class Scores:
    """What the net said of each image, in a file that outlives a kill.

    Args:
        path: the file.
        classes: that the net tells apart.

    Attributes:
        known: by name of the image.

    Raises:
        UserError: a line that is no score.
    """

    def __init__(self, path: Path, classes: int) -> None:
        self._lines, self._shape = JsonLines(path), (classes,)
        self.known = dict(map(self._parsed, range(len(self._lines.lines))))

    def _parsed(self, number: int) -> tuple[str, ClassEntropy]:
        line = self._lines.lines[number]
        try:
            own = ClassEntropy(*(np.array(line[field], float) for field in ClassEntropy._fields))
            if any(part.shape != self._shape or not np.isfinite(part).all() for part in own):
                raise ValueError
            return line["name"], own
        except (KeyError, TypeError, ValueError):
            raise UserError(f"{self._lines.where(number)} is no score; {CURE}") from None

    def add(self, found: Mapping[str, ClassEntropy]) -> None:
        """Keep the scores of some images."""
        rows = [
            {"name": name, **{field: part.tolist() for field, part in own._asdict().items()}}
            for name, own in found.items()
        ]
        self._lines.append(*rows)
        self.known |= found


def ranked(
    sources: Sequence[Source], scores: Scores, images: Path, labels: Callable[[str], Path]
) -> list[Ranked]:
    """All images, the least sure first.

    Args:
        sources: of the images.
        scores: of each.
        images: their folder, or the one file.
        labels: the label picture of a name.
    """
    base = Path(images.resolve().name)
    values = uncertainties([scores.known[source.name] for source in sources])
    rows = [
        Ranked(
            source.name,
            (base / source.path.relative_to(images)).as_posix(),
            float(value),
            labels(source.name),
        )
        for source, value in zip(sources, values, strict=True)
    ]
    return sorted(rows, key=lambda own: -own.uncertainty)
