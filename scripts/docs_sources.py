"""What Griffe is told about our sources: what packages offer, and that a "Source:" is a paragraph."""

import re
from pathlib import Path
from typing import Any

import griffe

SOURCE = re.compile(r"^Source: .*(?:\n +\S.*)+", re.MULTILINE)


class Sources(griffe.Extension):
    """Finds the names that are imported on first use, and joins the lines of sources."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Called once for every package: it offers what its stub imports (``lazy_loader``)."""
        assert isinstance(pkg.filepath, Path)
        stub = pkg.filepath.with_suffix(".pyi")
        if stub.exists():
            pkg.exports = re.findall(r" as (\w+)$", stub.read_text(encoding="utf-8"), re.MULTILINE)

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called once for every object with a docstring or without."""
        if obj.docstring:
            text = obj.docstring.value
            obj.docstring.value = SOURCE.sub(lambda found: re.sub(r"\n +", " ", found[0]), text)
