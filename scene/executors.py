"""Who works: processes of this machine, or a Dask cluster."""

from __future__ import annotations

from scene.workers import ExecutorName, WorkerPool, Workers
from shell.errors import UserError


def workers_of(
    executor: ExecutorName,
    workers: int,
    scheduler: str | None = None,
    environment: dict[str, str] | None = None,
) -> Workers:
    """The workers that ``--executor``, ``--workers`` and ``--scheduler`` ask for.

    Raises:
        UserError: a scheduler for processes, none for a cluster, or one that does not answer; the extra
            ``dask`` is not installed.
    """
    if executor == "processes":
        if scheduler is not None:
            raise UserError("--scheduler is for --executor dask")
        return WorkerPool(workers, environment)
    if scheduler is None:
        raise UserError("--executor dask needs --scheduler ADDRESS, which 'dask scheduler' prints")
    try:
        from scene.cluster import Cluster
    except ImportError as error:
        raise UserError(
            f"--executor dask needs the extra dask: pip install -e '.[dask]' ({error})"
        ) from None
    return Cluster(scheduler, environment)
