"""What the command lines share."""

import pytest

from scene.command import duration


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (75, "75 s"), (99.4, "99 s"), (120, "2 min"), (3600, "60 min"), (9000, "2.5 h")],
)
def test_durations_are_read_at_a_glance(seconds, text):
    assert duration(seconds) == text
