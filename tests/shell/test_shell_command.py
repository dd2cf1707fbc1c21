"""How commands end: one line, and an exit code."""

import argparse
import errno
import os
import subprocess
import sys

import pytest

from shell.command import UNREAD, Parser, exit_code, size
from shell.errors import UserError, refuse_repeats
from tests.conftest import ROOT

FULL = OSError(errno.ENOSPC, "No space left on device", "x.json")
CURE = "once that is put right, the same command goes on"
PRINT = "import sys; from shell.command import *; sys.exit(exit_code(lambda: print('x' * {})))"


@pytest.mark.parametrize(("error", "code", "text"), [
    (None, 0, ""), (UserError("--out:\n  no"), 2, "error: --out: no\n"),
    (FULL, 2, f"error: x.json: No space left on device; {CURE}\n"),
    (OSError("odd"), 2, f"error: odd; {CURE}\n"),
    (EOFError("workers died"), 1, "error: workers died\n"),
    (KeyboardInterrupt(), 130, "\nstopped; the same command goes on where it was\n"),
])  # fmt: skip
def test_what_went_wrong_is_one_line_and_a_code(error, code, text, capsys):
    def work() -> None:
        if error is not None:
            raise error

    assert exit_code(work, also=(EOFError,)) == code
    assert capsys.readouterr() == ("", text)
    with pytest.raises(ZeroDivisionError):  # our own mistakes are not hidden
        exit_code(lambda: print(1 / 0))


@pytest.mark.parametrize("command", [
    ("-c", PRINT.format(1)), ("-c", PRINT.format(10**6)), ("-m", "experiments.cityscapes", "--help"),
])  # fmt: skip
def test_output_that_nobody_reads_is_no_error(command):
    """As of ``| head``, whether it fits into the buffer or not."""
    reading, writing = os.pipe()
    os.close(reading)
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    options = {"cwd": ROOT, "env": buffered, "stdout": writing, "stderr": subprocess.PIPE}
    done = subprocess.run([sys.executable, *command], **options)
    os.close(writing)
    assert (done.returncode, done.stderr) == (UNREAD, b"") and UNREAD == 141


@pytest.mark.parametrize(("error", "text"), [
    (FULL, "x.json: No space left on device"),
    (OSError("odd"), "odd"), (UserError("a\nb"), "a b"),
])  # fmt: skip
def test_a_parser_says_what_is_wrong_in_one_line(error, text, capsys):
    parser = Parser("scene.x", "One.\n\n    two  three\n")
    parser.add_argument("--count", type=int)
    with pytest.raises(SystemExit) as end:
        parser.fail(error)
    assert end.value.code == 2
    assert capsys.readouterr() == ("", f"python -m scene.x: error: {text}\n")
    for flags, words in ((["--co", "3"], "--co 3"), (["--count", "x"], "invalid int value: 'x'")):
        with pytest.raises(SystemExit):
            parser.parse_args(flags)
        said = capsys.readouterr().err
        assert words in said and said.count("\n") == 1
    assert "    two  three\n" in parser.format_help()


def test_sizes_and_repeats():
    assert size("640x320") == (640, 320)
    for text in ("640", "x320", "640x", "640x320x3", "axb", ""):
        with pytest.raises(argparse.ArgumentTypeError, match="must look like 640x320, not"):
            size(text)
    refuse_repeats("--nets", ["a", "b"])
    with pytest.raises(UserError, match="--nets a b a names one of them twice"):
        refuse_repeats("--nets", ["a", "b", "a"])
