"""One evaluation to make, and its result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from experiments.config import Fidelity, RewardKind
from experiments.evaluation.made_with import MadeWith
from experiments.evaluation.predictions import Predictions
from experiments.target.base import Side
from scene.assets.catalogue import AssetPool
from scene.proposal import Streets
from seg.beside import TrainingSet
from seg.classes import ClassTable, class_table
from seg.data import LabelledImages
from seg.pyramid import Statistics

if TYPE_CHECKING:
    from experiments.evaluation.cache import Cached

Parts = tuple[tuple[int, int], ...]
"""First image of each part of the images that nets are tested on, and the first after it."""


REWARD_NAMES: dict[RewardKind, str] = {"miou": "mIoU", "mmd": "-MMD^2"}
"""What each ``--reward-kind`` is."""


class Recipe(NamedTuple):
    """All that decides a net, but for its training set and its seed."""

    fidelity: Fidelity
    table: str  # name of the class table
    renderer: str
    pool: AssetPool  # the assets that may appear
    statistics: Statistics | None = None  # that a trunk's head normalises by; or its training set's
    made_with: MadeWith = ()  # backend and versions of all workers of the run

    @property
    def classes(self) -> ClassTable:
        """What its nets tell apart."""
        return class_table(self.table)


class StreetPool(NamedTuple):
    """Streets of one shot, drawn once and used by many nets."""

    name: str  # hash of their attributes and seed
    held: Cached | None = None  # with features; None while they are not made


class Subset(NamedTuple):
    """Some streets of a pool."""

    pool: StreetPool
    picked: tuple[int, ...]  # by index


class LabelledSubset(NamedTuple):
    """Some of a target's labelled images: files hold all of them once."""

    images: LabelledImages
    picked: tuple[int, ...]  # by index


Given = LabelledImages | LabelledSubset
"""Images with labels: there is nothing to render."""
Source = Streets | Subset | Given | TrainingSet
"""What a net is trained on: a dataset rendered from streets, streets of a pool, given images, or a
`TrainingSet` of two parts, of which the first is rendered and the second given."""


def rendered_of(source: Any) -> Any:
    """A source without the labelled images beside it."""
    return source.parts[0] if isinstance(source, TrainingSet) else source


def count_of(images: Given) -> int:
    """How many images there are."""
    return len(images.picked if isinstance(images, LabelledSubset) else images.images)


Keeps = Literal["confusion", "predictions"]
"""What is kept of a net that was tested: its confusion matrix alone, or predictions, too."""


class Start(NamedTuple):
    """What a net does before it is fine-tuned on labelled images."""

    recipe: Recipe  # sizes, net and training, as on a rendered dataset
    streets: Streets | None  # that dataset's; None begins at the fine-tuning
    on_subset: bool = False  # instead train as many steps on the images of the fine-tuning
    nets: int = 1  # so many are fine-tuned from one that was trained on the dataset


class Job(NamedTuple):
    """One evaluation: a net to be trained, and tested on the images of a side of the target."""

    recipe: Recipe
    source: Source
    seed: int  # of the streets and of the net
    notes: dict[str, Any]  # what the run's store says of it, beside the result
    side: Side = "test"
    kind: RewardKind = "miou"
    parts: Parts = ()
    """Parts of the images that it is tested on separately, too; only for mIoU. They do not name an
    evaluation: one that is known already may tell of other parts, or of none."""
    keeps: Keeps | None = None  # what it leaves in the run folder
    start: Start | None = None  # what comes before the training by the recipe
    rendered: float = 0.0  # CPU seconds of its share of the rendering that was done before


class Result(NamedTuple):
    """What one training set was worth, or why that is not known."""

    reward: float  # mIoU in [0, 1], or -MMD^2; NaN if it failed
    class_iou: list[float | None]  # in [0, 1]; None for classes that do not occur in the labels
    render_seconds: float
    train_seconds: float  # training and testing
    failed: str | None = None
    stored: bool = False  # it was known, and took no time now
    parts: tuple[float, ...] = ()  # reward on each part of the images, where it was asked for
    predictions: Predictions | None = None  # where they were asked for and were not known before

    @property
    def seconds(self) -> float:
        """What the evaluation took, when it was made, on a worker's one core."""
        return self.render_seconds + self.train_seconds


def said(job: Job, result: Result) -> str:
    """What progress says about a net that is none of a search."""
    notes = job.notes
    return f"{notes['nets']}: {notes['row']}, seed {notes['seed']} | {verdict(result, job.kind)}"


def verdict(result: Result, kind: RewardKind = "miou") -> str:
    """What progress says about a result."""
    if result.failed:
        return "failed"
    return f"{REWARD_NAMES[kind]} {in_words(kind, result.reward)}"


def in_words(kind: RewardKind, reward: float) -> str:
    """A reward as progress tells it: mIoU in percent, or -MMD^2 as it is."""
    return f"{100 * reward:.1f}" if kind == "miou" else f"{reward:.4f}"
