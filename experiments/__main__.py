"""All commands as `sdr-jax COMMAND`, and the studies of the paper as `sdr-jax study NAME`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.metadata import packages_distributions, version
from runpy import run_module
from textwrap import wrap

from common.command import HELP, PROGRAM, USAGE, Parser, docstring, path_of
from common.errors import suggestion

DISTRIBUTION = "sdr-jax"
PACKAGES = ("sdr_jax", "scene", "seg", "experiments", "common")
"""The packages that we install; other distributions may use the same short names."""
GROUPS = {
    "Your own images": {
        "doctor": "experiments.app.doctor.command",
        "fit": "experiments.app.fit.command",
        "predict": "experiments.app.predict",
        "evaluate": "experiments.app.evaluate",
        "export": "experiments.app.export",
    },
    "Rendered streets": {
        "render": "scene.render",
        "check": "scene.check",
        "stats": "scene.stats",
        "preview": "scene.preview",
        "playground": "experiments.app.playground.command",
        "catalogue": "scene.assets",
    },
    "Optimise streets or your own simulator": {
        "cityscapes": "experiments.cityscapes",
        "camvid": "experiments.camvid",
        "labelmefacade": "experiments.labelmefacade",
        "tune": "sdr_jax.tune",
        "report": "experiments.app.report.command",
        "store": "experiments.app.stores",
        "weights": "seg.weights",
    },
}
"""Modules of the commands by task, in the order of the help."""
STUDIES = {
    name: f"experiments.studies.{name}"
    for name in (
        "table", "labels", "pretrain", "ablation", "assets", "searches", "sensitivity", "fidelity",
    )
}  # fmt: skip
"""Modules of the paper's studies, `sdr-jax study NAME`."""
COMMANDS = {name: module for group in GROUPS.values() for name, module in group.items()} | STUDIES
"""Modules of all commands; a study is a command, too."""
MOVED = {
    "compare": f"use {PROGRAM} study searches --core-minutes",
    "results": "in a checkout, make results or python -m scripts.results",
    "renders19": "in a checkout, python -m scripts.renders19",
}
"""Removed commands, and what to use instead."""
FIRST = (
    ("predict renders19 photos --as overlay --out labels", "label your photos now"),
    ("doctor photos --write photos/target.yaml", "describe your labelled images"),
    ("fit photos --out runs/fit", "train on your labels plus rendered streets"),
    ("render --images 8 --out streets", "render labelled streets"),
    ("camvid --data CAMVID", "optimise the streets for a data set"),
    ("tune space.toml -- ./simulator", "optimise your own simulator"),
)
"""Six commands to start with, by task."""
STUDY = "study"
SHELLS = ("bash", "zsh", "tcsh")
"""Shells that complete commands and flags with the tab key."""
WIDTH = 80
"""Characters of a line of the help."""
PARSERS = {"experiments": "experiments.config.parsers", "scene": "scene.parsers"}
"""The modules with the command lines of a package's commands; they do not import their work."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command in this process, as `python -m` would; returns the exit code."""
    words = [*(sys.argv[1:] if arguments is None else arguments)]
    if not words:
        print(first_commands())
        return 0
    name, *rest = [*words, "--help"]
    program, kind, names, help_text = PROGRAM, "command", (*COMMANDS, STUDY), text
    if name == STUDY:
        name, *rest = rest
        program, kind, names, help_text = f"{PROGRAM} {STUDY}", "study", (*STUDIES,), studies
    if name in HELP:
        print(help_text())
        return 0
    if name == "--version":
        from experiments.app.doctor.installed import installed

        print(DISTRIBUTION, version(DISTRIBUTION))
        print(installed())
        return 0
    if name == "--completion":
        return completion(rest[0] if len(rest) > 1 else SHELLS[0])
    if name not in names:
        advice = f"; {MOVED[name]}" if name in MOVED else suggestion(name, names)
        advice = advice or f"; {program} --help lists all"
        print(f"{program}: error: no {kind} {name!r}{advice}", file=sys.stderr)
        return USAGE
    return run(name, rest[:-1])


def run(name: str, words: Sequence[str]) -> int:
    """Run a command; for help and wrong flags its libraries are not loaded."""
    try:
        return _run(name, words)
    except ImportError as error:
        others = "; ".join(clashes(packages_distributions()))
        if not others:
            raise
        print(f"{PROGRAM} {name}: error: {error}: {others}", file=sys.stderr, flush=True)
        return USAGE


