"""All fine-tuned nets of a measurement: those that are known, and those that are left for the workers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from experiments.reward.evaluator import about
from experiments.reward.miou import Outcome, Recipe
from experiments.reward.shelf import sent
from experiments.reward.store import identity, record_of
from experiments.reward.transfer import Start, subsets, transfer
from experiments.reward.truth import part_of
from experiments.run.context import Run, refuse_failed, verdict
from experiments.run.ladder import cost_of, training_cost
from experiments.run.nets import paired_seeds
from seg.data import LabelledImages
from shell.files import digest
from shell.lines import Record


class Net(NamedTuple):
    """One fine-tuned net."""

    row: str
    fraction: float
    seed: int

    @property
    def notes(self) -> Record:
        """What the run's log says of it."""
        return {"nets": "pretrain", **self._asdict()}


def tuned(
    run: Run[Any],
    starts: Mapping[str, Start],
    fine: Recipe,
    fractions: Sequence[float],
    alike: int | None = None,
) -> dict[Net, Outcome]:
    """Fine-tune ``--seeds`` nets of every row at every fraction; a worker takes one (row, seed) at a time.

    Args:
        run: the job.
        starts: of the rows, by name.
        fine: how all nets are fine-tuned.
        fractions: shares of the reward images.
        alike: the seed that chooses the images of all nets, or each its own.

    Raises:
        UserError: more than a tenth of the nets failed.
    """
    real, truth = run.truth(fine.fidelity, "reward"), run.truth(fine.fidelity, "test")
    shared = {row: _about(run, start, fine, truth) for row, start in starts.items()}
    cost = {row: _cost(start, fine, len(fractions)) for row, start in starts.items()}
    chosen = {
        seed: dict(zip(fractions, subsets(len(real.images), fractions, of), strict=True))
        for seed in paired_seeds(run)
        for of in [seed if alike is None else alike]
    }
    keys, memory = {}, run.memory(run.finals)
    found: dict[Net, Outcome] = {}
    missing: dict[tuple[str, int], list[Net]] = {}
    memory.refresh()
    for seed, row, fraction in product(chosen, starts, fractions):
        net = Net(row, fraction, seed)
        own = part_of(real, chosen[seed][fraction])
        keys[net] = identity(shared[row]["config"], own, seed)
        known = memory.get(keys[net], net.notes)
        if known is None:
            missing.setdefault((row, seed), []).append(net)
        else:
            found[net] = known
            run.progress.advance(cost[row], replayed=True)
    order = sorted(missing, key=lambda each: -cost[each[0]] * len(missing[each]))  # longest first
    work = [missing[each] for each in order]
    parts = [
        (starts[row], seed, [chosen[seed][net.fraction] for net in missing[row, seed]])
        for row, seed in order
    ]
    tasks = _tasks(run, fine, real, truth, parts) if parts else []
    for index, outcomes in run.workers.map(transfer, tasks, net=True):
        row, _, seed = work[index][0]
        for net, outcome in zip(work[index], outcomes, strict=True):
            record = record_of(keys[net], real, seed, outcome) | shared[row]
            found[net] = memory.add(record, net.notes)
            run.progress.advance(cost[row])
        said = ", ".join(verdict(outcome) for outcome in outcomes)
        run.progress.update(f"{row}, seed {seed} | {said}")
    refuse_failed(list(found.values()), len(found))
    return found


def _tasks(
    run: Run[Any],
    fine: Recipe,
    real: LabelledImages,
    truth: LabelledImages,
    parts: Sequence[tuple[Start, int, list[np.ndarray]]],
) -> list[tuple]:
    """Arguments of `transfer` for every start, seed and list of subsets, real images in files."""
    shelf, train = run.shelf, fine.fidelity.train
    own, scoring = shelf.put(real, train, training=True), shelf.put(truth, train)
    fine = sent(shelf.normalised(fine, run.target), run.workers)
    tasks = []
    for start, seed, chosen in parts:
        recipe = sent(start.recipe, run.workers)
        recipe = recipe._replace(statistics=fine.statistics)  # of the same size
        tasks.append((start._replace(recipe=recipe), fine, seed, own, chosen, scoring))
    return tasks


def _about(run: Run[Any], start: Start, fine: Recipe, truth: LabelledImages) -> Record:
    """What all nets of a row share: ``config`` is a hash of all but their images and their seed."""
    found = about(fine, run.target, "test", truth)
    if start.proposal is None and not start.on_subset:
        return found  # as any net that is trained on the same images
    before = about(start.recipe, run.target, "test", truth)["config"]
    if start.proposal is not None:
        before = identity(before, start.proposal, 0)
    return {**found, "config": digest([before, found["config"]])[:16]}


def _cost(start: Start, fine: Recipe, fractions: int) -> float:
    """Of one net, with its share of what comes before the fine-tuning."""
    own = training_cost(fine.fidelity)
    if start.on_subset:
        return own + training_cost(start.recipe.fidelity)
    return own + (0.0 if start.proposal is None else cost_of(start.recipe.fidelity) / fractions)
