"""Hooks of MkDocs: pages from elsewhere in the repository, links, equations, versions."""

import posixpath
import re
import tomllib
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from experiments.__main__ import COMMANDS, STUDIES, summary
from scene.version import ENGINE

ROOT = Path(__file__).resolve().parents[1]
ELSEWHERE = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changes.md": "CHANGELOG.md",
    "howto/tune.md": "examples/tune/README.md",
    "howto/own_net.md": "examples/own_net/README.md",
}
"""Pages whose text is outside docs/."""
PAGES = {source: page for page, source in ELSEWHERE.items()}
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)#:\s]+)(#[^)\s]*)?\)")
MATH = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)

FETCHED = re.compile(r'<(?:link|script|img|iframe)\b[^>]*?(?:href|src)="(?:https?:)?//[^"]*"')


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the versions of program and engine at the foot of each page."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    config.copyright = f"{project['name']} {project['version']}, engine {ENGINE}"
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from elsewhere."""
    for page, source in ELSEWHERE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turn links within the repository into links of the site, and equations into MathML."""
    address = page.file.src_uri
    source = ELSEWHERE.get(address, f"docs/{address}")
    if address == "reference/commands.md":
        markdown += _commands()
    linked = LINK.sub(lambda match: _link(match, source, address), markdown)
    return MATH.sub(_equation, linked)


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Refuse a page that would fetch something from the network."""
    fetched = FETCHED.search(output)
    if fetched:
        raise PluginError(f"{page.file.src_uri} needs a network: {fetched[0]}")
    return output


def _equation(match: re.Match[str]) -> str:
    """Convert a block of LaTeX to MathML."""
    equation = convert(match[1].strip(), display="block")
    if "\\" in equation:
        raise PluginError(f"latex2mathml does not know all of {match[1].strip()}")
    return equation


def _link(match: re.Match[str], source: str, address: str) -> str:
    """Make the link that a page needs; a target that is not a page of the site keeps only its text."""
    image, text, path, anchor = match.groups()
    target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
    if target.startswith("docs/"):
        target = target.removeprefix("docs/")
    elif target in PAGES:
        target = PAGES[target]
    elif (ROOT / target).exists():
        return text
    else:
        return match[0]
    return f"{image}[{text}]({posixpath.relpath(target, posixpath.dirname(address) or '.')}{anchor or ''})"


def _commands() -> str:
    """Make the table of all commands, with the first line of their docstrings."""
    rows = [
        f"| `{'study ' * (name in STUDIES)}{name}` | {summary(module)} |"
        for name, module in COMMANDS.items()
    ]
    return "\n".join(["| `sdr-jax ...` | what it does |", "| --- | --- |", *rows])
