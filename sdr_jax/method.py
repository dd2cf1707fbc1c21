"""What every search method is, a tuple of pure functions, and the rewards that it learns from."""

from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, Real

from sdr_jax.rewards import mean_without_nan, nan_if_infinite
from sdr_jax.space import Proposal

State = Any
"""A method's state: a NamedTuple of arrays that callers pass on unread."""


class Info(NamedTuple):
    """Figures of one update, for progress lines and plots; the search itself does not need them."""

    reward_mean: Float[Array, ""]  # mean of the update's rewards, NaN if all of them are
    reward_best: Float[Array, ""]  # the best of them
    baseline: Float[Array, ""]  # mean baseline, in units of transformed rewards; NaN without one
    advantages: Float[Array, "n"]  # weights of the gradient; 0 for NaN rewards
    entropy: Float[Array, ""]  # of the distribution before the update, in nats; NaN if unknown
    grad_norm: Float[Array, ""]  # L2 norm of the policy's gradient; 0 without one
    group: Int[Array, ""]  # the group that was updated; 0 where groups have no order
    clipped: Int[Array, ""]
    """Number of rewards so far that are far below the others and count as the lowest of them."""
    finite: Bool[Array, ""]  # whether the method's numbers are; if not, its answers mean nothing


def refuse_not_finite(info: Info) -> None:
    """Raise FloatingPointError if a method's numbers are no longer finite after an update."""
    if not np.all(info.finite):
        raise FloatingPointError(
            "the search's model holds numbers that are not finite, so it has no answer: a bug in sdr-jax; "
            "please report it with the attributes and the rewards so far"
        )


def clipping_message(clipped: int, total: int) -> str:
    """The message that some rewards are clipped, see `Info`; a search shows it once."""
    return (
        f"{clipped} of {total} rewards are lower than the others by more than 5 interquartile ranges; "
        "the search counts each of them as the lowest of the others"
    )


def basic_info(rewards: Float[Array, "n"], entropy: Float[Array, ""]) -> Info:
    """The `Info` of a method that has no baseline, no gradient and no order of groups."""
    return Info(
        reward_mean=mean_without_nan(rewards),
        reward_best=jnp.nanmax(rewards),
        baseline=jnp.asarray(jnp.nan, jnp.float32),
        advantages=jnp.zeros_like(rewards),
        entropy=entropy,
        grad_norm=jnp.zeros((), jnp.float32),
        group=jnp.zeros((), jnp.int32),
        clipped=jnp.zeros((), jnp.int32),
        finite=jnp.ones((), bool),
    )


RngKey = Key[Array, ""]
Bins = Int[Array, "n attributes"]
Values = Float[Array, "n attributes"]
Rewards = Float[Array, "n"]
"""The arguments and results of a method's functions; continuous methods have values in place of bins."""

InitFn = Callable[[RngKey], State]
SampleFn = Callable[[RngKey, State, int], tuple[Real[Array, "n attributes"], Proposal]]
UpdateFn = Callable[..., tuple[State, Info]]
ProposalFn = Callable[[State], Proposal]
ProbabilitiesFn = Callable[[State], Float[Array, "attributes bins"]]
PredictFn = Callable[
    [State, Real[Array, "n attributes"]], tuple[Float[Array, "n"], Float[Array, "n"]]
]


class Diagnostics(NamedTuple):
    """What a method reports besides its answer: how sure it is, and what its model predicts."""

    spread: ProposalFn  # the answer with wide intervals where the method is unsure
    probabilities: ProbabilitiesFn  # of the bins in `sample`; 0 for bins that an attribute lacks
    predict: PredictFn | None = None
    """(state, actions) -> mean and standard deviation f32[n] of their rewards under the method's model; NaN
    before the first update. None for a method without a model."""


class Method(NamedTuple):
    """A search method: pure functions, which are jitted and work under jit, scan and vmap.

    The functions of a host adapter are pure as well, but cannot be jitted. Keys are consumed.

    Actions are bins, i32, with -1 for an undecided attribute; a method over continuous values has finite
    f32 in its own units. `update` needs only the actions and their rewards.

    Higher rewards are better. A reward that is not finite says that its evaluation failed; methods leave
    it out.
    """

    init: InitFn  # rng_key -> the first state
    sample: SampleFn  # (rng_key, state, n) -> (actions, n proposals to evaluate); n is static
    update: UpdateFn  # (state, actions, rewards) -> (state, info)
    solution: ProposalFn  # state -> the answer, f32[attributes] each; defined at any time
    diagnostics: Diagnostics | None = None
    updates: int | None = None  # how many updates the method takes; None for any number
    traced: bool = True  # False for a host adapter, whose functions cannot be jitted
    shift_invariant: bool = True  # whether a constant added to all rewards changes nothing


@runtime_checkable
class RewardFn(Protocol):
    """Score(theta') in the paper: the rewards of data sets."""

    def __call__(
        self, rng_key: RngKey, proposals: Proposal, actions: Real[Array, "n attributes"]
    ) -> Float[Array | np.ndarray, "n"]:
        """Evaluate data sets; higher rewards are better, and one that is not finite is a failed evaluation.

        Args:
            rng_key: consumed.
            proposals: f32[n attributes] each.
            actions: what the method chose, [n attributes]; most rewards need the proposals only.
        """


class Record(NamedTuple):
    """The actions of one step and their rewards."""

    actions: Real[Array, "n attributes"]  # see the method's `sample`
    rewards: Float[Array, "n"]  # one per data set
    info: Info  # of the update


def _single(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function return float32 and int32 instead of float64 and int64."""
    shorter = {"float64": jnp.float32, "int64": jnp.int32}

    def single(leaf: Array) -> Array:
        return leaf.astype(shorter.get(str(leaf.dtype), leaf.dtype))

    @wraps(function)
    def of_single(*arguments: Any, **options: Any) -> Any:
        return jax.tree.map(single, function(*arguments, **options))

    return of_single


def jit_method(
    init: InitFn,
    sample: SampleFn,
    update: UpdateFn,
    solution: ProposalFn,
    probabilities: ProbabilitiesFn,
    spread: ProposalFn | None = None,
    predict: PredictFn | None = None,
    *,
    updates: int | None = None,
    shift_invariant: bool = True,
) -> Method:
    """Make a method of these functions, each of them jitted; by default `spread` is the solution.

    `update` gets NaN in place of infinite rewards. Results are in single precision, also where JAX's default
    is double precision (`jax_enable_x64`).
    """

    def update_without_infinity(
        state: State, actions: Array, rewards: Rewards
    ) -> tuple[State, Info]:
        return update(state, actions, nan_if_infinite(rewards))

    answer = jax.jit(_single(solution))
    diagnostics = Diagnostics(
        spread=answer if spread is None else jax.jit(_single(spread)),
        probabilities=jax.jit(_single(probabilities)),
        predict=None if predict is None else jax.jit(_single(predict)),
    )
    return Method(
        init=jax.jit(_single(init)),
        sample=jax.jit(_single(sample), static_argnames="n"),
        update=jax.jit(_single(update_without_infinity)),
        solution=answer,
        diagnostics=diagnostics,
        updates=updates,
        shift_invariant=shift_invariant,
    )
