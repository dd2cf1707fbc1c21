"""Groups of options that commands share: the size of an evaluation, and the options of a search."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from common.bounds import POSITIVE, at_least, at_most, within
from common.flags import Alias
from sdr_jax.names import MethodName
from seg.settings import TrainSettings

if TYPE_CHECKING:
    from scene.render import RenderSettings

RivalName = Literal["cma_es", "tpe", "gaussian_process"]
"""Search methods of other libraries, which only a checkout has (`benchmarks/rivals`)."""
MOST_BINS = 1000
"""The most bins: each is then a thousandth of an attribute's range."""


@dataclass(frozen=True)
class Fidelity:
    """The size of an evaluation: the rendered dataset, and the network trained on it."""

    width: int
    """Width of rendered and real images in pixels."""
    height: int
    """Height in pixels."""
    streets: Annotated[int, at_least(1)]
    """Streets per dataset."""
    shots: Annotated[int, at_least(1)]
    """Images per street."""
    samples: int = 2
    """Rays per pixel along each axis."""
    train: TrainSettings = field(default_factory=TrainSettings)
    """The network and its training."""

    @property
    def images(self) -> int:
        """Images per dataset."""
        return self.streets * self.shots

    @property
    def size(self) -> str:
        """Width and height, such as 640x320."""
        return f"{self.width}x{self.height}"

    def render_settings(self) -> RenderSettings:
        """Return the engine's settings at this size."""
        from scene.render import RenderSettings  # the help needs no engine

        return RenderSettings(self.width, self.height, self.samples)


@dataclass(frozen=True)
class Bins:
    """How attributes are divided into bins."""

    bins: Annotated[int, at_least(2), at_most(MOST_BINS)] = 10
    """Bins of each attribute (the paper's K)."""
    relaxation: Annotated[float | None, within(0, 1)] = None
    """Width of a relaxed bin, as a share of the range; with 1 / bins, bins tile it."""


@dataclass(frozen=True)
class SearchOptions(Bins):
    """Options of any search method. Under every preset ``sdr`` estimates its gradient as the paper does."""

    datasets_per_update: Annotated[int, at_least(1)] = 4
    """Datasets evaluated for each update."""
    learning_rate: Annotated[float, POSITIVE] = 1e-2
    """Learning rate of Adam (sdr)."""
    baseline: Literal["ema", "ema_current", "leave_one_out"] = "ema"
    """Baseline of a reward (sdr): the average of earlier rewards (paper), of earlier ones and itself (the
    authors' code), or of the update's other rewards."""
    normalise: bool = False
    """Divide advantages by their size (sdr; not in the paper)."""
    squared_reward: bool = False
    """Take (100 mIoU)^2, as in the authors' code, instead of mIoU (sdr)."""
    checkpoints: Annotated[int, at_least(1)] = 1
    """Checkpoints of a reward's training, evenly spaced. The reward is the mIoU of the best one, as in the
    authors' code; with 1 it is that of the trained network."""
    common_random_numbers: bool = False
    """Give the datasets of an update the same seed, and their streets the same places in the intervals."""
    start: Annotated[str, Alias("--start")] = "default"
    """Where the search starts (intervals): default (the default street), random, or an attributes.json. It
    starts at random streets instead if their first rewards have a higher mean."""
    unoptimised: Literal["random", "half"] = "random"
    """The value of groups that are not optimised yet (sdr): random (paper), or 0.5 (the authors' code)."""


@dataclass(frozen=True)
class MethodOptions(SearchOptions):
    """The search method and its options."""

    method: Annotated[MethodName, Alias("--method")] = "surrogate"
    """The search method; ``sdr`` is the paper's."""


@dataclass(frozen=True)
class Search(MethodOptions):
    """All options of a search."""

    updates_per_group: Annotated[int, at_least(1)] = 8
    """Updates for each group; methods that optimise all groups at once make the same number in total."""
