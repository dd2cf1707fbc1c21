"""Which attributes matter for a run's rewards, according to the model of `sdr-jax study sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import UserError
from common.lines import Record
from experiments.tables.form import Report
from experiments.tables.importance import NO_PREDICTION, enough, summarize, verdict
from experiments.tables.recorded import choose
from scene.attributes import SpaceName

FILE = "matters.json"
"""The file of the result, among the run's pictures: with 216 rewards of 37 attributes the model takes half a
minute of one core."""


def matters(records: Sequence[Record], target: str, space: SpaceName) -> Report:
    """Compute which attributes matter for the rewards of a search.

    Returns:
        ``said``, the result in words; ``rewards``, their number; and ``attributes``, the most important
        first, empty if the rewards do not tell.
    """
    try:
        chosen = enough(choose(records, target, space, None, "the search"), "the search")
    except UserError as error:
        return {"said": f"Unknown: {error}.", "rewards": 0, "attributes": []}
    sensitivity = summarize(chosen)
    r2 = sensitivity["r2"]
    significant = r2["value"] is not None and r2["value"] >= NO_PREDICTION
    fit = "" if r2["value"] is None else f"Cross-validated R² {r2['value']:.2f}. "
    words = verdict(r2) if significant else "These rewards do not show which attributes matter."
    return {
        "said": fit + words,
        "rewards": len(chosen.rewards),
        "attributes": sensitivity["attributes"] if significant else [],
    }
