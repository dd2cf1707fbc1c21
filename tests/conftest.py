"""What every test shares: JAX on the CPU, checked shapes, one hypothesis profile, the real data."""

import errno
import json
import os
import struct
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from subprocess import DEVNULL, Popen, run
from typing import Any

# Before jax is imported, and in the environment, so that worker processes follow.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Threads of OpenBLAS (XLA's Cholesky) spin, which is slow beyond measure beside another test process.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Compiling a training step takes seconds, loading it a tenth of that: the next test process loads.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")
# Tests run each program for a moment: compiled plainly in a sixth of the time, it runs at half the speed.
# XLA ends the process at a flag that it does not know, so only where these were tried.
if version("jaxlib").startswith("0.10."):
    PLAINLY = "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    os.environ.setdefault("XLA_FLAGS", f"{PLAINLY} --xla_cpu_parallel_codegen_split_count=1")
# Tests make what they look at, and leave the user's cache alone.
os.environ["SDR_JAX_CACHE"] = "off"

import hypothesis
import jax
import pytest
from jaxtyping import install_import_hook

ROOT = Path(__file__).resolve().parents[1]

# Shapes and types of public functions are checked in tests only. The hook sees what is imported
# after it, so nothing above may import our packages.
install_import_hook(["sdr_jax", "seg"], "beartype.beartype")

jax.config.update("jax_numpy_rank_promotion", "raise")
# Some tests evaluate in this process, behind the callback of a compiled step: JAX must not wait for a thread
# that the step holds.
jax.config.update("jax_cpu_enable_async_dispatch", False)
# Nor may it have one thread only, which is what a job that runs before JAX has started gives it.
jax.devices()

hypothesis.settings.register_profile("sdr", deadline=None, max_examples=30, derandomize=True)
hypothesis.settings.load_profile("sdr")


def printed(code: str, **environment: str) -> list[str]:
    """The lines that a fresh interpreter prints."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    options = {"cwd": ROOT, "env": environment, "capture_output": True, "text": True}
    done = run([sys.executable, "-c", code], stdin=DEVNULL, timeout=120, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def png_chunk(kind: bytes, data: bytes) -> bytes:
    """A part of a PNG, with its length and checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def packed_png(ids: Any, bits: int, colour_type: int) -> bytes:
    """A PNG of whole numbers [h, w] of so many bits: grey (0), or places in a palette (3)."""
    rows = b""
    for row in ids:
        digits = "".join(f"{value:0{bits}b}" for value in row)
        digits += "0" * (-len(digits) % 8)
        rows += b"\0" + int(digits, 2).to_bytes(len(digits) // 8, "big")
    header = struct.pack(">IIBBBBB", len(ids[0]), len(ids), bits, colour_type, 0, 0, 0)
    palette = png_chunk(b"PLTE", bytes((37 * k + 11) % 256 for k in range(3 * 2 ** min(bits, 8))))
    parts = (
        png_chunk(b"IHDR", header),
        palette * (colour_type == 3),
        png_chunk(b"IDAT", zlib.compress(rows)),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts) + png_chunk(b"IEND", b"")


def refused(error: type[Exception], message: str, call: Callable, *arguments, **options) -> Any:
    """With what a call ends: an error of this kind, whose words match."""
    with pytest.raises(error, match=message or None) as caught:
        call(*arguments, **options)
    return caught.value


def refuses(message: str, call: Callable, *arguments, error=ValueError, **options) -> None:
    """The call ends in an error that says so."""
    refused(error, message, call, *arguments, **options)


def gone(pid: int) -> bool:
    """Whether a process ends before long; one whose end nobody has asked for yet (Z) has ended."""
    with suppress(OSError):
        for _ in range(400):
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
            time.sleep(0.05)
        return False
    return True


def wait_for_lines(process: Popen, path: Path, count: int) -> None:
    """Returns as soon as a file of a running process has so many lines."""
    end = time.monotonic() + 240
    while not path.exists() or path.read_bytes().count(b"\n") < count:
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < end, f"{path} has too few lines"
        time.sleep(0.02)


@pytest.fixture(scope="session")
def camvid_dir() -> Path:
    """The folder of a real CamVid (SegNet layout), or a skip where there is none."""
    return _folder_of("CAMVID_DIR", "CamVid in the SegNet layout")


@pytest.fixture(scope="session")
def labelmefacade_dir() -> Path:
    """The folder of the real LabelMeFacade, or a skip where there is none."""
    return _folder_of("LABELMEFACADE_DIR", "LabelMeFacade")


def _folder_of(variable: str, what: str) -> Path:
    """What a variable of the environment names; without it the test is skipped."""
    if not (value := os.environ.get(variable)):
        pytest.skip(f"{variable} is not set: it names a folder with {what}")
    if not Path(value).is_dir():
        pytest.fail(f"{variable}={value} is not a folder; unset it to skip these tests")
    return Path(value)


class DaskCluster:
    """A scheduler on loopback and its workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        pytest.importorskip("distributed")
        self._folder, self.workers = folder, []
        file = folder / "scheduler.json"
        self.scheduler = self._dask("scheduler", "--port", "0", "--scheduler-file", str(file))
        wait_for_lines(self.scheduler, file, 2)
        time.sleep(0.2)
        self.address = json.loads(file.read_text())["address"]

    def start(self, *resources: str) -> Popen:
        """Starts a worker, which announces itself when it can."""
        own = ["--resources", *resources] if resources else []
        flags = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self._folder), *own)
        self.workers.append(self._dask("worker", self.address, *flags))
        return self.workers[-1]

    def _dask(self, *command: str) -> Popen:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        full = [sys.executable, "-m", "dask", *command, "--host", "127.0.0.1", "--no-dashboard"]
        quiet = {"stdin": DEVNULL, "stdout": DEVNULL, "stderr": DEVNULL}
        return Popen(full, cwd=self._folder, env=environment, **quiet)

    def stop(self) -> None:
        """Ends all of them, at once."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def dask_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """A scheduler with one worker."""
    cluster = DaskCluster(tmp_path_factory.mktemp("dask"))
    cluster.start()
    yield cluster
    cluster.stop()


@pytest.fixture
def filling_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Bytes reach their file, but the disk takes those of so many writes only."""
    fsync = os.fsync

    def fill(room: int) -> None:
        left = iter(range(room))

        def filling(descriptor: int) -> None:
            if next(left, None) is None:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            fsync(descriptor)

        monkeypatch.setattr(os, "fsync", filling)

    return fill


@pytest.fixture
def full_disk(filling_disk: Callable[[int], None]) -> None:
    """It takes none at all; ``monkeypatch.undo()`` makes room."""
    filling_disk(0)
