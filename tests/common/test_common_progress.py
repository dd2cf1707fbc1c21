"""Progress: time left, replayed work, lines in files and on terminals."""

import io
import re
from types import SimpleNamespace

import pytest

from common import progress
from common.progress import Progress, Stage, duration


@pytest.fixture
def clock(monkeypatch):
    """A clock to set manually."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    return clock


class Terminal(io.StringIO):
    def isatty(self):
        return True

    def visible(self) -> list[str]:
        """The lines that remain in the end: all that were not cleared and overwritten."""
        lines = [line.rpartition("\x1b[2K")[2] for line in self.getvalue().split("\n")]
        texts = [re.sub(r"\x1b\[[?\d;]*[A-Za-z]|\r", "", line) for line in lines]
        return [text for text in texts if text]


@pytest.fixture
def terminal(monkeypatch):
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    return Terminal()


def test_time_left_by_hand_and_replayed_work_does_not_set_the_pace(clock):
    job = Progress(total=10, stream=io.StringIO())
    assert job.left is None
    clock.now += 30
    job.advance(0.09)
    assert job.left is None  # too little work to estimate
    job.advance(2.91)
    assert job.left == pytest.approx(70)  # 10 s per unit, 7 units left
    job.advance(8)
    assert job.left == 0  # never negative
    job = Progress(total=10, elapsed=500, stream=io.StringIO())
    clock.now += 20  # to read what is known
    job.advance(6, replayed=True)
    assert job.left is None
    clock.now += 8
    job.advance(1)
    assert job.left == pytest.approx(3 * 8) and job.elapsed == 528


def test_time_left_starts_from_the_plan_and_ends_at_the_measured_pace(clock):
    job = Progress(10.0)
    clock.now += 50
    job.expect(100.0, 20.0)  # 10 s a unit, after a start of 20 s
    assert job.left == pytest.approx(120)
    clock.now += 15
    assert job.left == pytest.approx(105)
    clock.now += 15  # the start took as long as expected, and 10 s are work
    job.advance()
    assert job.left == pytest.approx(90)
    job.advance(2.0, replayed=True)
    clock.now += 80
    job.advance(4.0)
    # 90 s for 5 units, and as much trust in the plan as in one more unit of 10 s
    assert job.left == pytest.approx(3 * (90 + 10) / 6)
    slow = Progress(10.0)
    slow.expect(100.0, 20.0)
    clock.now += 200
    assert slow.left == pytest.approx(100)  # a start that takes longer leaves the work
    durations = [duration(seconds) for seconds in (0.2, 75, 99.4, 120, 3600, 9000)]
    assert durations == ["0 s", "75 s", "99 s", "2 min", "60 min", "2.5 h"]


def story(stream, clock):
    job = Progress(total=4, label="twin | ", stream=stream)
    job.say("Target: :car: [bold]x")
    clock.now += 10
    job.advance(1)
    job.update("mIoU 5.0 :car: [/x] {y}")
    job.say("halfway")
    job.advance(3)
    job.update("mIoU 6.0")
    job.close()
    job.say("end")
    return stream


PLAIN = [
    "Target: :car: [bold]x",
    "[ 25 %] twin | mIoU 5.0 :car: [/x] {y} | 30 s left",
    "halfway",
    "[100 %] twin | mIoU 6.0 | 0 s left",
    "end",
]


@pytest.mark.parametrize("variable", ["TERM=dumb", "TTY_COMPATIBLE=0"])
def test_a_line_per_update_in_a_file_and_without_a_cursor(variable, clock, terminal, monkeypatch):
    for force in ("", "1"):
        monkeypatch.setenv("FORCE_COLOR", force)
        assert story(io.StringIO(), clock).getvalue().splitlines() == PLAIN
    monkeypatch.delenv("FORCE_COLOR")
    monkeypatch.setenv(*variable.split("="))
    assert story(terminal, clock).getvalue().splitlines() == PLAIN


def test_minor_states_of_one_percentage_share_a_line(clock):
    stream = io.StringIO()
    progress = Progress(1000, stream=stream)
    for k in range(30):
        progress.advance(1, replayed=True)
        progress.update(f"step {k}", minor=True)
    progress.update("done")
    lines = stream.getvalue().splitlines()
    assert [int(line[1:4]) for line in lines] == [0, 1, 2, 3, 3]
    assert lines[-1] == "[  3 %] done"


def test_a_terminal_has_one_line_that_is_written_over(clock, terminal):
    first, halfway, bar, end = story(terminal, clock).visible()
    assert (first, halfway, end) == ("Target: :car: [bold]x", "halfway", "end")
    assert bar.endswith("100 % twin | 0 s left | mIoU 6.0")


def test_texts_are_shown_as_they_are_and_prints_stand_above_the_bar(clock, terminal, monkeypatch):
    monkeypatch.setattr("sys.stdout", terminal)
    job = Progress(total=4)
    job.update("mIoU 5.0 :car: [/x] {y}")
    print("a warning")
    job.close()
    warning, bar = terminal.visible()
    assert warning == "a warning" and bar.endswith("  0 % mIoU 5.0 :car: [/x] {y}")


def test_a_narrow_terminal_cuts_the_end_off_a_line(clock, terminal):
    job = Progress(total=2, stream=terminal, label="twin | ")
    job.advance(1)
    clock.now += 60
    job.update("x" * 99)
    job.say("y" * 99)  # what stays is not cut
    job.close()
    line, bar = terminal.visible()
    assert line == "y" * 99 and " 50 % twin | 60 s left | xxx" in bar and len(bar) <= 80


def test_on_a_terminal_every_stage_has_a_bar_and_the_pace_is_shown(clock, terminal):
    stages = [Stage("rewards", 4, 8.0), Stage("final networks", 2, 2.0)]
    job = Progress(total=10, stream=terminal, stages=stages, workers=2)
    clock.now += 20
    for _ in range(4):
        job.advance(2)
    job.advance(1)
    job.standing = "best mIoU 20.4"
    job.update("net 5")
    job.close()
    whole, rewards, finals, pace = (line.rstrip() for line in terminal.visible()[-4:])
    assert whole.endswith(" 90 % 2 s left | net 5")
    assert rewards.endswith("100 % rewards, 4 of 4")
    assert finals.endswith(" 50 % final networks, 1 of 2")
    # Five networks in 20 s; 10 of 9 units, two cores.
    assert pace == "15 networks a minute | about 44 s of CPU in total | best mIoU 20.4"


def test_streets_without_networks_are_no_networks(clock, terminal):
    job = Progress(total=3, stream=terminal, stages=[Stage("streets", 32, 2.0)], workers=1)
    clock.now += 60
    job.advance(1, networks=0)
    job.update("seed 0")
    job.close()
    streets, pace = (line.rstrip() for line in terminal.visible()[-2:])
    assert streets.endswith(" 50 % streets, 16 of 32") and pace == "about 3 min of CPU in total"


def test_progress_is_reported_at_once_and_then_at_intervals(clock):
    reports, job = [], Progress(total=4, stream=io.StringIO())
    job.tell(10.0, lambda share, line: reports.append((share, line)))
    for seconds in (0, 9, 1, 5, 5):
        clock.now += seconds
        job.advance()
        job.update(f"at {clock.now:.0f}")
    assert reports == [
        (0.25, "at 100 | 0 s left"), (0.75, "at 110 | 3 s left"), (1.0, "at 120 | 0 s left"),
    ]  # fmt: skip


def test_names_of_files_send_no_codes_to_the_terminal():
    stream = io.StringIO()
    job = Progress(2.0, stream=stream)
    job.say("a\x1b[2Jb\nc")
    job.advance()
    job.update("net \x1b]0;x\x07\r of a\nb")
    assert stream.getvalue().split("\n") == [
        "a\\x1b[2Jb", "c", "[ 50 %] net \\x1b]0;x\\x07\\r of a\\nb | 0 s left", ""
    ]  # fmt: skip


def test_unfinished_work_counts_until_it_is_done_and_progress_never_falls(clock):
    stream = io.StringIO()
    job = Progress(total=10, stream=stream)
    job.advance(2)
    job.update("network 1")
    clock.now += 20
    job.under_way(1.0)  # 20 s without a result
    clock.now += 10
    job.under_way(2.0)  # the line before is 10 s old
    clock.now += 10
    job.under_way(3.0)
    job.under_way(0.5)  # a worker begins the next piece before the result arrives
    clock.now += 20
    job.under_way(0.6)
    job.advance(4)
    job.update("network 2")
    lines = stream.getvalue().splitlines()
    assert lines[0].startswith("[ 20 %] network 1")
    assert [line[:16] for line in lines[1:]] == [
        "[ 30 %] training",
        "[ 50 %] training",
        "[ 60 %] network ",
    ]
    assert job.left == pytest.approx(60 / 6 * 4)


def test_a_bar_moves_while_a_piece_is_under_way(clock, terminal):
    job = Progress(total=10, stream=terminal)
    job.advance(1)
    job.update("network 1")
    job.under_way(4.0)
    job.close()
    assert "50 % 0 s left | network 1" in terminal.visible()[-1]
