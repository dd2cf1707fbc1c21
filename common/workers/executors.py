"""The kinds of workers: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from common.errors import UserError
from common.workers.pool import ExecutorName, WorkerPool, Workers


def workers_of(
    executor: ExecutorName,
    workers: int,
    scheduler: str | None = None,
    environment: dict[str, str] | None = None,
    versions: Callable[[], Mapping[str, int | str]] = dict,
    trainers: int | None = None,
) -> Workers:
    """Make the workers of ``--executor``, ``--workers``, ``--trainers`` and ``--scheduler``.

    Args:
        executor: the kind of workers.
        workers: number of processes.
        scheduler: address of the cluster's scheduler.
        environment: variables that workers get before they import JAX.
        versions: gives the versions that workers of a cluster must share with this process.
        trainers: number of separate processes for networks. By default processes render and train; on a
            cluster the workers that announce a GPU are trainers.

    Raises:
        UserError: processes have a scheduler, a cluster has none, trainers, or one that does not answer, or
            the extra ``dask`` is not installed.
    """
    if executor == "processes":
        if scheduler is not None:
            raise UserError("--scheduler is for --executor dask")
        return WorkerPool(workers, environment, trainers)
    if trainers is not None:
        raise UserError(
            "--trainers is for --executor processes; on a cluster start trainers with: dask worker ADDRESS "
            "--nthreads 1 --resources GPU=1"
        )
    if scheduler is None:
        raise UserError("--executor dask needs --scheduler ADDRESS, which 'dask scheduler' prints")
    address = re.fullmatch(r"(?:[a-z]+://)?[^/]+:(\d{1,5})(?:/.*)?", scheduler)
    if not scheduler.startswith("inproc://") and not (address and 0 < int(address[1]) < 65536):
        raise UserError(
            f"--scheduler {scheduler}: no Dask scheduler answers there; expected an address with a port, "
            "such as tcp://10.0.0.1:8786, which 'dask scheduler' prints"
        )
    try:
        from common.workers.cluster import Cluster
    except ImportError as error:
        raise UserError(
            f"--executor dask needs the extra dask: pip install 'sdr-jax[dask]' ({error})"
        ) from None
    return Cluster(scheduler, environment, versions)
