"""A model's card: README.md in the format of Hugging Face, with metadata for machines first."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seg.model import Model

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

labels = load_model("FOLDER").predict([image])  # RGB u8[h, w, 3] to places in the table
```
FOLDER is the one of this file, with `config.json` and `weights.safetensors`.
"""


def card(model: Model) -> str:
    """Write the card of a model from its fields and notes.

    It gives the mIoU if the notes have it with ``target`` and ``reported_on``, as those of `fit` do.
    """
    notes, (height, width) = model.notes, model.size
    title = f"{model.settings.net} for {notes.get('target', 'streets')}"
    trained = str(notes.get("trained_on", "images that its notes do not name"))
    if "labelled_images" in notes:
        beside = " and renders beside them" if "+" in trained else ""
        trained = f"{notes['labelled_images']} labelled images{beside}"
    lines = [
        f"# {title}",
        f"Tells {len(model.classes)} classes apart in images of streets. Trained at {width}x{height} "
        f"pixels on {trained}, by sdr-jax {model.versions.get('sdr-jax', '?')}.",
    ]
    if model.settings.frozen:
        lines.append(
            "Its trunk is frozen and comes with a package, which `config.json` names; the weights are the "
            "head's."
        )
    if _told(model):
        lines += [
            "",
            "## How good it is",
            f"Nets that were trained like it come to {notes['miou']:.1f} % mIoU on images that they have not "
            f"seen ({notes['reported_on']}). {notes.get('verdict', '')}".rstrip(),
        ]
    rows = [f"| {c.id} | {c.name} | {' '.join(map(str, c.color))} |" for c in model.classes]
    table = ["", "## Classes", "| id | class | colour |", "| --- | --- | --- |", *rows]
    front = HEAD + (_index(model, title) if _told(model) else "")
    return f"---\n{front}---\n" + "\n".join(lines) + "\n" + USE + "\n".join(table) + "\n"


def _told(model: Model) -> bool:
    return {"miou", "target", "reported_on"} <= model.notes.keys() and model.notes[
        "miou"
    ] is not None


def _index(model: Model, title: str) -> str:
    """The metadata of the result; JSON is valid YAML."""
    metric = {"type": "mean_iou", "name": "mIoU, %", "value": round(model.notes["miou"], 2)}
    result = {
        "task": {"type": "image-segmentation"},
        "dataset": {
            "type": model.notes["target"],
            "name": model.notes["target"],
            "split": model.notes["reported_on"],
        },
        "metrics": [metric],
    }
    return f"model-index: {json.dumps([{'name': title, 'results': [result]}])}\n"
