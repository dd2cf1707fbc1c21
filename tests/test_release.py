"""What is released: one version, one command for all others, and a wheel that works by itself."""

import os
import platform
import re
import shlex
import shutil
import sys
import tomllib
from importlib.metadata import distributions
from pathlib import Path
from subprocess import run

import pytest
from packaging.specifiers import SpecifierSet

from common.command import path_of
from experiments.__main__ import (
    COMMANDS,
    GROUPS,
    PACKAGES,
    STUDIES,
    clashes,
    main,
    parser_of,
    studies,
    text,
)
from experiments.app.doctor.installed import EXTRAS
from experiments.config import jobs as configured
from tests.conftest import ROOT, printed

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_command_has_all_commands():
    own = {path_of(module) for module in COMMANDS.values()} | {path_of("experiments")}
    files = {path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    programs = {path for path in files if '\nif __name__ == "__main__":' in path.read_text()}
    assert programs <= own <= files
    for names, said in ((COMMANDS.keys() - STUDIES, text()), (STUDIES, studies())):
        assert all(re.search(rf"^  {name} +\w.*\w{{3}}", said, re.MULTILINE) for name in names)
        assert max(map(len, said.splitlines())) <= 80
    assert all(name in text() for name in STUDIES) and [*configured.STUDIES] == [*STUDIES]
    places = [text().index(f"\n{title}:") for title in GROUPS]
    assert places == sorted(places) and text().index("  fit ") < text().index("  camvid ")


@pytest.mark.parametrize(("words", "said"), [
    ("experiments render", "sdr-jax render: error: the following"),
    ("scene.render", "sdr-jax render: error: the following"),
    ("experiments camvid --nonsense", "sdr-jax camvid: error: no option --nonsense"),
    ("experiments study table --sede 3", "sdr-jax study table: error: no option --sede; did you mean --seed"),
    ("experiments table --sede 3", "sdr-jax study table: error: no option --sede"),
    ("experiments.studies.ablation --sede 3", "sdr-jax study ablation: error: no option --sede"),
])  # fmt: skip
def test_a_command_has_one_name_however_it_is_called(words, said):
    command = [sys.executable, "-m", *words.split()]
    ran = run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 2 and said in ran.stderr and ran.stderr.count("\n") == 1


@pytest.mark.parametrize(("words", "said"), [
    (["rendr"], "sdr-jax: error: no command 'rendr'; did you mean render?"),
    (["xyz"], "sdr-jax: error: no command 'xyz'; sdr-jax --help lists all"),
    (["study", "ablatoin"], "sdr-jax study: error: no study 'ablatoin'; did you mean ablation?"),
    (["study", "compare"],
     "sdr-jax study: error: no study 'compare'; use sdr-jax study searches --core-minutes"),
    (["results"],
     "sdr-jax: error: no command 'results'; in a checkout, make results or python -m scripts.results"),
    (["study", "fit"], "sdr-jax study: error: no study 'fit'; sdr-jax study --help lists all"),
])  # fmt: skip
def test_a_misspelt_command_is_one_line_and_exit_code_2(words, said, capsys):
    assert main(words) == 2 and capsys.readouterr().err == f"{said}\n"


def test_a_package_of_another_distribution_is_named_where_an_import_fails(monkeypatch, capsys):
    installed = {"scene": ["sdr-jax", "scenery"], "seg": ["sdr-jax"], "other": ["x"]}
    (line,) = clashes(installed)
    assert line.startswith("scenery") and "'scene'" in line

    def fail(module):
        raise ImportError(f"no {module}")

    monkeypatch.setattr("experiments.__main__._run", lambda name, words: fail(name))
    monkeypatch.setattr("experiments.__main__.packages_distributions", dict)
    with pytest.raises(ImportError):
        main(["fit"])
    monkeypatch.setattr("experiments.__main__.packages_distributions", lambda: installed)
    assert main(["fit"]) == 2
    assert capsys.readouterr().err == f"sdr-jax fit: error: no fit: {line}\n"


def test_the_version_is_the_same_everywhere():
    assert f"\nversion: {PROJECT['version']}\n" in (ROOT / "CITATION.cff").read_text()
    heads = re.findall(r"^## ([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert heads[0] == PROJECT["version"]


def test_what_is_installed_is_told_without_starting_anything(capsys):
    assert main(["--version"]) == 0
    first, second, third = capsys.readouterr().out.splitlines()
    assert first == f"sdr-jax {PROJECT['version']}"
    assert second.startswith(f"Python {platform.python_version()}, jax ") and "NVIDIA GPU" in second
    assert third.startswith("extras: ") and "sdr-jax doctor tests the GPU" in third
    tools = {"docs", "test"}  # what developers use
    assert EXTRAS.keys() == PROJECT["optional-dependencies"].keys() - tools


@pytest.fixture(scope="module")
def script() -> str:
    """What the shell reads; made without what commands work with."""
    code = (
        "import sys\nfrom experiments.__main__ import main\nmain(['--completion'])\n"
        "print('#', *{'jax', 'flax', 'optax', 'trimesh', 'embreex'} & {*sys.modules})"
    )
    text = "\n".join(printed(code))
    assert text.endswith("\n#")
    return text


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(("words", "some"), [
    (["re"], {"render", "report"}),
    (["study", "ta"], {"table"}),
    (["render", "--as"], {"--assets", "--asset-use", "--asset-fraction", "--asset-count"}),
    (["render", "--format", "co"], {"coco"}),
    (["camvid", "--preset", ""], {"smoke", "quick", "paper"}),
    (["study", "table", "--hold"], {"--holdout"}),
    (["store", "me"], {"merge"}),
    (["study", "table", "--nets", "compact", "lite"], {"lite0", "lite1", "lite2"}),
    (["render", "--out", ""], {"street.png"}),  # files
])  # fmt: skip
def test_the_tab_key_completes_commands_flags_and_their_values(words, some, script, tmp_path):
    (tmp_path / "street.png").touch()
    line = " ".join(shlex.quote(word) for word in ["sdr-jax", *words])
    code = f"{script}\nCOMP_WORDS=({line}); COMP_CWORD={len(words)}; _shtab_sdr_jax; echo ${{COMPREPLY[@]}}"
    options = {"input": code, "capture_output": True, "text": True, "check": True}
    ran = run(["bash"], cwd=tmp_path, **options)
    assert set(ran.stdout.split()) == some and ran.stderr == ""


def test_only_known_shells_complete(capsys):
    assert main(["--completion", "fish"]) == 2
    said = "sdr-jax: error: --completion fish: must be one of bash, zsh, tcsh\n"
    assert capsys.readouterr().err == said


def test_pinned_versions_run_on_the_first_python_3_11():
    """Debian 12 has 3.11.2: pip would try other versions of everything else, without end."""
    pins = dict(
        re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    )
    required = {
        name: SpecifierSet(installed.metadata["Requires-Python"] or "")
        for name, version in pins.items()
        for installed in distributions(name=name)
        if installed.version == version
    }
    assert len(required) > len(pins) / 2
    assert [name for name, versions in required.items() if "3.11.0" not in versions] == []


def test_an_image_is_made_of_what_there_is_in_few_lines():
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    assert len(lines) <= 10 and lines[-1] == 'ENTRYPOINT ["sdr-jax"]'
    ignored = {line.rstrip("/") for line in (ROOT / ".dockerignore").read_text().splitlines()}
    needed = {*PACKAGES, "pyproject.toml", "README.md", "LICENSE", "constraints.txt"}
    assert not ignored & needed and {".git", ".venv", "runs"} <= ignored
    (extras,) = (line.partition("=")[2] for line in lines if line.startswith("ARG EXTRAS="))
    assert extras in PROJECT["optional-dependencies"]
    command = lines[0].partition("sdr-jax render ")[2].split()
    assert command and parser_of("render").parse_args(command).images == 8


def done(folder: Path, *words: object, **variables: str) -> str:
    """What a command prints in a folder, without the variables of this process that name packages."""
    own = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    options = {"cwd": folder, "env": {**own, **variables}, "capture_output": True, "text": True}
    ran = run([*map(str, words)], **options)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from nothing but what belongs in it."""
    folder = tmp_path_factory.mktemp("wheel")
    tree = folder / "tree"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tree / package)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    build = ("-m", "build", "--wheel", "--no-isolation", "--outdir", folder, tree)
    done(folder, sys.executable, *build)
    shutil.rmtree(tree)
    (wheel,) = folder.glob(f"sdr_jax-{PROJECT['version']}-*.whl")
    return wheel


@pytest.mark.slow
def test_a_bare_machine_installs_the_wheel_and_renders(wheel, tmp_path):
    """In an empty environment, from the registry; nothing of ours but the wheel."""
    done(tmp_path, sys.executable, "-m", "venv", "bare")
    bare = tmp_path / "bare" / "bin"
    done(tmp_path, bare / "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", wheel)
    assert "extras: none" in done(tmp_path, bare / "sdr-jax", "--version")
    checked = done(tmp_path, bare / "sdr-jax", "doctor")
    assert re.search(r"^renderer embree +works$", checked, re.MULTILINE)
    flags = "--images 1 --size 64x48 --workers 1 --out streets".split()
    done(tmp_path, bare / "sdr-jax", "render", *flags)
    assert (tmp_path / "streets" / "dataset.json").is_file()


@pytest.mark.slow
def test_the_wheel_works_outside_the_checkout(wheel, tmp_path):
    site = tmp_path / "site"
    done(tmp_path, sys.executable, "-m", "pip", "install", "--no-deps", "--target", site, wheel)
    assert {path.parent.name for path in site.glob("*/py.typed")} == {*PACKAGES}
    data = [p for package in PACKAGES for p in (ROOT / package).rglob("*.*")]
    data = [p.relative_to(ROOT) for p in data if p.suffix in (".css", ".html", ".js", ".pyi")]
    assert len(data) >= 6 and all((site / path).is_file() for path in data)
    where = "import experiments.__main__ as m; print(m.__file__)"
    own = {"PYTHONPATH": str(site)}
    assert done(tmp_path, sys.executable, "-c", where, **own).startswith(str(site))
    program = site / "bin" / "sdr-jax"
    assert "  camvid " in done(tmp_path, program, "--help", **own)
    flags = "--images 2 --size 64x48 --shots 1 --workers 1 --out streets".split()
    rendered = done(tmp_path, program, "render", *flags, **own)
    assert "2 images of 2 streets, one per street, in " in rendered
    assert (tmp_path / "streets" / "dataset.json").is_file()
