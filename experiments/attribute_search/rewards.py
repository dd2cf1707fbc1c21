"""The rewards of searches, which run behind the callback of a jitted step, without JAX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import sdr_jax
from common.errors import UserError
from experiments.attribute_search.plans import SearchPlan
from experiments.evaluation.job import Job, Result
from experiments.evaluation.runner import refuse_failed
from experiments.session.session import Session
from scene.attributes import names
from scene.held import hold
from scene.proposal import Proposal, random_proposal

PLACE = ("search", "update", "dataset")
"""Fields of a run's log for a reward's place."""


def embed(plan: SearchPlan, proposals: Any) -> Proposal:
    """Extend proposals f32[*batch, attributes of the subset] to the whole space.

    The other attributes are random, or held.
    """
    space = plan.config.space
    where = [names(space).index(name) for name in plan.subset]
    others = hold(random_proposal(space), plan.config.held)
    whole = []
    for values, random in zip(proposals, others, strict=True):
        array = np.broadcast_to(random, (*values.shape[:-1], len(random))).copy()
        array[..., where] = np.asarray(values)
        whole.append(array)
    return Proposal(*whole)


class Rewards:
    """Evaluates the data sets of one update after the other.

    Args:
        run: the run, whose reward's fidelity is used.
        plan: the search.
    """

    def __init__(self, run: Session[Any], plan: SearchPlan) -> None:
        self._run, self._plan = run, plan
        self._known = {
            tuple(line.get(name) for name in PLACE): line["key"] for line in run.evaluations.records
        }
        checkpoints = plan.config.search.checkpoints
        recipe = run.recipe(run.config.reward)._replace(checkpoints=checkpoints)
        self._job = Job(recipe, random_proposal(plan.config.space), 0, {}, "reward")
        run.runner.about(self._job)  # here, since it needs JAX
        self._update = 0
        self.results: list[Result] = []

    def __call__(self, data_sets: sdr_jax.DataSets) -> np.ndarray:
        """Rewards f32[n]; NaN for a failed evaluation.

        Raises:
            UserError: more than a tenth of the evaluations failed, or the log is from another run.
        """
        run, proposals = self._run, embed(self._plan, data_sets.proposals)
        jobs = [
            self._job._replace(
                source=run.with_few(run.config.reward, Proposal(*intervals)),
                seed=seed,
                notes={**self._place(k), "actions": actions},
            )
            for k, (*intervals, seed, actions) in enumerate(
                zip(*proposals, data_sets.seeds.tolist(), data_sets.actions.tolist(), strict=True)
            )
        ]
        self._refuse_another(jobs)
        results = run.runner.run(jobs, run.evaluations)
        self.results += results
        self._update += 1
        refuse_failed(self.results, self._plan.evaluations)
        return np.array([result.reward for result in results], np.float32)

    def _refuse_another(self, jobs: Sequence[Job]) -> None:
        """Raise UserError if the run folder has another reward at the place of a job."""
        for job in jobs:
            place, key = tuple(job.notes[name] for name in PLACE), self._run.runner.key(job)
            if self._known.get(place, key) != key:
                raise UserError(
                    f"{self._run.evaluations.path}: update {place[1]}, dataset {place[2]} was not made by "
                    "this run; use another --out"
                )

    def _place(self, dataset: int) -> dict[str, Any]:
        return {"search": self._plan.name, "update": self._update, "dataset": dataset}
