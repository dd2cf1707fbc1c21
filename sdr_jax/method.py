"""The one interface of every search method: a tuple of pure functions."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key, Real

from sdr_jax.rewards import mean_known, only_finite
from sdr_jax.space import Proposal

State = Any
"""A method's state: a NamedTuple of arrays, to be passed on and not looked into."""


class Info(NamedTuple):
    """What one update did; for progress lines and plots, never needed to go on."""

    reward_mean: Float[Array, ""]  # mean of the update's rewards, NaN if all of them are
    reward_best: Float[Array, ""]  # the best of them
    baseline: Float[Array, ""]  # mean baseline, in units of transformed rewards; NaN without one
    advantages: Float[Array, "n"]  # what the gradient was weighted with; 0 for NaN rewards
    entropy: Float[Array, ""]  # of the distribution sampled from, before, in nats; NaN if unknown
    grad_norm: Float[Array, ""]  # L2 norm of the policy's gradient; 0 without one
    group: Int[Array, ""]  # the group the update was for; 0 where groups have no order
    clipped: Int[
        Array, ""
    ]  # rewards so far that are far below the others and count as their lowest


def on_clipping(clipped: int, of: int) -> str:
    """What there is to say, once, where some of so many rewards do not count as they are; see `Info`."""
    return (
        f"{clipped} of {of} scores are far worse than the others, by more than 5 interquartile ranges; "
        "the search takes each for the worst of the others"
    )


def plain_info(rewards: Float[Array, "n"], entropy: Float[Array, ""]) -> Info:
    """What there is to say of a method without baseline, gradient and order of groups."""
    finite = only_finite(rewards)
    return Info(
        reward_mean=mean_known(finite),
        reward_best=jnp.nanmax(finite),
        baseline=jnp.asarray(jnp.nan, jnp.float32),
        advantages=jnp.zeros_like(rewards),
        entropy=entropy,
        grad_norm=jnp.zeros((), jnp.float32),
        group=jnp.zeros((), jnp.int32),
        clipped=jnp.zeros((), jnp.int32),
    )


RngKey = Key[Array, ""]
Bins = Int[Array, "n attributes"]
Values = Float[Array, "n attributes"]
Rewards = Float[Array, "n"]
"""What the functions of a method take and give; of continuous methods, values in place of bins."""

InitFn = Callable[[RngKey], State]
SampleFn = Callable[[RngKey, State, int], tuple[Real[Array, "n attributes"], Proposal]]
UpdateFn = Callable[..., tuple[State, Info]]
ProposalFn = Callable[[State], Proposal]
ProbabilitiesFn = Callable[[State], Float[Array, "attributes bins"]]
ExpectsFn = Callable[
    [State, Real[Array, "n attributes"]], tuple[Float[Array, "n"], Float[Array, "n"]]
]
SubsetsFn = Callable[
    [RngKey, State, Int[Array, "n attributes"], int, int], Int[Array, "count size"]
]


class Method(NamedTuple):
    """A search method: pure functions, which are jitted and work under jit, scan and vmap.

    Those of a host adapter are pure as well, but neither jitted nor to be. Keys are consumed.

    Actions are bins, i32, -1 where nothing is decided; or f32 and finite, of a method over continuous
    values, in units of its own. Either way they are all that `update` needs.

    Higher rewards are better; one that is not finite is of an evaluation that failed. Failed ones are
    left out: learning from n rewards of which some failed is learning from the others alone.
    """

    init: InitFn  # rng_key -> the first state
    sample: SampleFn  # (rng_key, state, n) -> (actions, n proposals to be scored); n is static
    update: UpdateFn  # (state, actions, rewards) -> (state, info); see also `subsets`
    solution: ProposalFn  # the answer, f32[attributes] each; may be asked at any time
    spread: ProposalFn  # the answer, left wide where the method is unsure
    probabilities: ProbabilitiesFn  # of the bins `sample` would use; 0 for those an attribute lacks
    updates: int | None  # how many updates the method takes; None for any number
    traced: bool = True  # False for a host adapter, which is not to be jitted
    level: bool = False  # whether a constant added to all rewards makes a difference
    expects: ExpectsFn | None = None
    """Mean and standard deviation of the reward of actions, as the method's model sees it, NaN before it has
    learnt anything; for reports, None without a model."""
    subsets: SubsetsFn | None = None
    """(rng_key, state, actions, count, size) -> i32[count size], indices of actions that have one reward
    together; `update` then takes them, too. None of a method whose actions are data sets."""
    policy: Callable[[State], Any] | None = None
    """Of such a method, the distribution of streets: `pool.Policy`."""


def jitted(
    init: InitFn,
    sample: SampleFn,
    update: UpdateFn,
    solution: ProposalFn,
    probabilities: ProbabilitiesFn,
    spread: ProposalFn | None = None,
    updates: int | None = None,
    expects: ExpectsFn | None = None,
    level: bool = False,
) -> Method:
    """The method of these functions, each jitted; without a `spread`, that is the solution."""
    answer = jax.jit(solution)
    return Method(
        init=jax.jit(init),
        sample=jax.jit(sample, static_argnames="n"),
        update=jax.jit(update),
        solution=answer,
        spread=answer if spread is None else jax.jit(spread),
        probabilities=jax.jit(probabilities),
        updates=updates,
        level=level,
        expects=None if expects is None else jax.jit(expects),
    )
