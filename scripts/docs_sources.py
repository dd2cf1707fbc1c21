"""Makes one paragraph of each "Source:" in a docstring, which Griffe would take for a box with a title."""

import re
from typing import Any

import griffe

SOURCE = re.compile(r"^Source: .*(?:\n +\S.*)+", re.MULTILINE)


class Sources(griffe.Extension):
    """Joins the lines of sources."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called once for every object with a docstring or without."""
        if obj.docstring:
            text = obj.docstring.value
            obj.docstring.value = SOURCE.sub(lambda found: re.sub(r"\n +", " ", found[0]), text)
