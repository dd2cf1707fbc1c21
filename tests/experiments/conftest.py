"""Tiny real data in the public layouts, tiny runs of the whole job, and what they leave."""

import fcntl
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from common.command import Parser
from common.files import read_json
from common.flags import add_flag, fill, flags_of
from common.progress import Progress
from common.workers.pool import WorkerPool
from experiments.__main__ import COMMANDS
from experiments.app.fit import config as fit_config
from experiments.config import MainConfig, parsers
from experiments.config.cli import command as command_line
from experiments.config.presets import PRESETS, TARGETS, defaults
from experiments.evaluation.job import Recipe, Result
from experiments.evaluation.runner import Runner
from experiments.evaluation.store import LOGS, Store
from experiments.session import session
from experiments.tables.nets import by_row, jobs_of
from experiments.targets.base import Target
from scene.attributes import NAMES
from scene.dataset.render import COMPILING
from scene.proposal import describe, slide
from seg.train import TrainingError
from tests.layouts import FACADE

from .tasks import formula as formula

ROOT = Path(__file__).resolve().parents[2]
H, W = 12, 16
POOL = WorkerPool(0)

TINY = (
    "--preset", "smoke", "--workers", "1",
    "--reward.train.steps", "6", "--final.train.steps", "8",
)  # fmt: skip
"""The smoke preset, smaller still; of twelve rewards and eight final nets."""

by_preset = pytest.mark.parametrize(("target", "preset"), [*product(TARGETS, PRESETS)])
"""A test of what a command does unless told otherwise."""


def startable(config: Any) -> Any:
    """The configuration, which may train without ImageNet weights under the preset paper, too."""
    return replace(config, from_scratch=config.preset == "paper")


class Page(HTMLParser):
    """What a browser would find in a page."""

    def __init__(self, path) -> None:
        super().__init__()
        self.tags, self.texts, self.rows, self.plots = [("", {})], [], [], []
        self.cell = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.cell = True

    def handle_endtag(self, tag):
        self.cell = self.cell and tag not in ("td", "th")

    def handle_data(self, data):
        tag, attributes = self.tags[-1]
        if not data.strip():
            return
        if attributes.get("type") == "application/json":
            self.plots.append(json.loads(data))
        elif tag not in ("script", "style"):
            self.texts.append(data)
            if self.cell:
                self.rows[-1][-1] += data

    @property
    def text(self) -> str:
        return " ".join(self.texts)


