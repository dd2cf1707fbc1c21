"""An evaluation to make, and its result."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from experiments.config import Fidelity
from experiments.evaluation.made_with import MadeWith
from experiments.evaluation.predictions import Predictions
from experiments.targets.base import Side
from scene.assets.catalogue import AssetPool
from scene.proposal import Streets
from seg.classes import ClassTable, class_table
from seg.data import LabelledImages
from seg.mixing import TrainingSet
from seg.pyramid import Statistics


class Recipe(NamedTuple):
    """Everything that decides a network but its training set and its seed."""

    fidelity: Fidelity
    table: str  # name of the class table
    renderer: str
    pool: AssetPool  # the assets that may appear
    statistics: Statistics | None = None  # of a backbone's head; None: those of its training set
    checkpoints: int = 1  # of the training, the best of which gives the reward
    made_with: MadeWith = ()  # backend and versions of all workers of the run

    @property
    def classes(self) -> ClassTable:
        """The classes of its networks."""
        return class_table(self.table)


class StreetPool(NamedTuple):
    """Streets of one shot with their features."""

    name: str  # hash of their attributes, seed and size; `Cache.streets` renders them


class LabelledSubset(NamedTuple):
    """Some of a target's labelled images; files hold all of them once."""

    images: LabelledImages
    indices: tuple[int, ...]


LabelledSource = LabelledImages | LabelledSubset
"""Images with labels, which need no rendering."""
Source = Streets | StreetPool | LabelledSource | TrainingSet
"""A source of training images: a dataset rendered from streets, a pool of streets, given images, or a
`TrainingSet` of a rendered and a given part."""


def rendered_of(source: Any) -> Any:
    """A source without the labelled images mixed in."""
    return source.parts[0] if isinstance(source, TrainingSet) else source


def count_of(images: LabelledSource) -> int:
    """The number of images."""
    return len(images.indices if isinstance(images, LabelledSubset) else images.images)


Keeps = Literal["confusion", "predictions"]
"""What to keep of a tested network: its confusion matrix alone, or predictions, too."""


class Start(NamedTuple):
    """The training of a network before it is fine-tuned on labelled images."""

    recipe: Recipe  # sizes, network and training, as on a rendered dataset
    streets: Streets | None  # of that dataset; None begins with the fine-tuning
    on_subset: bool = False  # whether to take the images of the fine-tuning instead
    nets: int = 1  # number of networks that are fine-tuned from this one


class Job(NamedTuple):
    """One evaluation: a network to train, and to test on the images of a side of the target."""

    recipe: Recipe
    source: Source
    seed: int  # of the streets and of the network
    notes: dict[str, Any]  # more fields of its record in the run's store
    side: Side = "test"
    keeps: Keeps | None = None  # what to keep in the run folder
    start: Start | None = None  # the training before that by the recipe


class Result(NamedTuple):
    """The reward of one training set, or why it is not known."""

    reward: float  # mIoU in [0, 1]; NaN if it failed
    class_iou: list[float | None]  # in [0, 1]; None for classes that do not occur in the labels
    render_seconds: float
    train_seconds: float  # training and testing
    failed: str | None = None
    stored: bool = False  # whether it was known, and took no time now
    heads: tuple[list[float | None], ...] = ()  # class IoU of each of several heads alone
    predictions: Predictions | None = None  # on request, if they were not known before

    @property
    def seconds(self) -> float:
        """Core seconds of the evaluation when it was made."""
        return self.render_seconds + self.train_seconds


def progress_line(job: Job, result: Result) -> str:
    """The progress line of a network outside a search."""
    notes = job.notes
    return f"{notes['nets']}: {notes['row']}, seed {notes['seed']} | {verdict(result)}"


def verdict(result: Result) -> str:
    """A result in progress lines."""
    return "failed" if result.failed else f"mIoU {100 * result.reward:.1f}"
