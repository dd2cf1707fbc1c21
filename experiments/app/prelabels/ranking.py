"""The ranking of images for labelling, from the uncertainties of a network in a file."""

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
"""File of the network's uncertainty about each image."""


def refuse_unranked(
    sources: Sequence[Source], how: As | None, probabilities: bool, rank: int
) -> As:
    """The format of label images with a ranking. Raises UserError for images that cannot be ranked."""
    if rank < 1:
        raise UserError(f"--first must be at least 1, not {rank}")
    if how not in (None, "ids") or probabilities:
        flag = "--probabilities" if probabilities else f"--as {how}"
        raise UserError(f"--rank writes label images of ids; leave out {flag}")
    for source in sources:
        if source.video:
            raise UserError(
                f"--rank needs images, but {source.path} is a video; extract its frames"
            )
    return "ids"


class Scores:
    """The network's uncertainty about each image, in a file that survives a kill.

    Args:
        path: the file.
        classes: the network's number of classes.

    Attributes:
        by_name: uncertainties by name of the image.

    Raises:
        UserError: a line is not a score.
    """

    def __init__(self, path: Path, classes: int) -> None:
        self._lines, self._length = JsonLines(path), PARTS**2 * classes
        self.by_name = dict(map(self._parsed, range(len(self._lines.lines))))

    def _parsed(self, number: int) -> tuple[str, Uncertainty]:
        line = self._lines.lines[number]
        name, margin, layout = (line.get(field) for field in ("name", *Uncertainty._fields))
        if isinstance(name, str) and isinstance(layout, list) and len(layout) == self._length:
            numbers = [v for v in (margin, *layout) if isinstance(v, int | float) and 0 <= v <= 1]
            if len(numbers) == 1 + self._length:
                return name, Uncertainty(numbers[0], tuple(numbers[1:]))
        raise UserError(f"{self._lines.where(number)} is not a score; {CURE}")

    def add(self, scores: Mapping[str, Uncertainty]) -> None:
        """Record the scores of some images, rounded, so that a stop does not change the ranking."""
        rounded = {
            name: Uncertainty(round(score.margin, 6), tuple(round(v, 6) for v in score.layout))
            for name, score in scores.items()
        }
        self._lines.append(*({"name": name, **score._asdict()} for name, score in rounded.items()))
        self.by_name |= rounded


def ranked(
    sources: Sequence[Source],
    scores: Scores,
    images: Path,
    labels: Callable[[str], Path],
    first: int,
) -> list[Ranked]:
    """Rank all images for labelling.

    Args:
        sources: the images.
        scores: the score of each.
        images: their folder, or the single file.
        labels: returns the label image of a name.
        first: number of images that are labelled together.
    """
    folder = Path(images.resolve().name)
    return [
        Ranked(
            sources[k].name,
            (folder / sources[k].path.relative_to(images)).as_posix(),
            scores.by_name[sources[k].name].margin,
            labels(sources[k].name),
        )
        for k in order([scores.by_name[source.name] for source in sources], first)
    ]
