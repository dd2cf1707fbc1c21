"""The run as a whole: it asks, simulates in parallel and tells, until all evaluations are made."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from common.errors import Unfinished, UserError
from common.files import write, write_json
from common.folder import CONFIG, opened
from common.lines import JsonLines
from common.progress import Progress
from sdr_jax.ask_tell import AskTell
from sdr_jax.device import on_cpu
from sdr_jax.method import Method, clipping_message
from sdr_jax.registry import make
from sdr_jax.tune.settings import Settings
from sdr_jax.tune.simulator import Outcome, Simulator, check_command
from sdr_jax.tune.units import describe

FREE = ("evaluations", "timeout_seconds", "retries", "workers")
"""Fields that may differ when a run is continued; none of them changes an earlier evaluation."""

PACKAGES = ("sdr-jax", "jax", "numpy")
HISTORY, EVALUATIONS = "evaluations.jsonl", "evaluations"
"""The file of lines, and the folder of folders, of all evaluations."""
ANSWER, RETRIED = "answer.json", "retried.jsonl"
"""The files of the answer and of the lines of repeated evaluations."""

OUTAGE = 20
"""After so many failures in a row, and no fewer than two updates of them, the simulator counts as broken.
Fewer, or others between successes, are data: the attributes are infeasible."""


class _NeverWorked(UserError):
    """The first update has no score, so the simulator is broken."""


def tune(
    settings: Settings, command: Sequence[str], out: Path, *, retry_failed: bool = False
) -> dict[str, Any]:
    """Runs the whole optimisation, or the rest of it.

    Args:
        settings: the attributes, the method and the sizes.
        command: the simulator; `{attributes.json}` in it stands for the path of its input.
        out: the run folder, which is made if it does not exist.
        retry_failed: whether to take back all evaluations since the last series of failures began.

    Returns:
        The answer, as written to `answer.json`.

    Raises:
        UserError: an error that the user can mend.
        Unfinished: many evaluations failed in a row.
        OSError: the folder cannot be written.
    """
    check_command(command)
    method = _method(settings)
    config = {**asdict(settings), "command": list(command)}
    if retry_failed and not (out / HISTORY).exists():
        raise UserError(f"--out {out} has no evaluations to repeat; leave --retry-failed out")
    ours = EVALUATIONS, RETRIED, ANSWER
    try:
        with opened(out, config, free=FREE, ours=ours, packages=PACKAGES):
            if retry_failed:
                _take_back(_told(settings, method, out).history, out)
            answer = _search(settings, method, command, out)
            write_json(out / ANSWER, answer)
            return answer
    except _NeverWorked:
        # There is no run yet; the simulator's output stays, so that the user can look at it.
        for name in (HISTORY, CONFIG):
            (out / name).unlink(missing_ok=True)
        raise


@on_cpu()
def _method(settings: Settings) -> Method:
    """The method after a trial update, so that no option fails after hours of simulation."""
    n, width = settings.datasets_per_update, settings.relaxation
    try:
        method = make(settings.method, settings.space(), width, **settings.method_options)
        state = method.init(jax.random.key(0))
        actions, _ = method.sample(jax.random.key(0), state, n)
        method.update(state, actions, jnp.zeros(n))
    except (ImportError, TypeError, ValueError) as error:
        raise UserError(f"method {settings.method}: {error}") from None
    return method


def outage(history: Sequence[Mapping[str, Any]]) -> int | None:
    """The number of lines before the update in which a history's last series of failures begins.

    Args:
        history: lines with `update` and `reward`, which is None if the evaluation failed.

    Returns:
        The number; None if no evaluation of the last update failed.
    """
    first = failures = max(
        (k for k, line in enumerate(history) if line["reward"] is None), default=-1
    )
    if failures < 0 or history[failures]["update"] < history[-1]["update"]:
        return None
    while first > 0 and history[first - 1]["reward"] is None:
        first -= 1
    return next(k for k, line in enumerate(history) if line["update"] == history[first]["update"])


def _take_back(history: list[dict[str, Any]], out: Path) -> None:
    """Takes a history back to the point before its last failures; the lines are kept in a file."""
    kept = outage(history)
    if kept is None:
        raise UserError(
            f"the evaluations of --out {out} do not end in failures; leave --retry-failed out"
        )
    JsonLines(out / RETRIED).append(*history[kept:])
    write(out / HISTORY, (json.dumps(line) + "\n" for line in history[:kept]))
    print(
        f"--retry-failed repeats {len(history) - kept} evaluations; what was told of them is in "
        f"{out / RETRIED}",
        flush=True,
    )


def _told(settings: Settings, method: Method, out: Path) -> AskTell:
    n = settings.datasets_per_update
    return AskTell(settings.space(), method, n, settings.seed, out / HISTORY)


def _search(
    settings: Settings, method: Method, command: Sequence[str], out: Path
) -> dict[str, Any]:
    n, total = settings.datasets_per_update, settings.evaluations
    search = _told(settings, method, out)
    told = len(search.history)
    if told > total:
        raise UserError(
            f"--out {out} holds {told} evaluations already, but evaluations is {total}; ask for at "
            "least as many, or use another --out"
        )
    limits = settings.timeout_seconds, settings.retries, settings.repeats
    progress = Progress(total)
    simulator = Simulator(
        command, settings.attributes, out / EVALUATIONS, *limits, say=progress.say
    )
    progress.advance(told, replayed=True)
    if told:
        progress.say(f"continuing {out}: {told} of {total} evaluations are done")
    pool = ThreadPoolExecutor(settings.workers)
    try:
        _refuse_failures(search, told, command, out)
        while search.updates * n < total:
            _one_update(search, simulator, pool, progress, settings)
            _refuse_failures(search, told, command, out)
        return _answer(search, settings)
    finally:
        # On Ctrl-C, too, no simulator is left running, and the threads end.
        simulator.stop()
        pool.shutdown(cancel_futures=True)
        progress.close()


def _one_update(
    search: AskTell,
    simulator: Simulator,
    pool: ThreadPoolExecutor,
    progress: Progress,
    settings: Settings,
) -> None:
    update, clipped = search.updates, search.clipped
    updates = settings.evaluations // settings.datasets_per_update
    waiting = {pool.submit(simulator.evaluate, trial): trial.id for trial in search.ask()}
    for future in as_completed(waiting):
        outcome, id = future.result(), waiting[future]
        notes = {**outcome._asdict(), "seconds": round(outcome.seconds, 3)}
        search.tell(id, _reward(outcome, settings), **notes)
        progress.advance()
        if outcome.failures:
            tried = len(outcome.failures)
            what = "failed" if outcome.score is None else "has a score"
            attempts = "1 attempt" if tried == 1 else f"{tried} attempts"
            progress.say(f"evaluation {id} {what} after {attempts}: {outcome.failures[-1]}")
        if search.updates > update or sys.stdout.isatty():
            scores = _scores(search, update, settings.minimize)
            progress.update(f"update {update + 1}/{updates} | {scores}")
    if search.clipped and not clipped:
        progress.say(clipping_message(search.clipped, len(search.history)))


def _reward(outcome: Outcome, settings: Settings) -> float | None:
    if outcome.score is None:
        return None
    return -outcome.score if settings.minimize else outcome.score


def _scores(search: AskTell, update: int, minimize: bool) -> str:
    scored = [line for line in search.history if line["reward"] is not None]
    if not scored:
        return "no score yet"
    best = (min if minimize else max)(line["score"] for line in scored)
    latest = [line["score"] for line in scored if line["update"] == update]
    failed = len(search.history) - len(scored)
    mean = f"mean {math.fsum(latest) / len(latest):.4g}, " if latest else ""
    return f"{mean}best {best:.4g}" + (f", {failed} failed" if failed else "")


def _refuse_failures(search: AskTell, begun: int, command: Sequence[str], out: Path) -> None:
    """Raises an error if the simulator has never worked, or seems to have stopped working.

    Failures among the first `begun` lines of the history do not count, so that the same command goes on.
    """
    failed = [line for line in search.history if line["reward"] is None]
    if not failed:
        return
    reason = (failed[-1].get("failures") or ["no reason is known"])[-1]
    where = f"(its output is in {out / EVALUATIONS})"
    if search.updates == 1 and len(failed) == search.n:
        raise _NeverWorked(
            f"all {search.n} evaluations of the first update failed; the simulator "
            f"{' '.join(command)}: {reason} {where}"
        )
    latest = reversed(search.history[begun:])
    in_a_row = sum(1 for _ in takewhile(lambda line: line["reward"] is None, latest))
    if in_a_row >= max(OUTAGE, 2 * search.n):
        raise Unfinished(
            f"the last {in_a_row} evaluations failed; the last one: {reason} {where}; once the simulator "
            "works again, --retry-failed repeats them; the same command without it takes these attributes "
            "for infeasible and goes on"
        )


def _answer(search: AskTell, settings: Settings) -> dict[str, Any]:
    # Sorted by id, since lines stand in the order in which simulators ended.
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
