"""The whole job on a Dask cluster: a worker and a scheduler that die, and the answer of a local run."""

import pytest

from common.files import read_json
from tests.conftest import DaskCluster, wait_for_lines

from .conftest import TINY, lines
from .test_main_job import SCORES


@pytest.mark.slow
def test_on_a_cluster_it_ends_as_on_this_machine(unbroken, start_job, tmp_path_factory, out):
    finished = []
    for cut in (True, False):
        cluster = DaskCluster(tmp_path_factory.mktemp("dask"))
        try:
            victim, _ = cluster.start(), cluster.start()
            job = start_job(out, *TINY, "--executor", "dask", "--scheduler", cluster.address)
            if cut:
                wait_for_lines(job.process, out / "evaluations.jsonl", 2)
                victim.kill()
                wait_for_lines(job.process, out / "evaluations.jsonl", 6)
                cluster.scheduler.kill()
            finished.append(job.finish(timeout=900))
        finally:
            cluster.stop()
    (code, _, stderr), (end, stdout, nothing) = finished
    assert code == 2 and stderr.count("\n") == 1 and "the same command resumes" in stderr
    assert (end, nothing) == (0, "") and "/status" in stdout
    logs = (lines(folder / "evaluations.jsonl") for folder in (out, unbroken[0]))
    of_cluster, of_processes = (
        sorted((r["update"], r["dataset"], r["reward"]) for r in log) for log in logs
    )
    assert of_cluster == of_processes
    of_cluster, of_processes = (read_json(folder / "summary.json") for folder in (out, unbroken[0]))
    assert {k: of_cluster[k] for k in SCORES} == {k: of_processes[k] for k in SCORES}
    assert of_cluster["cpu_share"] is None and 0 < of_processes["cpu_share"] < 2
