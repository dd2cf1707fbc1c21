"""Assets whose first draw came out like an earlier one: family -> index -> redraws.

Written by ``python -m scene.assets --redraw``.
"""

REDRAWN: dict[str, dict[int, int]] = {
    "car": {
        175: 1
    },
}  # fmt: skip