def write_pair(image: Path, label: Path, seed: int, highest: int) -> None:
    """A random photograph, and labels 0..highest in blocks."""
    rng = np.random.default_rng(seed)
    for path, values in (
        (image, rng.integers(0, 256, (H, W, 3))),
        (label, np.kron(rng.integers(0, highest + 1, (H // 4, W // 4)), np.ones((4, 4)))),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(values.astype(np.uint8)).save(path)


@pytest.fixture
def camvid(tmp_path: Path) -> Path:
    """Train (two sequences, two images each) and test (two images)."""
    root = tmp_path / "camvid"
    for split, names in {"train": ["A_1", "A_2", "B_1", "B_2"], "test": ["B_8", "C_1"]}.items():
        for k, name in enumerate(names):
            paths = root / split / f"{name}.png", root / f"{split}annot" / f"{name}.png"
            write_pair(*paths, k + 8 * (split == "test"), 10)
    return root


@pytest.fixture
def cityscapes(tmp_path: Path) -> Path:
    """Train and val, a city each, two images each."""
    root = tmp_path / "cityscapes"
    for split, city in (("train", "aachen"), ("val", "ulm")):
        for k in range(2):
            kinds = ("leftImg8bit", "leftImg8bit"), ("gtFine", "gtFine_labelIds")
            stem = f"{split}/{city}/{city}_000000_{k:06d}"
            write_pair(
                *(root / folder / f"{stem}_{kind}.png" for folder, kind in kinds),
                k + 8 * (split == "val"),
                33,
            )
    return root


@pytest.fixture
def labelmefacade(tmp_path: Path) -> Path:
    """Train (two albums, two photographs each) and test (two), wider and higher than 4:3."""
    root = tmp_path / "labelmefacade"
    for split, names in {"train": "b__2 a_p1 b__1 a_p2", "test": "b__10 c"}.items():
        for k, name in enumerate(names.split()):
            path = root / "labels" / f"{name}.png"
            write_pair(path.with_suffix(".tif"), path, k + 8 * (split == "test"), len(FACADE) - 1)
            values = np.asarray(Image.open(path))[:, : W - 4 * (k % 2)]
            Image.fromarray(FACADE[values]).save(path)
            photo = Image.open(path.with_suffix(".tif")).crop((0, 0, *values.shape[::-1]))
            (root / "images").mkdir(exist_ok=True)
            photo.save(root / "images" / f"{name}.jpg")
            path.with_suffix(".tif").unlink()
        (root / f"{split}.txt").write_text("\n".join(names.split()) + "\n")
    return root


def target_of(reward: Any, test: Any) -> Target:
    """Stands for CamVid: named images, and arrays that are the same at every size."""
    sides = {"reward": reward, "test": test, "labelled": reward}
    return Target("camvid", True, "camvid", "", ("a", "b"), ("s", "s"), ("c",), lambda *_: sides)


def runner_of(target: Target, folder: Path, pool: Any = POOL, told: Any = None) -> Runner:
    """Who makes evaluations in a folder; ``told`` takes what progress says."""
    folder.mkdir(exist_ok=True)
    progress = Progress(1.0)
    if told is not None:
        progress.update = lambda text, **how: told(text)  # type: ignore[method-assign]
    return Runner(target, pool, folder, Store(folder / LOGS[1]), None, lambda: progress)


def results_of(run: Any, *arguments: Any, **options: Any) -> dict[str, list[Result]]:
    """Results of the jobs that `jobs_of` makes of the arguments, by row."""
    jobs = jobs_of(*arguments, **options)
    return by_row(jobs, run.runner.test(jobs))


def config_of(data: Path, out: Path, say: Any = lambda text: None, **flags: Any) -> Any:
    """The configuration of `sdr-jax fit` with these flags."""
    return fit_config.config_of(parsers.Fit(data=data, out=out, **flags), say)


@pytest.fixture(autouse=True)
def within_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes jobs with 0 workers render and train in this process, where tests replace nets."""

    def workers_for(config: Any) -> Any:
        alone = config.workers == 0 and config.executor == "processes"
        return WorkerPool(0) if alone else started(config)

    started = session.workers_for
    monkeypatch.setattr(session, "workers_for", workers_for)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A run's folder, not there yet."""
    return tmp_path / "run"


@pytest.fixture
def tiny(out: Path, camvid: Path) -> Callable[..., Any]:
    """Configurations of the CamVid above, by a command's function of defaults."""
    own = {"out": out, "workers": 0, "data": camvid}
    return lambda base, **changes: replace(base("camvid", "smoke"), **own, **changes)


@pytest.fixture
def tiny_camvid(tiny: Any) -> MainConfig:
    """A smoke configuration of the main job."""
    return tiny(partial(defaults, MainConfig))


def searching(config: Any, **options: Any) -> Any:
    """A configuration with other options of its search."""
    return replace(config, search=replace(config.search, **options))


class Killed(BaseException):
    """Stands for the end of the process."""


def never(*task: Any, **options: Any) -> Any:
    """Stands for work that must not be done."""
    raise AssertionError("this was known")


def diverge(*task: Any, **options: Any) -> Any:
    """Stands for training that fails."""
    raise TrainingError("the loss is nan after 50 of 200 steps")


class Counted:
    """A formula that keeps the tasks it is given; some diverge, and all end before the one at ``limit``."""

    def __init__(self, evaluate: Any = formula, limit: int = -1, failing: Any = ()) -> None:
        self.evaluate, self.limit, self.failing = evaluate, limit, failing
        self.calls: list[Any] = []

    def __call__(self, *task: Any, **options: Any) -> Any:
        if len(self.calls) == self.limit:
            raise Killed
        self.calls.append(task)
        return (diverge if len(self.calls) in self.failing else self.evaluate)(*task, **options)


@pytest.fixture
def counted(scored_by: Any) -> Counted:
    """The formula above in the place of nets, with its calls."""
    scores = Counted()
    scored_by(scores)
    return scores


@pytest.fixture
def scored_by(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., Result]], None]:
    """Puts a function in the place of rendering, training and scoring; for jobs without workers."""
    return partial(monkeypatch.setattr, "experiments.evaluation.runner.evaluate_miou")


def transferred(start: Any, fine: Recipe, seed: int, real: Any, chosen: Any, truth: Any) -> list:
    """Fine-tuned nets: worth more with more images, and with training before; a little noise by seed."""
    worth = 0.1 + 0.05 * (start.streets is not None) + 0.01 * start.on_subset + 0.001 * (seed % 7)
    return [Result(worth + 0.01 * len(k), [worth] * 11, 0.5, 1.5) for k in chosen]


@pytest.fixture
def command(camvid: Path, scored_by: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Runs a study's command on tiny CamVid with formulas in the place of nets; returns the exit code."""

    def run(name: str, out: Path, *flags: str, evaluate=formula, transfer=transferred) -> int:
        scored_by(evaluate)
        monkeypatch.setattr("experiments.evaluation.runner.transfer", transfer)
        fixed = ("--target", "camvid", "--preset", "smoke", "--data", str(camvid), "--workers", "0")
        return study(name, *fixed, "--out", str(out), *flags)

    return run


@pytest.fixture
def reported(command: Any, out: Path) -> Callable[..., tuple[dict[str, Any], str]]:
    """A study's report in figures and in words, by its command."""

    def run(name: str, *flags: str, **stubs: Any) -> tuple[dict[str, Any], str]:
        assert command(name, out, *flags, **stubs) == 0
        return read_json(out / f"{name}.json"), (out / f"{name}.md").read_text()

    return run


def parsed(default: Any, flags: Sequence[str]) -> Any:
    """A configuration with flags, on top of these defaults."""
    parser = Parser("study", None)
    for field in flags_of(default):
        add_flag(parser.add_argument, field)
    return fill(default, vars(parser.parse_args(flags)))


def job_of(name: str) -> Any:
    """The module of a study."""
    return import_module(f"experiments.studies.{name}")


def study(name: str, *flags: str) -> int:
    """A study's command; returns the exit code."""
    return command_line(name, flags)


def main_job(target: str, *flags: str) -> int:
    """The main job's command; returns the exit code."""
    name = "cityscapes" if target == "twin" else target
    return command_line(name, ("--preset", "smoke", "--workers", "0", *flags))


@pytest.fixture
def learnt_file(tmp_path: Path) -> Path:
    """An attributes.json with buildings far off."""
    centre = np.where(np.array(NAMES) == "building_position", 0.9, 0.5)
    path = tmp_path / "attributes.json"
    path.write_text(json.dumps(describe(slide(centre, 0.1))))
    return path


@pytest.fixture
def error_line(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Reads the one line of error of a refused job, which has said nothing else unless it had begun."""

    def read(begun: bool = False) -> str:
        captured = capsys.readouterr()
        error = captured.err.replace(f"{COMPILING}\n", "")
        assert error.count("\n") == 1 and error.startswith("error: ")
        assert begun or captured.out == ""
        return error

    return read


class Job:
    """The whole job as a user starts it, in a process group of its own."""

    def __init__(self, out: Path, *flags: str, experiment: str = "cityscapes") -> None:
        self._said = [out.with_suffix(f".{name}") for name in ("stdout", "stderr")]
        command = [sys.executable, "-m", COMMANDS[experiment], *flags, "--out", str(out)]
        own = {"env": {k: v for k, v in os.environ.items() if k != "CAMVID_DIR"}, "cwd": ROOT}
        own |= {"stdin": subprocess.DEVNULL, "start_new_session": True}
        # Shells start background jobs with SIGINT ignored, and children would inherit that.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with self._said[0].open("w") as stdout, self._said[1].open("w") as stderr:
                self.process = subprocess.Popen(command, stdout=stdout, stderr=stderr, **own)
        finally:
            signal.signal(signal.SIGINT, before)

    def finish(self, timeout: float = 300) -> tuple[int, str, str]:
        """Exit code, standard output, standard error; the whole group is gone afterwards.

        Whether the renderer had to be compiled depends on which test comes first.
        """
        try:
            code = self.process.wait(timeout)
        finally:
            self.kill()
        stdout, stderr = (path.read_text() for path in self._said)
        return code, stdout, stderr.replace(f"{COMPILING}\n", "")

    def send(self, number: signal.Signals) -> None:
        """Signal the whole group, as a terminal does."""
        os.killpg(self.process.pid, number)

    def kill(self) -> None:
        """End the whole group, at once."""
        with suppress(ProcessLookupError):
            self.send(signal.SIGKILL)


def lines(path: Path) -> list[dict[str, Any]]:
    """The whole lines of a log."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_bytes().split(b"\n")[:-1]]


def untimed(log: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The lines of a log without their times."""
    return [{k: v for k, v in line.items() if k != "elapsed"} for line in log]


@pytest.fixture(scope="session")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The run folder of one whole tiny job on the twin, and its output.

    Of the processes of one `pytest -n` the first makes it, and the others wait and read.
    """
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    out, text = folder / "unbroken", folder / "unbroken.txt"
    with (folder / "unbroken.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not text.exists():
            code, stdout, stderr = Job(out, *TINY).finish()
            assert (code, stderr) == (0, "")
            text.write_text(stdout)
    return out, text.read_text()


@pytest.fixture
def start_job() -> Any:
    """Starts jobs as ``Job`` does, and ends those that a failed test leaves running."""
    jobs: list[Job] = []

    def start(*arguments: Any, **options: Any) -> Job:
        jobs.append(Job(*arguments, **options))
        return jobs[-1]

    yield start
    for job in jobs:
        job.kill()
