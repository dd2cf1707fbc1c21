"""Progress: time left, work that was only replayed, lines on files and terminals."""

import io

import pytest
from experiments.progress import Progress

from experiments import progress


@pytest.fixture
def clock(monkeypatch):
    """A clock to be set by hand."""

    class Clock:
        now = 100.0

        def perf_counter(self):
            return self.now

    clock = Clock()
    monkeypatch.setattr(progress, "time", clock)
    return clock


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_time_left_by_hand(clock):
    told = Progress(total=10, stream=io.StringIO())
    assert told.left is None
    clock.now += 30
    told.advance(2)
    told.advance(1)
    assert told.left == pytest.approx(70)  # 10 s per unit, 7 units left
    told.advance(8)
    assert told.left == 0  # more than was planned is no negative time


def test_replayed_work_is_done_but_does_not_set_the_pace(clock):
    told = Progress(total=10, elapsed=500, stream=io.StringIO())
    told.advance(6, replayed=True)
    assert told.left is None
    clock.now += 8
    told.advance(1)
    assert told.left == pytest.approx(3 * 8)
    assert told.elapsed == 508


def test_a_line_per_update_in_a_file(clock):
    stream = io.StringIO()
    told = Progress(total=4, stream=stream)
    told.say("Target: x")
    clock.now += 10
    told.advance(1)
    told.update("mIoU 5.0")
    told.advance(3)
    told.update("mIoU 6.0")
    assert stream.getvalue().splitlines() == [
        "Target: x",
        "[ 25 %] mIoU 5.0 | 30 s left",
        "[100 %] mIoU 6.0 | 0 s left",
    ]


def test_a_terminal_has_one_line_that_is_written_over(clock):
    stream = Terminal()
    told = Progress(total=2, stream=stream)
    told.update("one")
    told.update("two")
    told.say("end")
    assert stream.getvalue() == "\r\x1b[2K[  0 %] one\r\x1b[2K[  0 %] two\nend\n"


def test_the_label_stands_on_every_line_of_progress():
    stream = io.StringIO()
    told = Progress(total=2, label="twin, not real | ", stream=stream)
    told.update("search")
    told.advance(1)
    told.update("finals")
    lines = stream.getvalue().splitlines()
    assert len(lines) == 2 and all("] twin, not real | " in line for line in lines)
