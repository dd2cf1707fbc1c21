"""A folder of labelled images that benchmarks read, and what they refuse."""

import sys
from zlib import crc32

import pytest

from tests.experiments.conftest import write_pair


@pytest.fixture
def camvid(tmp_path):
    """Five images in CamVid's layout, of three sequences, one of them in the test split."""
    root, val = tmp_path / "camvid", ("0016E5_0", "0016E5_1")
    splits = {"train": ("0001TP_1", "0006R0_1"), "val": val, "test": ("0001TP_0",)}
    for split, names in splits.items():
        for name in names:
            paths = (root / folder / f"{name}.png" for folder in (split, f"{split}annot"))
            write_pair(*paths, seed=crc32(name.encode()), highest=10)
    return root


@pytest.fixture
def refused(capsys):
    """Asserts that a command ends with code 2 and a complaint on its last line."""

    def refuse(main, command, complaint):
        with pytest.raises(SystemExit, match=r"^2$"):
            sys.exit(main(command))
        assert complaint in capsys.readouterr().err.splitlines()[-1]

    return refuse
