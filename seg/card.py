"""A model's card: README.md in the format of Hugging Face, with metadata for machines first."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from common.errors import printable

README = "README.md"
HEAD = """\
library_name: sdr-jax
pipeline_tag: image-segmentation
tags:
- semantic-segmentation
- street-scenes
- jax
"""
USE = """
## Use
```
sdr-jax predict FOLDER photographs --out labels
```
```python
from seg import load_model

labels = load_model("FOLDER").predict([image])  # RGB u8[h, w, 3] to rows of the table
```
FOLDER is this folder, with `config.json` and `weights.safetensors`.
"""


def card(config: Mapping[str, Any]) -> str:
    """Write the card of a model from its ``config.json``.

    It gives the mIoU if the notes have it with ``target`` and ``reported_on``, as those of `fit` do.
    """
    notes, size, classes = config["notes"], config["size"], config["classes"]
    miou = notes.get("miou")
    measured = isinstance(miou, float) and math.isfinite(miou)
    has_result = {"target", "reported_on"} <= notes.keys() and measured
    title = f"{config['net']} for {notes.get('target', 'streets')}"
    trained = plain_text(notes.get("trained_on", "images that its notes do not name"))
    if "labelled_images" in notes:
        renders = " and renders" if "+" in trained else ""
        count = notes["labelled_images"]
        trained = f"{plain_text(count)} labelled image{'s' * (count != 1)}{renders}"
    version = plain_text(config["versions"].get("sdr-jax", "?"))
    lines = [
        f"# {plain_text(title)}",
        f"Segments images of streets into {len(classes)} classes. Trained at {size['width']}x"
        f"{size['height']} pixels on {trained}, by sdr-jax {version}.",
    ]
    if config["backbone"] is not None:
        lines.append(
            "Its backbone is frozen and comes with a package, which `config.json` names; the weights are the "
            "head's."
        )
    if config["recipe"].get("average_mirror"):
        lines.append(
            "Its predictions are means over an image and its mirror image; `--no-mirror` takes half the time."
        )
    if has_result:
        lines += [
            "",
            "## How good it is",
            f"Networks trained the same way reach {miou:.1f} % mIoU on images that they have not "
            f"seen ({plain_text(notes['reported_on'])}). {plain_text(notes.get('verdict', ''))}".rstrip(),
        ]
    rows = [
        f"| {c['id']} | {plain_text(c['name'])} | {' '.join(map(str, c['color']))} |"
        for c in classes
    ]
    table = ["", "## Classes", "| id | class | colour |", "| --- | --- | --- |", *rows]
    front = HEAD + (_index(notes, title) if has_result else "")
    return f"---\n{front}---\n" + "\n".join(lines) + "\n" + USE + "\n".join(table) + "\n"


def plain_text(value: Any) -> str:
    """A value as one line of plain text in Markdown: neither links, nor HTML, nor another cell of a table."""
    return re.sub(r"([\\`*|<>\[\]&~])", r"\\\1", printable(" ".join(str(value).split())))


def _index(notes: Mapping[str, Any], title: str) -> str:
    """The metadata of the result; JSON is valid YAML."""
    metric = {"type": "mean_iou", "name": "mIoU, %", "value": round(notes["miou"], 2)}
    result = {
        "task": {"type": "image-segmentation"},
        "dataset": {
            "type": notes["target"],
            "name": notes["target"],
            "split": notes["reported_on"],
        },
        "metrics": [metric],
    }
    return f"model-index: {json.dumps([{'name': title, 'results': [result]}])}\n"
