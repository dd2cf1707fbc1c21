"""The order of images for labelling, from a net's uncertainties in a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from common.errors import UserError
from common.lines import CURE, JsonLines
from experiments.app.prelabels.files import Ranked
from seg.data.frames import Source
from seg.model import As
from seg.uncertainty import PARTS, Uncertainty, order

SCORES = "scores.jsonl"
"""File of the net's uncertainty about each image."""


def refuse_unranked(
    sources: Sequence[Source], how: As | None, probabilities: bool, rank: int
) -> As:
    """The format of label pictures beside a ranking; UserError for images that cannot be ranked."""
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
    """The net's uncertainty about each image, in a file that outlives a kill.

    Args:
        path: the file.
        classes: the net's number of classes.

    Attributes:
        known: uncertainties by name of the image.

    Raises:
        UserError: a line is no score.
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
        """Record the scores of some images, rounded, so that a stop does not change the order."""
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
    """Order all images for labelling.

    Args:
        sources: the images.
        scores: the score of each.
        images: their folder, or the single file.
        labels: gives the label picture of a name.
        first: number of images that are labelled together.
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
