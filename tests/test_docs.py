"""What README and pages show works as it stands there: Python is run, commands are parsed.

One rule for all: a ```python block is run, page by page from top to bottom, in an empty folder; in every
other block a line that begins with `sdr-jax`, `python -m` or `make` is parsed by the command that it names.
A ```py block needs what we do not install; tests/test_other_tools.py runs it where it is.
"""

import argparse
import ast
import json
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from common.command import Parser
from common.labels.target_file import parse_target
from experiments.__main__ import main as sdr_jax
from experiments.config.cli import configured
from experiments.config.jobs import JOBS
from seg.nets.backbones import BACKBONES
from tests.conftest import ROOT

FILES = (ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"))
FILES = [*FILES, *(path for d in ("docs", "examples") for path in sorted((ROOT / d).rglob("*.md")))]
PAGES = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in FILES}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SLOW = ("docs/engine.md", "docs/tutorial.md")
SIMULATOR = "docs/howto/simulator.md"


def blocks(page: str, python: bool) -> list[str]:
    return [text for kind, text in FENCE.findall(PAGES[page]) if (kind == "python") == python]


def commands(page: str) -> list[tuple[str, ...]]:
    """Words of each command, without its comment and what stands before it."""
    lines = "\n".join(blocks(page, python=False)).replace("\\\n", " ").splitlines()
    plain = (re.sub(r"\$\([^)]*\)", "OUTPUT", line) for line in lines)
    bare = (re.sub(r"^([A-Z_]+=\S+ )+|^\.venv/bin/", "", line) for line in plain)
    own = (line for line in bare if re.match(r"(sdr-jax|python -m|make) ", line))
    return [tuple(shlex.split(line, comments=True)) for line in own]


def ran(page: str, first: int = 0) -> dict:
    """The names that a page's blocks, from the first or a later one on, leave."""
    scope: dict = {"__name__": page}
    for block in blocks(page, python=True)[first:]:
        exec(compile(block, page, "exec"), scope)
    return scope


WITH_PYTHON = [page for page in PAGES if blocks(page, python=True) and page != SIMULATOR]


@pytest.mark.parametrize("page", [
    pytest.param(page, marks=pytest.mark.slow if page in SLOW else ()) for page in WITH_PYTHON
])  # fmt: skip
def test_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with patch.dict(BACKBONES):  # a page adds one
        assert ran(page)


def test_the_examples_of_a_simulator_learn_and_go_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    learnt = np.asarray(ran(SIMULATOR)["learnt"].centre)
    assert np.abs(learnt - [0.85, 0.25, 0.45]).max() < 0.25
    history = Path("history.jsonl").read_text()
    assert ran(SIMULATOR, first=-1)["search"].updates == 10
    assert Path("history.jsonl").read_text() == history


OURS = ("common", "experiments", "scene", "sdr_jax", "seg")


def examples() -> Iterator[tuple[str, str]]:
    """The Python of every page, notebook and example, with its place."""
    for page, text in PAGES.items():
        yield from ((page, code) for kind, code in FENCE.findall(text) if kind in ("python", "py"))
    for path in sorted((ROOT / "examples").rglob("*.py")):
        yield path.name, path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "examples").rglob("*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                lines = "".join(cell["source"]).splitlines()
                plain = (re.sub(r"^( *)%.*", r"\1pass", line) for line in lines)
                yield path.name, "\n".join(plain)


def test_examples_import_from_the_top_of_our_packages():
    deep = []
    for place, code in examples():
        for node in ast.walk(ast.parse(code)):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                names = [node.module]
            ours = [name for name in names if name.partition(".")[0] in OURS]
            deep += [(place, name) for name in ours if "." in name or name == "common"]
    assert deep == []


@pytest.fixture
def only_parsed(monkeypatch):
    """Commands end, with code 0, when their arguments are parsed and go together."""
    plain, ours = argparse.ArgumentParser.parse_args, Parser.parse_args

    def parse_only(self, *arguments, **options):
        if not isinstance(self, Parser):
            plain(self, *arguments, **options)
            sys.exit(0)
        return plain(self, *arguments, **options)  # it checks which options go together

    def parse_ours(self, *arguments, **options):
        values = vars(ours(self, *arguments, **options))
        if (name := self.prog.split()[-1]) in JOBS:
            configured(name, {key: value for key, value in values.items() if key != "debug"})
        sys.exit(0)

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_only)
    monkeypatch.setattr(Parser, "parse_args", parse_ours)


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
def test_commands_are_real(page, only_parsed, monkeypatch, capsys):
    for words in commands(page):
        program, name, *rest = words[1:] if words[0] == "python" else words
        if program == "make":
            assert f"\n{name}:" in (ROOT / "Makefile").read_text(), words
        if program == "make" or name.startswith("--"):
            continue
        with pytest.raises(SystemExit) as ended:
            if program == "sdr-jax":
                sdr_jax([name, *rest])
            monkeypatch.setattr(sys, "argv", [name, *rest])
            runpy.run_module(name, run_name="__main__", alter_sys=True)
        assert ended.value.code == 0, f"{' '.join(words)}\n{capsys.readouterr().err}"


