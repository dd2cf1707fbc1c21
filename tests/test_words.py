"""One name for each idea: words and classes that were replaced do not come back."""

import ast
import re
from pathlib import Path

import pytest

from tests.conftest import ROOT

WORDS = {
    "by eye": "hand-tuned",
    "surely": "significantly, or for certain",
    "hopeless": "worse",
    "so manyth": "a sentence with a subject and a verb",
}
"""Replaced words, and what is said now."""
NAMES = {
    "Truth": "LabelledImages",
    "RealSet": "LabelledImages",
    "WithFew": "TrainingSet",
    "Shelf": "Cache",
    "Shared": "Cached",
    "Memory": "Store",
    "Ahead": "Runner.prefetch",
    "Seen": "Predictions",
    "Sight": "Predictions",
    "Outcome": "Result",
    "score_nets": "Runner.test",
    "run_on_host": "drive",
}
"""Replaced names of classes and functions of `experiments` and `seg`, and those of today."""
FOLDERS = ("common", "sdr_jax", "scene", "seg", "experiments", "benchmarks", "examples", "tests")
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
# The page of results quotes what was made before.
PAGES = [
    path
    for path in (*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md")))
    if not path.name.startswith("results")
]


def found(path: Path) -> list[str]:
    """Replaced words in a file, with their lines."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [
        f"{path.relative_to(ROOT)}:{number}: {word!r} is {now}"
        for number, line in enumerate(lines, 1)
        for word, now in WORDS.items()
        if re.search(rf"\b{word}\b", line, re.IGNORECASE)
    ]


def defined(path: Path) -> list[str]:
    """Replaced names that a file defines, with their lines."""
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    return [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.name} is {NAMES[node.name]}"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, kinds) and node.name in NAMES
    ]


def test_replaced_words_do_not_come_back() -> None:
    looked_at = [path for path in (*SOURCES, *PAGES) if path != Path(__file__).resolve()]
    assert len(looked_at) > 400
    assert [line for path in looked_at for line in found(path)] == []


def called(path: Path) -> list[str]:
    """Commands that a text calls by their module, with their lines; one page names the way of a program."""
    modules = "experiments|scene.(?:render|check|stats|preview|assets)|seg.weights|sdr_jax.tune"
    lines = path.read_text(encoding="utf-8").splitlines()
    return [
        f"{path.relative_to(ROOT)}:{number}: {hit[0]} is `sdr-jax COMMAND`"
        for number, line in enumerate(lines, 1)
        for hit in re.finditer(rf"python -m (?:{modules})\b(?: NAME)?\S*", line)
    ]


def test_commands_have_one_spelling() -> None:
    texts = [path for path in SOURCES if path.relative_to(ROOT).parts[0] != "tests"]
    texts += [*PAGES, *(ROOT / "docs").glob("results*.md")]
    (once,) = [line for path in texts for line in called(path)]
    assert once.startswith("docs/reference/commands.md") and "python -m experiments NAME" in once


def test_replaced_names_do_not_come_back() -> None:
    own = [path for path in SOURCES if path.relative_to(ROOT).parts[0] in ("experiments", "seg")]
    assert [line for path in own for line in defined(path)] == []


@pytest.mark.parametrize(("text", "hits"), [
    ("A street set by eye.", 1), ("Surely, set by eye.", 2), ("a default street", 0),
])  # fmt: skip
def test_a_word_is_found_wherever_it_stands(text: str, hits: int, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tests.test_words.ROOT", tmp_path)
    (tmp_path / "page.md").write_text(text)
    assert len(found(tmp_path / "page.md")) == hits


def test_a_name_is_found_where_it_is_defined(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tests.test_words.ROOT", tmp_path)
    (tmp_path / "a.py").write_text("class Truth:\n    def score_nets(self): ...\n\n\nseen = 1\n")
    assert len(defined(tmp_path / "a.py")) == 2
