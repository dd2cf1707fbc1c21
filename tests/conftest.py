"""What every test shares: JAX on the CPU, checked shapes, one hypothesis profile, the real data."""

import errno
import os
from pathlib import Path

# Before jax is imported, and in the environment, so that worker processes follow.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Threads of OpenBLAS (XLA's Cholesky) spin, which is slow beyond measure beside another test process.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Compiling a training step takes seconds, loading it a tenth of that: the next test process loads.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")

import hypothesis
import jax
import pytest
from jaxtyping import install_import_hook

# Shapes and types of public functions are checked in tests only. The hook sees what is imported
# after it, so nothing above may import our packages.
install_import_hook(["sdr_jax", "seg"], "beartype.beartype")

jax.config.update("jax_numpy_rank_promotion", "raise")

hypothesis.settings.register_profile("sdr", deadline=None, max_examples=30, derandomize=True)
hypothesis.settings.load_profile("sdr")


@pytest.fixture(scope="session")
def camvid_dir() -> Path:
    """The folder of a real CamVid (SegNet layout), or a skip where there is none."""
    value = os.environ.get("CAMVID_DIR")
    if not value:
        pytest.skip("CAMVID_DIR is not set: it names a folder with CamVid in the SegNet layout")
    path = Path(value)
    if not path.is_dir():
        pytest.fail(f"CAMVID_DIR={value} is not a folder; unset it to skip these tests")
    return path


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes reach their file, but the disk takes none of them; ``monkeypatch.undo()`` makes room."""

    def fsync(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fsync)
