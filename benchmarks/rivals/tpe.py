"""TPE, the tree-structured Parzen estimator, a host adapter of the library `optuna`."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.rivals import host
from sdr_jax.bins import ordered
from sdr_jax.distributions import moments, uniform
from sdr_jax.method import Bins, Diagnostics, Info, Method, Rewards, RngKey
from sdr_jax.relaxation import UNDECIDED
from sdr_jax.space import Proposal, Space, Width


class _Latest(NamedTuple):
    """The study of the latest state, kept since adding all evaluations to a new study takes long."""

    state: host.Evaluations
    study: Any  # the library's study, which has the evaluations of the state
    asked: list[Any]  # its trials that wait for a reward: the last sample
    actions: list[list[int]]  # their bins


def tpe(
    space: Space,
    *,
    width: Width = None,
    startup: int = 10,
    multivariate: bool = True,
) -> Method:
    """Model good and other evaluations separately, and propose bins where good ones are denser.

    Bins are ordered integers, so that neighbours share evidence, or categories if they have no order.
    Other options are the library's defaults. The n data sets of an update are asked for one after the
    other, and pending ones count as poor (the library's constant liar), which spreads them. The answer is
    the library's, the best data set so far, which under noise is partly the luckiest. Groups have no effect.

    This is a host adapter, which cannot be jitted: `drive` takes it, `run` does not. Otherwise it behaves
    like the pure methods: the same key gives the same data sets, and earlier states stay valid. The
    library gets the whole history again only if a state does not follow from the last one.

    `probabilities` and `spread` are estimated from the best quarter of the evaluations, and a uniform
    distribution with the weight of one evaluation.

    Args:
        space: the attributes and their bins.
        width: width of the relaxed bins, see `relax`.
        startup: number of random evaluations before the model is used.
        multivariate: whether to model attributes jointly (the library's default from 5.0 on).

    Returns:
        The method, for any number of updates.

    Raises:
        ImportError: `optuna` is not installed.
        ValueError: an option out of range.

    Source: not in the paper; Bergstra et al. 2011, "Algorithms for hyper-parameter optimization".
    """
    optuna = host.needs("optuna", "tpe")
    relaxed = host.relaxation(space, width)
    if startup < 0:
        raise ValueError(f"startup is {startup}, but must be 0 or more")
    prior = np.asarray(uniform(space))
    keys = [str(index) for index in range(space.attributes)]
    choices = {
        key: optuna.distributions.IntDistribution(0, count - 1)
        if in_order
        else optuna.distributions.CategoricalDistribution(range(count))
        for key, count, in_order in zip(keys, space.bins, ordered(space), strict=True)
    }

    def new_study() -> Any:
        storage = optuna.storages.InMemoryStorage()
        # The library reports every new study; our users need not read it.
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
            for row, reward in zip(actions.tolist(), rewards.tolist(), strict=True)
        )

    def forget(study: Any, trials: list[Any]) -> None:
        """Mark trials without a reward as failed, since the library ignores failed ones."""
        for trial in trials:
            study.tell(trial, state=optuna.trial.TrialState.FAIL)

    latest: _Latest | None = None

    def latest_of(state: host.Evaluations) -> _Latest:
        nonlocal latest
        if latest is None or latest.state is not state:
            latest = _Latest(state, new_study(), [], [])
            tell(latest.study, state.actions, state.rewards)
        return latest

    def init(rng_key: RngKey) -> host.Evaluations:
        del rng_key  # nothing is random before the first sample
        return host.no_evaluations(space)

    def sample(rng_key: RngKey, state: host.Evaluations, n: int) -> tuple[Bins, Proposal]:
        nonlocal latest
        before = latest_of(state)
        study = before.study
        forget(study, before.asked)
        # All randomness comes from this seed, so an old study proposes the same as a new one.
        study.sampler = optuna.samplers.TPESampler(
            n_startup_trials=startup,
            multivariate=multivariate,
            constant_liar=n > 1,  # a single data set needs no spreading
            seed=host.seed(rng_key),
        )
        trials = [study.ask(choices) for _ in range(n)]
        rows = [[params[key] for key in keys] for params in (trial.params for trial in trials)]
        latest = _Latest(state, study, trials, rows)
        actions = np.asarray(rows, np.int32)
        return jnp.asarray(actions), relaxed(actions)

    def update(
        state: host.Evaluations, actions: Bins, rewards: Rewards
    ) -> tuple[host.Evaluations, Info]:
        nonlocal latest
        info = host.info(rewards, probabilities(state))
        rows, values = np.asarray(actions, np.int32), np.asarray(rewards, np.float64)
        finite = np.isfinite(values)
        before = latest_of(state)
        if rows.tolist() == before.actions:
            for trial, value, good in zip(before.asked, values, finite, strict=True):
                if good:
                    before.study.tell(trial, value)
                else:
                    forget(before.study, [trial])
        else:
            forget(before.study, before.asked)
            tell(before.study, rows[finite], values[finite])
        next_state = host.with_new(state, rows, values)
        latest = _Latest(next_state, before.study, [], [])
        return next_state, info

    def solution(state: host.Evaluations) -> Proposal:
        if not len(state.rewards):
            return relaxed(np.full(space.attributes, UNDECIDED, np.int32))
        return relaxed(state.actions[np.argmax(state.rewards)])

    def probabilities(state: host.Evaluations) -> Float[Array, "attributes bins"]:
        return host.best_quarter(prior, state.actions, state.rewards)

    def spread(state: host.Evaluations) -> Proposal:
        return moments(space, probabilities(state), width)

    return Method(init, sample, update, solution, Diagnostics(spread, probabilities), traced=False)
