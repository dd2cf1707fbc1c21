"""How commands end: one line, and an exit code."""

import argparse
import errno
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from common import loopback
from common.command import BUG, UNREAD, Parser, exit_code, running_command, say, size
from common.errors import Unfinished, UserError, refuse_repeats, suggestion
from tests.conftest import ROOT, refused

FULL = OSError(errno.ENOSPC, "No space left on device", "x.json")
CURE = "once this is fixed, the same command resumes"
PRINT = "import sys; from common.command import *; sys.exit(exit_code(lambda: print('x' * {})))"


@pytest.mark.parametrize(("error", "code", "text"), [
    (None, 0, ""), (UserError("--out:\n  no"), 2, "error: --out: no\n"),
    (Unfinished("3 failed"), 1, "error: 3 failed\n"),
    (FULL, 2, f"error: x.json: No space left on device; {CURE}\n"),
    (OSError("odd"), 2, f"error: odd; {CURE}\n"),
    (EOFError("workers died"), 1, "error: workers died\n"),
    (MemoryError("8 GB"), 2, "error: out of memory: 8 GB; smaller sizes need less\n"),
    (KeyboardInterrupt(), 130, "\nstopped; the same command resumes\n"),
])  # fmt: skip
def test_an_error_is_one_line_and_a_code(error, code, text, capsys):
    assert exit_code(Mock(side_effect=error, return_value=None), also=(EOFError,)) == code
    assert capsys.readouterr() == ("", text)
    if error is FULL:
        assert exit_code(Mock(side_effect=error), resumes=False) == code
        assert capsys.readouterr().err == text.replace(f"; {CURE}", "")


def test_a_bug_says_where_and_with_debug_how(capsys):
    where = f"{Path(__file__).name}, line "
    codes = [exit_code(lambda: print(1 / 0), debug=debug) for debug in (False, True)]
    first, second, *_ = capsys.readouterr().err.splitlines()
    assert codes == [BUG] * 2 and second.startswith("Traceback ")
    assert "ZeroDivisionError: division by zero" in first and where in first


def test_a_job_knows_its_command_line_and_that_it_has_none_in_python():
    parser = Parser("fit", None)
    parser.add_argument("data")
    commands = []

    def work() -> None:
        commands.append(running_command())

    parser.parse_args(["my photos"])
    assert exit_code(work) == 0 and exit_code(work) == 0
    work()  # called from Python or a notebook, whatever started this process
    assert commands == ["sdr-jax fit 'my photos'", None, None]


@pytest.mark.parametrize("command", [
    ("-c", PRINT.format(1)), ("-c", PRINT.format(10**6)), ("-m", "experiments.cityscapes", "--help"),
])  # fmt: skip
def test_output_that_nobody_reads_is_no_error(command):
    """As with ``| head``, whether it fits into the buffer or not."""
    reading, writing = os.pipe()
    os.close(reading)
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    options = {"cwd": ROOT, "env": buffered, "stdout": writing, "stderr": subprocess.PIPE}
    done = subprocess.run([sys.executable, *command], **options)
    os.close(writing)
    assert (done.returncode, done.stderr) == (UNREAD, b"") and UNREAD == 141


def test_a_parser_says_what_is_wrong_in_one_line(capsys):
    parser = Parser("x", "One.\n\n    two  three\n")
    parser.add_argument("--count", type=int, required=True)
    for flags, words in (
        (["--coutn", "3"], "no option --coutn; did you mean --count?"),
        (["--colour", "--other"], "no option --colour"),
        (["--count", "x"], "invalid int value: 'x'"),
    ):
        refused(SystemExit, "^2$", parser.parse_args, flags)
        error = capsys.readouterr().err
        assert error.startswith("sdr-jax x: error: ") and words in error and error.count("\n") == 1
    assert "    two  three\n" in parser.format_help()


