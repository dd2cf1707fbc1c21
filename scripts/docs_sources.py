"""An extension of Griffe for our sources: what packages export, and "Source:" as a paragraph."""

import re
from pathlib import Path
from typing import Any

import griffe

SOURCE = re.compile(r"^Source: .*(?:\n +\S.*)+", re.MULTILINE)


class Sources(griffe.Extension):
    """Finds the names that are imported on first use, and joins the lines of a source."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Let a package export what its stub imports (``lazy_loader``)."""
        assert isinstance(pkg.filepath, Path)
        stub = pkg.filepath.with_suffix(".pyi")
        if stub.exists():
            pkg.exports = re.findall(r" as (\w+)$", stub.read_text(encoding="utf-8"), re.MULTILINE)

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Join the lines of sources in a docstring."""
        if obj.docstring:
            text = obj.docstring.value
            obj.docstring.value = SOURCE.sub(lambda match: re.sub(r"\n +", " ", match[0]), text)
