"""``dataset/few.md`` of a run with ``--few``: how to train on renders plus labelled images."""

from __future__ import annotations

from typing import Any

from experiments.session.session import Session
from seg.classes import class_table

NOTE = "few.md"
CODE = """
In Python, in the run's folder:
```python
import json
from pathlib import Path

import scene
import seg

config = json.loads(Path("config.json").read_text())
final, target = config["final"], seg.find_target("{name}")
table = seg.table_of(target)
few = json.loads(Path("summary.json").read_text())["few_images"]
# If --data was a relative path, write it relative to this folder.
entries = [e for e in seg.list_split(target, config["data"], "train") if e.name in few]
real = seg.load(entries, target, (final["height"], final["width"]))
renders = scene.read_dataset(Path("dataset"), table.outlines)
params = seg.train(
    config["seed"], renders.images, table.from_train_id[renders.labels],
    seg.TrainSettings(**final["train"]), len(table.classes),
    extra=real, share=config["few_share"],
)
```
"""


def text(run: Session[Any]) -> str:
    """The note, in Markdown."""
    target, share = run.target, run.config.few_share
    names = target.few_names
    code = CODE.replace("{name}", target.name)
    outlines = (
        f"The run trained its networks on labels with the `outlines` of {target.name}. The labels in this "
        "folder are exact; `read_dataset` draws the outlines.\n"
        if class_table(target.table).outlines
        else ""
    )
    return (
        f"# Renders to train on with {len(names)} labelled images\n"
        f"These {run.config.final.images} rendered images were optimised for training together with "
        f"{len(names)} labelled images of {target.name}, which are not in this folder. Train on both: take "
        f"{100 * share:g} % of every batch from the labelled images, each of them equally often, and the "
        "rest from here. `summary.json` of the run has the gain (row `few+learnt`).\n\n"
        f"The labelled images: {', '.join(names)}.\n" + outlines + (code if target.real else "")
    )
