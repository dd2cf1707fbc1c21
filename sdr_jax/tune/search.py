"""A whole run: ask, simulate in parallel and tell, until all evaluations are made."""

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
from sdr_jax.method import Method, clipping_message
from sdr_jax.registry import make
from sdr_jax.run import on_cpu
from sdr_jax.tune.settings import Settings
from sdr_jax.tune.simulator import Outcome, Simulator, check_command
from sdr_jax.tune.units import describe

FREE = ("evaluations", "timeout_seconds", "retries", "workers")
"""Fields that may differ when a run is resumed; none of them changes an earlier evaluation."""

PACKAGES = ("sdr-jax", "jax", "numpy")
HISTORY, EVALUATIONS = "evaluations.jsonl", "evaluations"
"""The file with one line per evaluation, and the folder with one folder per evaluation."""
ANSWER, RETRIED = "answer.json", "retried.jsonl"
"""The file of the answer, and the file of lines that --retry-failed has removed."""

FIRST = 3
"""If all of so many first evaluations fail, and the whole first update, the simulator has never worked."""

OUTAGE = 20
"""After so many failures in a row, at least two updates of them, the simulator counts as broken. Fewer, or
failures between successes, are data: these attributes are infeasible."""


class _NeverWorked(UserError):
    """None of the first evaluations has a score, so the simulator is broken."""


def tune(
    settings: Settings, command: Sequence[str], out: Path, *, retry_failed: bool = False
) -> dict[str, Any]:
    """Run the whole optimisation, or the rest of it.

    Args:
        settings: the attributes, the method and the sizes.
        command: the simulator; `{attributes.json}` in it stands for the path of its input.
        out: the run folder, created if it does not exist.
        retry_failed: whether to repeat all evaluations since the last series of failures began.

    Returns:
        The answer, as written to `answer.json`.

    Raises:
        UserError: an error that the user can fix.
        Unfinished: many evaluations failed in a row.
        OSError: the folder cannot be written.
    """
    check_command(command)
    method = _method(settings)
    config = {**asdict(settings), "command": list(command)}
    if retry_failed and not (out / HISTORY).exists():
        raise UserError(f"--out {out} has no evaluations to repeat; remove --retry-failed")
    outputs = EVALUATIONS, RETRIED, ANSWER
    try:
        with opened(out, config, free=FREE, allowed=outputs, packages=PACKAGES):
            if retry_failed:
                _remove_failures(_resumed(settings, method, out).history, out)
            answer = _search(settings, method, command, out)
            write_json(out / ANSWER, answer)
            return answer
    except _NeverWorked:
        # There is no run yet; the simulator's output stays for the user to read.
        for name in (HISTORY, CONFIG):
            (out / name).unlink(missing_ok=True)
        raise


@on_cpu()
def _method(settings: Settings) -> Method:
    """Make the method, and try one update, so that no option fails after hours of simulation."""
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
    """Count the lines before the update in which the last series of failures of a history begins.

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


def _remove_failures(history: list[dict[str, Any]], out: Path) -> None:
    """Cut a history before its last series of failures; its lines move to another file."""
    count = outage(history)
    if count is None:
        raise UserError(
            f"the evaluations of --out {out} do not end in failures; remove --retry-failed"
        )
    JsonLines(out / RETRIED).append(*history[count:])
    write(out / HISTORY, (json.dumps(line) + "\n" for line in history[:count]))
    print(
        f"--retry-failed repeats {len(history) - count} evaluations; their former results are in "
        f"{out / RETRIED}",
        flush=True,
    )


def _resumed(settings: Settings, method: Method, out: Path) -> AskTell:
    """The search, with the rewards of the run folder."""
    n = settings.datasets_per_update
    return AskTell(settings.space(), method, n, settings.seed, out / HISTORY)


def _search(
    settings: Settings, method: Method, command: Sequence[str], out: Path
) -> dict[str, Any]:
    n, total = settings.datasets_per_update, settings.evaluations
    search = _resumed(settings, method, out)
    done = len(search.history)
    if done > total:
        raise UserError(
            f"--out {out} already has {done} evaluations, but evaluations is {total}; ask for at least as "
            "many, or use another --out"
        )
    limits = settings.timeout_seconds, settings.retries, settings.repeats
    progress = Progress(total)
    simulator = Simulator(
        command, settings.attributes, out / EVALUATIONS, *limits, say=progress.say
    )
    progress.advance(done, replayed=True)
    if done:
        progress.say(f"resuming {out}: {done} of {total} evaluations are done")
    pool = ThreadPoolExecutor(settings.workers)
    try:
        _refuse_outage(search, done, total, command, out)
        while search.updates * n < total:
            _one_update(search, simulator, pool, progress, settings)
            _refuse_outage(search, done, total, command, out)
        return _answer(search, settings)
    finally:
        # After Ctrl-C, too, no simulator keeps running and the threads end.
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


def _refuse_outage(
    search: AskTell, earlier: int, total: int, command: Sequence[str], out: Path
) -> None:
    """Raise an error if the simulator has never worked, or seems to have stopped working.

    Failures among the `earlier` lines of the history, those before this session, do not count, so that the
    same command resumes after an outage.
    """
    failed = [line for line in search.history if line["reward"] is None]
    if not failed:
        return
    reason = (failed[-1].get("failures") or ["unknown reason"])[-1]
    where = f"(its output is in {out / EVALUATIONS})"
    done = len(search.history)
    if len(failed) == done >= max(search.n, min(FIRST, total)):
        raise _NeverWorked(
            f"all of the first {done} evaluations failed; the simulator {' '.join(command)}: {reason} {where}"
        )
    latest = reversed(search.history[earlier:])
    in_a_row = sum(1 for _ in takewhile(lambda line: line["reward"] is None, latest))
    if in_a_row >= max(OUTAGE, 2 * search.n):
        raise Unfinished(
            f"the last {in_a_row} evaluations failed; the last one: {reason} {where}; once the simulator "
            "works again, --retry-failed repeats them; without it, the same command resumes and takes "
            "these attributes for infeasible"
        )


def _answer(search: AskTell, settings: Settings) -> dict[str, Any]:
    # Sorted by id: lines are in the order in which simulators ended.
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
