"""Help texts and wrong flags of all commands: short, readable at 80 columns, and without JAX."""

import json
import re
import shlex

import pytest

from common.command import Parser
from experiments.__main__ import COMMANDS, STUDIES, main, parser_of
from tests.conftest import printed

CODE = """
import contextlib, io, json, sys
from experiments.__main__ import COMMANDS, STUDIES, main
results = {}
for name in ["", "study", *COMMANDS]:
    words = ["study", name] if name in STUDIES else [name] if name else []
    for flag in ("--help", "--help-all", "--no-such-flag"):
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            try:
                code = main([*words, flag])
            except SystemExit as end:
                code = end.code
        loaded = sorted({module.split(".")[0] for module in sys.modules})
        results[f"{name} {flag}"] = code, output.getvalue(), loaded
print(json.dumps(results))
"""
HEAVY = {"jax", "jaxlib", "flax", "optax", "matplotlib", "trimesh", "embreex"}
MOST = 20
"""Options that a short help has, but for what all commands have."""


@pytest.fixture(scope="module")
def helps() -> dict[str, tuple[int, str, list[str]]]:
    """Exit code, words and loaded modules, by command and flag; all of one process, one after the other."""
    return json.loads(printed(CODE, COLUMNS="80")[-1])


def options(text: str) -> set[str]:
    return set(re.findall(r"^  (--[\w.-]+)", text, re.MULTILINE)) - {"--debug", "--help-all"}


@pytest.mark.parametrize("name", ["", "study", *COMMANDS])
def test_neither_help_nor_a_wrong_flag_needs_jax(name, helps):
    for flag, code in (("--help", 0), ("--help-all", 0), ("--no-such-flag", 2)):
        exit_code, text, loaded = helps[f"{name} {flag}"]
        assert not set(loaded) & HEAVY, flag
        if (
            flag == "--help-all"
            and name in COMMANDS
            and "--help-all" not in helps[f"{name} --help"][1]
        ):
            code = 2  # there is no more to tell
        assert exit_code == code and text.endswith("\n")
        if code:
            assert text.count("\n") == 1 and text.startswith("sdr-jax")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_is_short_and_fits_into_80_columns(name, helps):
    short, whole = (helps[f"{name} {flag}"][1] for flag in ("--help", "--help-all"))
    assert short.startswith(f"usage: sdr-jax {'study ' * (name in STUDIES)}{name}")
    assert max(map(len, (short + whole).splitlines())) <= 80
    assert len(options(short)) <= MOST
    if "--help-all" in short:
        assert options(short) < options(whole)
        count = int(re.search(r"show (\d+) more options", short)[1])
        assert count == len(options(whole) - options(short)) >= 1


def test_defaults_are_shown(helps):
    for name, part in (
        ("camvid", "(default: runs/camvid-quick)"), ("table", "(default: compact)"),
        ("render", "(default: 640x320)"), ("playground", "(default: 8420)"), ("fit", "(default: 3)"),
    ):  # fmt: skip
        assert part in helps[f"{name} --help"][1], name


def test_parsers_of_commands_are_called_as_the_commands_are():
    from experiments.config import parsers as ours
    from scene import parsers as of_scene

    lines = [getattr(module, name, None) for module in (ours, of_scene) for name in COMMANDS]
    assert sum(line is not None for line in lines) == 13
    for line, name in zip(lines, [*COMMANDS] * 2, strict=True):
        if line is not None:
            parser = line()
            assert isinstance(parser, Parser) and parser.prog == f"sdr-jax {name}"
            assert len(parser.description) > 20


def test_without_arguments_six_commands_are_shown_by_task(capsys):
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    commands = [shlex.split(line) for line in lines if line.startswith("  sdr-jax ")]
    assert len(commands) == 6 and max(map(len, lines)) <= 90
    for _, name, *words in commands:
        before = words.index("--") if "--" in words else len(words)
        assert parser_of(name).parse_args(words[:before])
    assert lines[-1].startswith("sdr-jax --help lists all commands")
