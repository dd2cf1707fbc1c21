"""The order in which images are to be labelled: what a net said of each, kept in a file, and what follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from experiments.prelabels.files import Ranked
from seg.data.frames import Source
from seg.model import As
from seg.uncertainty import PARTS, Uncertainty, order
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

    Args:
        path: the file.
        classes: that the net tells apart.

    Attributes:
        known: by name of the image.

    Raises:
        UserError: a line that is no score.
    """

    def __init__(self, path: Path, classes: int) -> None:
        self._lines, self._length = JsonLines(path), PARTS**2 * classes
        self.known = dict(map(self._parsed, range(len(self._lines.lines))))

    def _parsed(self, number: int) -> tuple[str, Uncertainty]:
        line = self._lines.lines[number]
        name, margin, layout = (line.get(field) for field in ("name", *Uncertainty._fields))
        if isinstance(name, str) and isinstance(layout, list) and len(layout) == self._length:
            numbers = [v for v in (margin, *layout) if isinstance(v, int | float) and 0 <= v <= 1]
            if len(numbers) == 1 + self._length:
                return name, Uncertainty(numbers[0], tuple(numbers[1:]))
        raise UserError(f"{self._lines.where(number)} is no score; {CURE}")

    def add(self, found: Mapping[str, Uncertainty]) -> None:
        """Keep the scores of some images; rounded, so that a stop changes no order."""
        rounded = {
            name: Uncertainty(round(own.margin, 6), tuple(round(v, 6) for v in own.layout))
            for name, own in found.items()
        }
        self._lines.append(*({"name": name, **own._asdict()} for name, own in rounded.items()))
        self.known |= rounded


def ranked(
    sources: Sequence[Source],
    scores: Scores,
    images: Path,
    labels: Callable[[str], Path],
    first: int,
) -> list[Ranked]:
    """All images in the order in which they are to be labelled.

    Args:
        sources: of the images.
        scores: of each.
        images: their folder, or the one file.
        labels: the label picture of a name.
        first: that are labelled together.
    """
    base = Path(images.resolve().name)
    return [
        Ranked(
            sources[k].name,
            (base / sources[k].path.relative_to(images)).as_posix(),
            scores.known[sources[k].name].margin,
            labels(sources[k].name),
        )
        for k in order([scores.known[source.name] for source in sources], first)
    ]
