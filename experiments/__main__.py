"""All commands under one name: `sdr-jax camvid --data DIR` is `python -m experiments.camvid --data DIR`."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from runpy import run_module

from shell.command import USAGE, call

DISTRIBUTION = "sdr-jax"
PACKAGES = ("sdr_jax", "scene", "seg", "experiments", "shell")
"""The names that we install beside each other, short enough for others to have had the same idea."""
COMMANDS = {
    "doctor": "experiments.doctor",
    "fit": "experiments.fit",
    "predict": "experiments.predict",
    "evaluate": "experiments.evaluate",
    "export": "experiments.export",
    "cityscapes": "experiments.cityscapes",
    "camvid": "experiments.camvid",
    "labelmefacade": "experiments.labelmefacade",
    "labels": "experiments.labels",
    "table": "experiments.table",
    "searches": "experiments.searches",
    "compare": "experiments.compare",
    "pretrain": "experiments.pretrain",
    "ablation": "experiments.ablation",
    "assets": "experiments.assets",
    "sensitivity": "experiments.sensitivity",
    "fidelity": "experiments.fidelity",
    "results": "experiments.results",
    "report": "experiments.report",
    "store": "experiments.store",
    "render": "scene.render",
    "check": "scene.check",
    "stats": "scene.stats",
    "preview": "scene.preview",
    "playground": "experiments.playground",
    "catalogue": "scene.assets",
    "weights": "seg.weights",
    "renders19": "experiments.renders19",
    "tune": "sdr_jax.tune",
}
"""Command to module; in the order of the help."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command in this process, as `python -m` would; returns the exit code."""
    name, *rest = [*(sys.argv[1:] if arguments is None else arguments), "--help"]
    if name in ("-h", "--help"):
        print(text())
        return 0
    if name == "--version":
        print(DISTRIBUTION, version(DISTRIBUTION))
        return 0
    if name not in COMMANDS:
        known = ", ".join(COMMANDS)
        print(f"sdr-jax: error: no command {name!r}; there are {known}", file=sys.stderr)
        return USAGE
    for line in clashes(packages_distributions()):
        print(f"sdr-jax: warning: {line}", file=sys.stderr, flush=True)
    call(COMMANDS[name], f"{DISTRIBUTION} {name}")
    sys.argv[1:] = rest[:-1]
    run_module(COMMANDS[name], run_name="__main__", alter_sys=True)  # leaves by SystemExit
    return 0


def text() -> str:
    """The help: every command with the first line of its docstring, and no command loaded."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:{width}s}  {summary(module)}" for name, module in COMMANDS.items()]
    head = "usage: sdr-jax COMMAND ...\n\nLearning to simulate complex scenes. COMMAND --help says more."
    return "\n".join([head, "", *lines, "", "sdr-jax --version prints the version."])


def summary(module: str) -> str:
    """The first line of a command's docstring, read from its file."""
    source = path_of(module).read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0].rstrip(".")


def path_of(module: str) -> Path:
    """The file that `python -m module` runs; of its packages only the first is loaded."""
    package, *names = module.split(".")
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    place = Path(spec.origin).parent.joinpath(*names)
    return place / "__main__.py" if place.is_dir() else place.with_suffix(".py")


def clashes(installed: Mapping[str, list[str]]) -> Iterator[str]:
    """Says which other distributions have put files into our packages.

    Args:
        installed: the distributions of each top-level package, as `packages_distributions` has them.
    """
    for package in PACKAGES:
        others = sorted({*installed.get(package, ())} - {DISTRIBUTION})
        if others:
            yield (
                f"{' and '.join(others)}, installed here, too, has a package named {package!r} as "
                f"{DISTRIBUTION} has, and one may hide the other; give each an environment of its own"
            )


if __name__ == "__main__":
    sys.exit(main())