def _run(name: str, words: Sequence[str]) -> int:
    module = COMMANDS[name]
    if make_parser := _parser(name):
        options = make_parser().parse_args(words)
        work = f"{module}.__main__" if path_of(module).stem == "__main__" else module
        code: int = import_module(work).main(options)
        return code
    if module.startswith("experiments."):
        from experiments.config.cli import command

        return command(name, words)
    sys.argv[1:] = words
    run_module(module, run_name="__main__", alter_sys=True)  # raises SystemExit
    return 0


def _parser(name: str) -> Callable[[], Parser] | None:
    """The function that makes a command's parser without importing its work; None for other commands."""
    module = PARSERS.get(COMMANDS[name].partition(".")[0])
    return getattr(import_module(module), name, None) if module else None


def parser_of(name: str) -> Parser:
    """The parser of a command or study; its work is not imported."""
    if make_parser := _parser(name):
        return make_parser()
    from experiments.config import cli

    if name in cli.JOBS:
        return cli.parser(name)
    parser: Parser = import_module(f"{COMMANDS[name]}.__main__").parser()
    return parser


def completion(shell: str) -> int:
    """Print the completion script of a shell; return the exit code."""
    import shtab

    if shell not in SHELLS:
        shells = ", ".join(SHELLS)
        print(f"{PROGRAM}: error: --completion {shell}: must be one of {shells}", file=sys.stderr)
        return USAGE
    root = argparse.ArgumentParser(PROGRAM, add_help=False)
    for flag in ("--help", "--version", "--completion"):
        root.add_argument(flag, action="store_true")
    commands = root.add_subparsers(parser_class=argparse.ArgumentParser)
    study = commands.add_parser(STUDY, help="the studies of the paper", add_help=False)
    of_study = study.add_subparsers(parser_class=argparse.ArgumentParser)
    for name, module in COMMANDS.items():
        group = of_study if name in STUDIES else commands
        parents, line = [parser_of(name)], summary(module)
        parser = group.add_parser(name, parents=parents, help=line, add_help=False)
        for action in parser._actions:
            if action.nargs != 0 and not action.choices:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(root, shell))
    return 0


def first_commands() -> str:
    """The text that the program prints without arguments."""
    rows = [line for words, task in FIRST for line in (f"  # {task}", f"  {PROGRAM} {words}")]
    return "\n".join(
        [
            "Train street-segmentation networks from a few labelled photos plus rendered streets.",
            "",
            *rows,
            "",
            f"{PROGRAM} --help lists all commands; {PROGRAM} COMMAND --help explains one.",
        ]
    )


def text() -> str:
    """The help: every command with the first line of its docstring; no command is loaded."""
    width = max(map(len, COMMANDS))
    lines = []
    for title, group in GROUPS.items():
        lines += ["", f"{title}:", *_rows(group, width)]
    first, *more = wrap(f"NAME: {', '.join(STUDIES)}", WIDTH - width - 4)
    lines += ["", "Studies of the paper:", f"  {STUDY:{width}s}  {first}"]
    lines += [f"  {'':{width}s}  {line}" for line in more]
    return "\n".join(
        [
            f"usage: {PROGRAM} COMMAND ...",
            "",
            "Street segmentation with rendered images.",
            f"{PROGRAM} COMMAND --help explains a command.",
            *lines,
            "",
            f"{PROGRAM} --version shows the installed versions. For tab completion, add",
            f'eval "$({PROGRAM} --completion)" to ~/.bashrc; in zsh, use --completion zsh.',
        ]
    )


def studies() -> str:
    """The help of `sdr-jax study`."""
    head = f"Studies of the paper. {PROGRAM} {STUDY} NAME --help explains a study."
    rows = _rows(STUDIES, max(map(len, STUDIES)))
    return "\n".join([f"usage: {PROGRAM} {STUDY} NAME ...", "", head, "", *rows])


def _rows(group: Mapping[str, str], width: int) -> Iterator[str]:
    """One line or more for each command, none longer than `WIDTH`."""
    for name, module in group.items():
        first, *more = wrap(summary(module), WIDTH - width - 4)
        yield f"  {name:{width}s}  {first}"
        yield from (f"  {'':{width}s}  {line}" for line in more)


def summary(module: str) -> str:
    """The first line of a command's docstring."""
    return docstring(module).partition("\n")[0].rstrip(".")


def clashes(installed: Mapping[str, list[str]]) -> Iterator[str]:
    """Yield a message for each of our packages that another distribution has, too.

    Args:
        installed: the distributions of each top-level package, from `packages_distributions`.
    """
    for package in PACKAGES:
        others = sorted({*installed.get(package, ())} - {DISTRIBUTION})
        if others:
            yield (
                f"{' and '.join(others)} is also installed here and has a package {package!r}, as "
                f"{DISTRIBUTION} has; one may hide the other, so install each in its own environment"
            )


if __name__ == "__main__":
    sys.exit(main())