def test_commands_have_one_spelling():
    """`sdr-jax COMMAND`, in sources, too; one page names the other way."""
    modules = "experiments|scene.(?:render|check|stats|preview|assets)|seg.weights|sdr_jax.tune"
    called = re.compile(rf"python -m (?:{modules})\b(?: NAME)?")
    paths = [path for folder in (*OURS, "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    paths += (ROOT / "examples").rglob("*.py")
    texts = PAGES | {str(path): path.read_text(encoding="utf-8") for path in paths}
    found = [(place, hit[0]) for place, text in texts.items() for hit in called.finditer(text)]
    assert found == [("docs/reference/commands.md", "python -m experiments NAME")]


@pytest.mark.parametrize("page", PAGES)
def test_nothing_escapes(page):
    text = PAGES[page]
    assert {kind for kind, _ in FENCE.findall(text)} <= {"", "py", "python", "json", "math", "yaml"}
    for kind, block in FENCE.findall(text):
        if kind == "yaml":
            parse_target(block, page)
    assert len(re.findall(r"^```", text, re.MULTILINE)) == 2 * len(FENCE.findall(text))
    assert not re.findall(r"RESULTS_|LIMITS$|TODO|\b[Bb]y eye\b", text, flags=re.MULTILINE)
    for module in re.findall(r"python -m ([a-z_]+\.[a-z_.]+[a-z])\b", text):
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), module


def prose(text: str) -> str:
    """Text without blocks, code and the targets of links."""
    return re.sub(r"`[^`]*`|\]\([^)]*\)", "", FENCE.sub("", text))


def words(text: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def test_the_front_page_is_read_in_ten_minutes():
    text = PAGES["README.md"]
    assert len(text.splitlines()) <= 120
    outside_tables = re.sub(r"^\|.*", "", prose(text), flags=re.MULTILINE)
    assert len(re.findall(r"(?<![\w.])\d[\d.,]*", outside_tables)) <= 25


def test_the_pages_are_short_and_the_appendix_is_last():
    pages = {page: text for page, text in PAGES.items() if page.startswith("docs/")}
    assert sum(map(words, pages.values())) <= 20_000
    appendix = re.findall(r"\w+\.md", (ROOT / "mkdocs.yml").read_text().split("- Appendix:\n")[1])
    assert sum(words(pages[f"docs/{page}"]) for page in appendix) <= 6_000
    results = pages["docs/results.md"]
    tables = re.findall(r"^(?!\|).*\n\|", results, re.MULTILINE)
    assert words(results) <= 2_500 and 0 < len(tables) <= 8


@pytest.mark.parametrize("page", [page for page in PAGES if re.match("docs/(?!findings.md)", page)])
def test_a_page_begins_with_what_it_is(page):
    """A title and a sentence, which says what the thing is, not what its reader will have done."""
    first = re.match(r"(?:---\n.*\n---\n)?# .+\n\n([A-Z`].+)", PAGES[page])
    assert first and not first[1].startswith("After this page")
