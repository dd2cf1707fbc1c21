"""Assets whose first draw came out like an earlier one: family -> index -> redraws.

Written by ``python -m scene.assets --redraw``.
"""

REDRAWN: dict[str, dict[int, int]] = {
    "building": {
        18: 1, 54: 1, 64: 1, 79: 1, 82: 1, 87: 1
    },
    "car": {
        175: 1
    },
}  # fmt: skip
