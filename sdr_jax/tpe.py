"""TPE, the tree-structured Parzen estimator, through the library `optuna`: a host adapter."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sdr_jax import bins
from sdr_jax.extras import needs
from sdr_jax.method import Info, Method, plain_info
from sdr_jax.space import UNDECIDED, Proposal, Space, check_relaxation, relax


class TpeState(NamedTuple):
    """All evaluations so far; a Python object of growing size, not for jit."""

    actions: tuple[tuple[int, ...], ...]  # their bins
    rewards: tuple[float, ...]  # finite


def tpe(
    space: Space,
    width: float | tuple[float, ...] | None = None,
    *,
    startup: int = 10,
    multivariate: bool = False,
) -> Method:
    """Models the good and the other evaluations apart, and proposes where good ones are denser.

    Bins are ordered integers, so neighbours share evidence. The n data sets of an update are asked
    one after the other, those pending counted as poor (the library's constant liar), which spreads
    them. The answer is the best data set seen, as the library gives it: under noise partly the
    luckiest. Groups play no part. NaN rewards are passed by.

    This is a host adapter, not to be jitted: `run`, `make_step` and their scan do not take it,
    `run_on_host` does. Otherwise it behaves like the pure methods: the same key gives the same
    data sets, and a state given stays valid. The library is told the history anew only where a
    state does not follow from the one before.

    `probabilities`, and `spread` from it, are an estimate: the best quarter of the evaluations,
    and a uniform distribution with the weight of one more.

    Args:
        space: the attributes and their bins.
        width: of the relaxed bins, see `relax`.
        startup: evaluations at random before the model is used.
        multivariate: model attributes jointly instead of each alone.

    Returns:
        The method, for any number of updates.

    Raises:
        ImportError: `optuna` is not installed.
        ValueError: an option out of range.

    Source: not in the paper; Bergstra et al. 2011, "Algorithms for hyper-parameter optimization".
    """
    optuna = needs("optuna", "tpe")
    check_relaxation(space, width, "random")
    if startup < 0:
        raise ValueError(f"startup is {startup}, but must be 0 or more")
    keys = [str(index) for index in range(space.attributes)]
    choices = {
        key: optuna.distributions.IntDistribution(0, count - 1)
        for key, count in zip(keys, space.bins, strict=True)
    }

    def new_study() -> Any:
        storage = optuna.storages.InMemoryStorage()
        # The library greets every new study; that is not ours to say.
        level = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        try:
            study = optuna.create_study(storage=storage, direction="maximize")
        finally:
            optuna.logging.set_verbosity(level)
        return study

    def tell(study: Any, actions: Any, rewards: Any) -> None:
        study.add_trials(
            optuna.trial.create_trial(
                params=dict(zip(keys, row, strict=True)), distributions=choices, value=reward
            )
            for row, reward in zip(actions, rewards, strict=True)
        )

    # The latest state and the study that was told it: telling all anew takes longer than the rest.
    latest: list[tuple[TpeState, Any]] = []

    def study_of(state: TpeState) -> Any:
        if latest and latest[0][0] is state:
            return latest[0][1]
        study = new_study()
        tell(study, state.actions, state.rewards)
        latest[:] = [(state, study)]
        return study

    def init(rng_key: Key[Array, ""]) -> TpeState:
        del rng_key  # nothing is random before the first sample
        return TpeState((), ())

    def sample(
        rng_key: Key[Array, ""], state: TpeState, n: int
    ) -> tuple[Int[Array, "n attributes"], Proposal]:
        study = study_of(state)
        # All that is random comes from here, so a study used before asks like a new one.
        study.sampler = optuna.samplers.TPESampler(
            n_startup_trials=startup,
            multivariate=multivariate,
            constant_liar=True,
            seed=int(jax.random.bits(rng_key, (), jnp.uint32)),
        )
        trials = [study.ask(choices) for _ in range(n)]
        for trial in trials:  # `update` adds them with their rewards; failed ones are not looked at
            study.tell(trial, state=optuna.trial.TrialState.FAIL)
        actions = np.asarray([[trial.params[key] for key in keys] for trial in trials], np.int32)
        return jnp.asarray(actions), relax(space, actions, width)

    def update(
        state: TpeState, actions: Int[Array, "n attributes"], rewards: Float[Array, "n"]
    ) -> tuple[TpeState, Info]:
        known = np.isfinite(rewards)
        info = plain_info(rewards, bins.entropy(probabilities(state)))
        new = tuple(map(tuple, np.asarray(actions)[known].tolist()))
        values = tuple(np.asarray(rewards, np.float64)[known].tolist())
        next_state = TpeState(state.actions + new, state.rewards + values)
        study = study_of(state)
        tell(study, new, values)
        latest[:] = [(next_state, study)]
        return next_state, info

    def solution(state: TpeState) -> Proposal:
        if not state.rewards:
            return relax(space, np.full(space.attributes, UNDECIDED, np.int32), width)
        best = state.actions[int(np.argmax(state.rewards))]
        return relax(space, np.asarray(best, np.int32), width)

    def probabilities(state: TpeState) -> Float[Array, "attributes bins"]:
        counts = np.array(bins.uniform(space))
        order = np.argsort(-np.asarray(state.rewards), kind="stable")
        for index in order[: -(-len(order) // 4)]:
            counts[np.arange(space.attributes), state.actions[index]] += 1
        return jnp.asarray(counts / counts.sum(axis=1, keepdims=True))

    def spread(state: TpeState) -> Proposal:
        return bins.spread(space, probabilities(state), width)

    return Method(
        init=init,
        sample=sample,
        update=update,
        solution=solution,
        spread=spread,
        probabilities=probabilities,
        updates=None,
    )
