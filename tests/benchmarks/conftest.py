"""A folder of labelled images that benchmarks read."""

from zlib import crc32

import pytest

from tests.experiments.conftest import write_pair


@pytest.fixture
def camvid(tmp_path):
    """Four images in CamVid's layout, of three drives."""
    root = tmp_path / "camvid"
    for split, names in (("train", ("0001TP_1", "0006R0_1")), ("val", ("0016E5_0", "0016E5_1"))):
        for name in names:
            paths = (root / folder / f"{name}.png" for folder in (split, f"{split}annot"))
            write_pair(*paths, seed=crc32(name.encode()), highest=10)
    return root
