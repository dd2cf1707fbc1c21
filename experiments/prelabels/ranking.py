"""The order in which images are to be labelled: what a net said of each, kept in a file, and what follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from experiments.prelabels.files import Ranked
from seg.data.frames import Source
from seg.model import As
from shell.errors import UserError
from shell.lines import CURE, JsonLines

SCORES = "scores.jsonl"
"""How unsure a net is of each image."""


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
    """How unsure the net is of each image, in a file that outlives a kill.

    Attributes:
        known: `seg.uncertainty.mean_margin` by name of the image.

    Raises:
        UserError: a line that is no score.
    """

    def __init__(self, path: Path) -> None:
        self._lines = JsonLines(path)
        self.known = dict(map(self._parsed, range(len(self._lines.lines))))

    def _parsed(self, number: int) -> tuple[str, float]:
        line = self._lines.lines[number]
        name, value = line.get("name"), line.get("uncertainty")
        if isinstance(name, str) and isinstance(value, float) and 0 <= value <= 1:
            return name, value
        raise UserError(f"{self._lines.where(number)} is no score; {CURE}")

    def add(self, found: Mapping[str, float]) -> None:
        """Keep the scores of some images."""
        rounded = {name: round(value, 6) for name, value in found.items()}
        self._lines.append(*({"name": n, "uncertainty": u} for n, u in rounded.items()))
        self.known |= rounded


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
    rows = [
        Ranked(
            source.name,
            (base / source.path.relative_to(images)).as_posix(),
            scores.known[source.name],
            labels(source.name),
        )
        for source in sources
    ]
    return sorted(rows, key=lambda own: -own.uncertainty)
