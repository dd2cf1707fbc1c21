"""How commands end: one line, and an exit code."""

import argparse
import errno
import os
import subprocess
import sys

import pytest

from shell.command import INTERRUPTED, UNREAD, USAGE, Parser, exit_code, size
from shell.errors import UserError, refuse_repeats


def ends(error: BaseException | None) -> int:
    def work() -> None:
        if error is not None:
            raise error

    return exit_code(work, also=(EOFError,))


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (None, 0, ""),
        (UserError("--out:\n  no"), USAGE, "error: --out: no\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "x.json"),
            USAGE,
            "error: x.json: No space left on device; once that is put right, the same command goes on\n",
        ),
        (OSError("odd"), USAGE, "error: odd; once that is put right, the same command goes on\n"),
        (EOFError("workers died"), 1, "error: workers died\n"),
        (KeyboardInterrupt(), INTERRUPTED, "\nstopped; the same command goes on where it was\n"),
    ],
)
def test_what_went_wrong_is_one_line_and_a_code(error, code, text, capsys):
    assert ends(error) == code
    assert capsys.readouterr() == ("", text)


def test_our_own_mistakes_are_not_hidden():
    with pytest.raises(ZeroDivisionError):
        ends(ZeroDivisionError())
    assert (USAGE, INTERRUPTED, UNREAD) == (2, 130, 141)


@pytest.mark.parametrize("length", [1, 10**6])
def test_output_that_nobody_reads_is_no_error(length):
    """As of ``| head``, whether it fits into the buffer or not."""
    code = f"from shell.command import *; sys.exit(exit_code(lambda: print('x' * {length})))"
    reading, writing = os.pipe()
    os.close(reading)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    try:
        done = subprocess.run(
            [sys.executable, "-c", f"import sys; {code}"],
            stdout=writing, stderr=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (UNREAD, "")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OSError(errno.ENOENT, "No such file", "a.obj"), "a.obj: No such file"),
        (OSError("odd"), "odd"),
        (UserError("a\nb"), "a b"),
    ],
)
def test_a_parser_says_what_is_wrong_in_one_line(error, text, capsys):
    with pytest.raises(SystemExit) as end:
        Parser("scene.x", None).fail(error)
    assert end.value.code == USAGE
    assert capsys.readouterr() == ("", f"python -m scene.x: error: {text}\n")


def test_flags_are_not_abbreviated_and_help_is_as_it_is_laid_out(capsys):
    parser = Parser("scene.x", "One.\n\n    two  three\n")
    parser.add_argument("--count", type=int)
    for flags, words in ((["--co", "3"], "--co 3"), (["--count", "x"], "invalid int value: 'x'")):
        with pytest.raises(SystemExit):
            parser.parse_args(flags)
        said = capsys.readouterr().err
        assert words in said and said.count("\n") == 1
    assert "    two  three\n" in parser.format_help()


@pytest.mark.parametrize("text", ["640", "x320", "640x", "640x320x3", "axb", ""])
def test_sizes(text):
    assert size("640x320") == (640, 320)
    with pytest.raises(argparse.ArgumentTypeError, match="must look like 640x320, not"):
        size(text)


def test_repeats_are_refused():
    refuse_repeats("--nets", ["a", "b"])
    with pytest.raises(UserError, match="--nets a b a names one of them twice"):
        refuse_repeats("--nets", ["a", "b", "a"])
