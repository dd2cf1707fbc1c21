"""What MkDocs does beside its own: pages from elsewhere in the repository, links, equations, versions."""

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
"""Pages whose text lies outside docs/."""
PAGES = {source: page for page, source in ELSEWHERE.items()}
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)#:\s]+)(#[^)\s]*)?\)")
MATH = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)

FETCHED = re.compile(r'<(?:link|script|img|iframe)\b[^>]*?(?:href|src)="(?:https?:)?//[^"]*"')


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Puts the versions of program and engine at the foot of each page."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    config.copyright = f"{project['name']} {project['version']}, engine {ENGINE}"
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages from elsewhere."""
    for page, source in ELSEWHERE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Makes links of the repository links of the site, and equations MathML."""
    here = page.file.src_uri
    source = ELSEWHERE.get(here, f"docs/{here}")
    if here == "reference/commands.md":
        markdown += _commands()
    linked = LINK.sub(lambda found: _link(found, source, here), markdown)
    return MATH.sub(_equation, linked)


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Refuses a page that would fetch something from elsewhere."""
    fetched = FETCHED.search(output)
    if fetched:
        raise PluginError(f"{page.file.src_uri} needs a network: {fetched[0]}")
    return output


def _equation(found: re.Match[str]) -> str:
    """MathML of a block of LaTeX."""
    equation = convert(found[1].strip(), display="block")
    if "\\" in equation:
        raise PluginError(f"latex2mathml does not know all of {found[1].strip()}")
    return equation


def _link(found: re.Match[str], source: str, here: str) -> str:
    """A link as the page needs it; what is no page of the site keeps its text only."""
    image, text, path, anchor = found.groups()
    target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
    if target.startswith("docs/"):
        target = target.removeprefix("docs/")
    elif target in PAGES:
        target = PAGES[target]
    elif (ROOT / target).exists():
        return text
    else:
        return found[0]
    return f"{image}[{text}]({posixpath.relpath(target, posixpath.dirname(here) or '.')}{anchor or ''})"


def _commands() -> str:
    """The table of all commands, with the first line of each one's docstring."""
    rows = [
        f"| `{'study ' * (name in STUDIES)}{name}` | `{module}` | {summary(module)} |"
        for name, module in COMMANDS.items()
    ]
    return "\n".join(
        ["| `sdr-jax ...` | `python -m ...` | what it does |", "| --- | --- | --- |", *rows]
    )
