"""The run as a whole: ask, simulate in parallel, tell, until the evaluations are spent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from sdr_jax.ask_tell import AskTell
from sdr_jax.tune import methods
from sdr_jax.tune.disk import write_json
from sdr_jax.tune.errors import TuneError
from sdr_jax.tune.folder import RunFolder
from sdr_jax.tune.progress import Progress
from sdr_jax.tune.settings import Settings
from sdr_jax.tune.simulator import Outcome, Simulator, check_command
from sdr_jax.tune.units import describe


def tune(settings: Settings, command: Sequence[str], out: Path) -> dict[str, Any]:
    """Runs the whole optimisation, or what is left of it.

    Args:
        settings: what to optimise and how.
        command: the simulator; `{attributes.json}` in it stands for the path of its input.
        out: the run folder, made if need be.

    Returns:
        The answer, as written to `answer.json`.

    Raises:
        TuneError: something that the user can put right.
        OSError: the folder cannot be written.
    """
    check_command(command)
    space = settings.space()
    n = settings.datasets_per_update
    width, options = settings.relaxation, settings.method_options
    method = methods.make(settings.method, space, width, n, options)
    folder = RunFolder(out, settings, command)
    simulator = Simulator(
        command,
        settings.attributes,
        folder.evaluations,
        timeout=settings.timeout_seconds,
        retries=settings.retries,
        repeats=settings.repeats,
    )
    pool = ThreadPoolExecutor(settings.workers)
    try:
        try:
            search = AskTell(space, method, n, settings.seed, folder.history)
        except ValueError as error:
            raise TuneError(str(error)) from None
        told = len(search.history)
        if told > settings.evaluations:
            raise TuneError(
                f"--out {out} holds {told} evaluations already, but evaluations is "
                f"{settings.evaluations}; ask for at least as many, or use another --out"
            )
        progress = Progress(settings.evaluations, told)
        if told:
            progress.say(f"continuing {out}: {told} of {settings.evaluations} evaluations are done")
        _refuse_if_all_failed(search, folder, command)
        while search.updates * n < settings.evaluations:
            _one_update(search, simulator, pool, progress, settings)
            _refuse_if_all_failed(search, folder, command)
        answer = _answer(search, settings)
        write_json(out / "answer.json", answer)
        return answer
    finally:
        # Also on Ctrl-C: nothing is left running, and the threads end.
        simulator.stop()
        pool.shutdown(cancel_futures=True)
        folder.close()


def _one_update(
    search: AskTell,
    simulator: Simulator,
    pool: ThreadPoolExecutor,
    progress: Progress,
    settings: Settings,
) -> None:
    update = search.updates
    waiting = {pool.submit(simulator.evaluate, trial): trial.id for trial in search.ask()}
    for future in as_completed(waiting):
        outcome, id = future.result(), waiting[future]
        search.tell(id, _reward(outcome, settings), **_notes(outcome))
        progress.advance()
        attempts = (
            "1 attempt" if len(outcome.failures) == 1 else f"{len(outcome.failures)} attempts"
        )
        if outcome.score is None:
            progress.say(f"evaluation {id} failed after {attempts}: {outcome.failures[-1]}")
        elif outcome.failures:
            progress.say(f"evaluation {id} has a score after {attempts}: {outcome.failures[-1]}")
        updates = settings.evaluations // settings.datasets_per_update
        progress.show(
            f"update {update + 1}/{updates} | {_scores(search, update, settings.minimize)}",
            whole_update=search.updates > update,
        )


def _reward(outcome: Outcome, settings: Settings) -> float | None:
    if outcome.score is None:
        return None
    return -outcome.score if settings.minimize else outcome.score


def _notes(outcome: Outcome) -> dict[str, Any]:
    return {
        "score": outcome.score,
        "scores": outcome.scores,
        "failures": outcome.failures,
        "seconds": round(outcome.seconds, 3),
    }


def _scores(search: AskTell, update: int, minimize: bool) -> str:
    scored = [line for line in search.history if line["reward"] is not None]
    if not scored:
        return "no score yet"
    best = (min if minimize else max)(line["score"] for line in scored)
    latest = [line["score"] for line in scored if line["update"] == update]
    failed = len(search.history) - len(scored)
    mean = f"mean {math.fsum(latest) / len(latest):.4g}, " if latest else ""
    return f"{mean}best {best:.4g}" + (f", {failed} failed" if failed else "")


def _refuse_if_all_failed(search: AskTell, folder: RunFolder, command: Sequence[str]) -> None:
    """A first update without a single score is a broken simulator, not bad luck."""
    first = [line for line in search.history if line["update"] == 0]
    if len(first) < search.n or any(line["reward"] is not None for line in first):
        return
    reason = first[0].get("failures") or ["no reason is known"]
    folder.forget()
    raise TuneError(
        f"all {search.n} evaluations of the first update failed; the simulator "
        f"{' '.join(command)}: {reason[-1]} (its output is in {folder.evaluations})"
    )


def _answer(search: AskTell, settings: Settings) -> dict[str, Any]:
    # By id: lines stand in the order in which simulators ended.
    lines = sorted(search.history, key=lambda line: line["id"])
    scored = [line for line in lines if line["reward"] is not None]
    best = max(scored, key=lambda line: line["reward"])
    return {
        "solution": describe(settings.attributes, search.solution()),
        "spread": describe(settings.attributes, search.spread()),
        "method": settings.method,
        "evaluations": len(lines),
        "failed": len(lines) - len(scored),
        "best": {"evaluation": best["id"], "score": best["score"]},
        "mean_score": math.fsum(line["score"] for line in scored) / len(scored),
    }