def test_a_help_keeps_to_the_width_and_leaves_rare_options_to_all_of_it(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    examples = (
        "    sdr-jax x DIR --often 7 --count 8 --rarely 9 --and-more 1  # a comment\n    sdr-jax x"
    )
    parser = Parser("x", f"One {'word ' * 30}.\n\n{examples}\n")
    parser.add_argument("--often", default=7, metavar="N", help="said")
    parser.group("the rest")("--rarely", default=0.5, metavar="N", help="too")
    short, whole = parser.format_help(), parser.format_help(True)
    assert "--often N   said (default: 7)" in short and "--rarely" not in short.split("\n\n", 3)[3]
    assert "show 1 more options: the rest" in short and "--rarely N  too (default: 0.5)" in whole
    assert max(map(len, whole.splitlines())) <= 60 and "    # a comment\n    sdr-jax x DIR" in whole
    for flag, text in (("--help", short), ("-h", short), ("--help-all", whole)):
        refused(SystemExit, "^0$", parser.parse_args, [flag])
        assert capsys.readouterr().out == text


@pytest.mark.parametrize(("word", "expected"), [
    ("rendr", "; did you mean render?"), ("xyz", ""), ("--fat", ""), ("--fitt", "; did you mean fit?"),
    ("--lr", "; did you mean --a.lr or --b.c.lr?"),
])  # fmt: skip
def test_similar_names_are_suggested(word, expected):
    assert suggestion(word, ["render", "fit", "--a.lr", "--b.c.lr", "--b.d.lr"]) == expected


@pytest.mark.parametrize(("rule", "words", "message"), [
    ("needs", ["--first", "3"], "--first needs --rank or --order"),
    ("needs", ["--first=3"], "--first needs"),
    ("needs", ["--first", "3", "--order=x"], ""),
    ("needs", ["--rank"], ""), ("needs", [], ""),
    ("excludes", ["--first", "3", "--rank"], "--first has no effect with --rank"),
    ("excludes", ["--first=3", "--order=x"], "--first has no effect with --order"),
    ("excludes", ["--first", "3"], ""), ("excludes", ["--rank", "--order=x"], ""),
])  # fmt: skip
def test_a_flag_may_need_or_exclude_another(rule, words, message, capsys):
    parser = Parser("x", "")
    for flag in ("--first", "--order"):
        parser.add_argument(flag)
    parser.add_argument("--rank", action="store_true")
    others = ("--rank", "--order")
    needs, excludes = (others, ()) if rule == "needs" else ((), others)
    parser.relations.append(("--first", needs, excludes))
    if not message:
        parser.parse_args(words)
        return
    refused(SystemExit, "^2$", parser.parse_args, words)
    assert message in capsys.readouterr().err


def test_sizes_and_repeats():
    assert size("640x320") == (640, 320)
    for text in ("640", "x320", "640x", "640x320x3", "axb", ""):
        refused(argparse.ArgumentTypeError, "must look like 640x320, not", size, text)
    refuse_repeats("--nets", ["a", "b"])
    with pytest.raises(UserError, match="--nets a b a has a value twice"):
        refuse_repeats("--nets", ["a", "b", "a"])


def test_control_characters_of_a_message_are_shown_not_sent(capsys):
    error = UserError("a\x1b[31m/é: no image")
    assert exit_code(Mock(side_effect=error)) == 2
    assert capsys.readouterr().err == "error: a\\x1b[31m/é: no image\n"
    say("a\x1b[31m\nb")
    assert capsys.readouterr().out == "a\\x1b[31m\nb\n"


@pytest.mark.parametrize(("origin", "host", "length", "status"), [
    ("http://127.0.0.1:8080", "127.0.0.1:8080", "0", 0), ("", "localhost:8080", "12", 0),
    ("http://[", "localhost:8080", "0", 403), ("http://evil", "localhost:8080", "0", 403),
    ("null", "localhost:8080", "0", 403), ("", "evil", "0", 400),
    ("", "localhost", "\xb2", 413), ("", "localhost", "9" * 5000, 413), ("", "localhost", "-1", 413),
])  # fmt: skip
def test_headers_of_any_form_have_a_status(origin, host, length, status):
    headers = {"origin": origin, "host": host, "content-length": length}
    assert loopback.refusal({name: value for name, value in headers.items() if value}) == status
