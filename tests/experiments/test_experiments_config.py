"""Presets, groups, and every option that can be wrong."""

import os
import subprocess
import sys
from dataclasses import fields, replace

import pytest
import tyro

from experiments.config import (
    CAMVID_GROUPS,
    CANDIDATES,
    CITYSCAPES_GROUPS,
    PRESETS,
    Config,
    camvid_config,
    check,
    cityscapes_config,
)
from experiments.errors import UserError
from experiments.main import UNREAD, main, preset_of
from experiments.search import make_method, make_space, total_updates
from experiments.targets import camvid_target, cityscapes_target
from experiments.twin import FIRST_ASSET
from scene.attributes import NAMES

from .conftest import ROOT

EXPERIMENTS = {
    "cityscapes": (cityscapes_config, cityscapes_target),
    "camvid": (camvid_config, camvid_target),
}


def run(experiment: str, *arguments: str) -> int:
    presets, target = EXPERIMENTS[experiment]
    return main(experiment, presets, target, "", arguments=["--workers", "0", *arguments])


def parse(*arguments: str, presets=cityscapes_config) -> Config:
    return tyro.cli(Config, default=presets("smoke"), args=arguments)


@pytest.mark.parametrize("groups", [CITYSCAPES_GROUPS, CAMVID_GROUPS])
def test_groups_are_six_and_a_partition_of_the_23(groups):
    members = [name for group in groups for name in group]
    assert len(groups) == 6
    assert len(members) == 23 and set(members) == set(NAMES)


def test_groups_are_the_papers():
    # Cityscapes: 7 positions; 8 densities in four pairs; 8 of the environment.
    assert [len(group) for group in CITYSCAPES_GROUPS] == [7, 2, 2, 2, 2, 8]
    assert all(name.endswith("_position") for name in CITYSCAPES_GROUPS[0])
    assert CITYSCAPES_GROUPS[1:5] == (
        ("building_probability", "building_interval"),
        ("fence_interval", "tree_interval"),
        ("bicycle_interval", "person_interval"),
        ("pole_interval", "car_interval"),
    )
    # CamVid: positions in four, 2 + 2 + 2 + 1; 8 densities; 8 of the environment.
    assert [len(group) for group in CAMVID_GROUPS] == [2, 2, 2, 1, 8, 8]
    assert CAMVID_GROUPS[:4] == (
        ("building_position", "fence_position"),
        ("tree_position", "pole_position"),
        ("bicycle_position", "person_position"),
        ("car_position",),
    )
    for groups in (CITYSCAPES_GROUPS, CAMVID_GROUPS):
        assert all(name.startswith(("illumination", "camera")) for name in groups[-1])


@pytest.mark.parametrize("presets", [cityscapes_config, camvid_config])
def test_the_paper_preset_has_the_papers_numbers(presets):
    config = presets("paper")
    assert (config.search.bins, config.search.learning_rate) == (10, 1e-2)
    assert (config.search.updates_per_group, config.search.datasets_per_update) == (50, 1)
    assert (config.search.baseline, config.search.normalise) == ("ema", False)
    assert (config.search.squared_reward, config.search.unoptimised) == (False, "random")
    assert total_updates(config) == 300
    assert (config.reward.images, config.reward.train.steps) == (180, 1000)
    assert (config.final.images, config.final.train.steps) == (450, 20_000)
    for stage in (config.reward, config.final):
        net = stage.train
        assert (net.net, net.optimizer, net.lr, net.batch) == ("deeplabv2", "sgd", 5e-4, 4)
        assert (net.momentum, net.weight_decay, net.power, net.warmup) == (0.9, 1e-4, 0.9, 0)
        assert (net.mirror, net.colour, net.blur, net.weighted) == (True, False, False, False)


def test_sizes_of_the_papers_targets():
    city, cam = cityscapes_config("paper"), camvid_config("paper")
    assert (city.reward.width, city.reward.height, city.reward_images) == (640, 320, 500)
    assert (cam.reward.width, cam.reward.height, cam.reward_images) == (480, 360, None)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("name", "presets"), [(n, p) for n, (p, _) in EXPERIMENTS.items()])
def test_every_preset_is_sound_and_says_which_it_is(name, presets, preset):
    config = check(presets(preset))
    assert config.preset == preset
    assert config.reward.train.table == config.final.train.table == name
    space = make_space(config)
    method = make_method(config.search, space)
    # SDR goes through its groups and ends; other methods take any number of updates.
    assert method.updates == (total_updates(config) if config.search.method == "sdr" else None)
    assert (config.search.method == "sdr") == (preset == "paper")


def test_every_field_is_a_flag():
    config = parse(
        "--search.method", "random_search", "--search.bins", "4", "--search.no-normalise",
        "--reward.train.net", "fcn8s", "--final.width", "128", "--candidates", "spread", "argmax",
        "--reward-images", "None", "--test-images", "3", "--twin-seed", "7", "--preset", "smoke",
    )  # fmt: skip
    assert (config.search.method, config.search.bins) == ("random_search", 4)
    assert config.search.normalise is False
    assert (config.reward.train.net, config.final.train.net) == ("fcn8s", "compact")
    assert (config.reward.width, config.final.width) == (64, 128)
    assert config.candidates == ("spread", "argmax")
    assert (config.reward_images, config.test_images, config.twin_seed) == (None, 3, 7)
    assert config.groups == CITYSCAPES_GROUPS


def test_any_partition_can_be_given_as_groups():
    first, rest = ",".join(NAMES[:5]), ",".join(NAMES[5:])
    config = parse("--groups", first, rest)
    assert config.groups == (NAMES[:5], NAMES[5:])
    assert make_space(config).groups == (tuple(range(5)), tuple(range(5, 23)))
    assert parse("--groups", *NAMES).groups == tuple((name,) for name in NAMES)


def test_help_names_every_flag_and_what_it_means(capsys):
    with pytest.raises(SystemExit) as end:
        run("cityscapes", "--help")
    assert end.value.code == 0
    text = capsys.readouterr().out
    for field in fields(Config):
        assert f"--{field.name.replace('_', '-')}" in text
    assert "NAME,NAME,..." in text


def test_the_preset_is_found_among_the_arguments():
    assert preset_of([]) == "quick"
    assert preset_of(["--seed", "1", "--preset", "paper"]) == "paper"
    assert preset_of(["--preset=smoke"]) == "smoke"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--preset", "huge"], ["--preset 'huge'", "smoke, quick, paper"]),
        (["--preset"], ["--preset ''", "smoke, quick, paper"]),
        (["--renderer", "vulkan"], ["--renderer 'vulkan'", "embree, opengl"]),
        (["--reward.train.table", "ade"], ["--reward.train", "'ade'", "camvid, cityscapes"]),
        (["--final.train.table", "camvid"], ["--final.train.table", "cityscapes", "not camvid"]),
        (["--final.train.net", "resnet"], ["--final.train", "'resnet'", "compact, deeplabv2"]),
        (["--reward.train.optimizer", "lion"], ["--reward.train", "'lion'", "adam, sgd"]),
        (["--reward.train.lr", "0"], ["--reward.train.lr", "positive"]),
        (["--reward.train.lr", "nan"], ["--reward.train.lr", "positive"]),
        (["--final.train.steps", "0"], ["--final.train.steps", "1 or more"]),
        (["--final.train.predict-batch", "0"], ["--final.train.predict-batch", "1 or more"]),
        (["--reward.train.warmup", "-1"], ["--reward.train.warmup", "0 or more"]),
        (["--reward.width", "60"], ["--reward.width", "multiples of 8", "60x32"]),
        (["--final.height", "0"], ["--final", "64x0"]),
        (["--final.samples", "9"], ["--final", "samples", "1..8"]),
        (["--reward.streets", "0"], ["--reward.streets", "1 or more"]),
        (["--reward.shots", "0"], ["--reward.shots", "1 or more"]),
        (["--search.bins", "1"], ["--search.bins", "2 or more"]),
        (["--search.updates-per-group", "0"], ["--search.updates-per-group", "1 or more"]),
        (["--search.datasets-per-update", "1"], ["leave_one_out", "2 or more"]),
        (["--search.learning-rate", "-1"], ["--search.learning-rate", "positive"]),
        (["--search.relaxation", "2"], ["--search", "width", "[0, 1]"]),
        (
            ["--search.relaxation", "2", "--search.method", "random_search"],
            ["--search", "width", "[0, 1]"],
        ),
        (["--candidates", "best"], ["--candidates", ", ".join(CANDIDATES), "not best"]),
        (["--candidates"], ["--candidates", ", ".join(CANDIDATES), "not none"]),
        (["--candidates", "spread", "spread"], ["--candidates", "twice"]),
        (["--groups", ",".join(NAMES[1:])], ["--groups", NAMES[0], "in no group"]),
        (["--groups", "hats"], ["--groups", "unknown", "'hats'"]),
        (["--groups", ",".join(NAMES), NAMES[2]], ["--groups", NAMES[2]]),
        (["--seeds", "0"], ["--seeds", "1 or more"]),
        (["--candidate-seeds", "0"], ["--candidate-seeds", "1 or more"]),
        (["--reward-images", "0"], ["--reward-images", "1 or more"]),
        (["--test-images", "-3"], ["--test-images", "1 or more"]),
        (["--asset-count", "0"], ["--asset-count", "1 or more"]),
        (["--asset-count", str(FIRST_ASSET)], ["--asset-count", "less than"]),
        (["--asset-fraction", "0"], ["--asset-fraction", "(0, 1]"]),
        (["--asset-use", "own"], ["--assets", "--asset-use 'own'", "folder"]),
        (["--assets", "/no/such"], ["--assets", "/no/such", "not there"]),
        (["--workers", "-1"], ["--workers", "0 or more"]),
        (["--seed", "-1"], ["--seed", "0 or more"]),
        (["--seed", str(2**31)], ["--seed", "less than"]),
        (["--twin-seed", "-1"], ["--twin-seed", "0 or more"]),
        (["--default-width", "1.5"], ["--default-width", "[0, 1]"]),
        (["--holdout", "ulm"], ["--holdout", "--data", "twin"]),
        (["--test-split", "val"], ["--test-split", "--data", "twin"]),
        (["--data", "/no/such"], ["/no/such", "no such folder", "leftImg8bit"]),
    ],
)
def test_a_wrong_option_is_one_line_and_exit_code_2(arguments, words, error_line, tmp_path):
    out = tmp_path / "new" / "run"
    preset = [] if "--preset" in arguments else ["--preset", "smoke"]
    assert run("cityscapes", "--out", str(out), *preset, *arguments) == 2
    line = error_line()
    for word in words:
        assert word in line
    assert not out.parent.exists()


@pytest.mark.parametrize(
    "arguments", [["--seeds", "two"], ["--search.method", "magic"], ["--colour", "red"]]
)
def test_what_the_parser_refuses_has_exit_code_2(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        run("cityscapes", "--preset", "smoke", *arguments)
    assert end.value.code == 2
    assert arguments[0] in capsys.readouterr().err


def test_output_that_nobody_reads_is_no_error():
    """As of ``--help | head``."""
    command = [sys.executable, "-m", "experiments.cityscapes", "--help"]
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(command, cwd=ROOT, stdout=writing, stderr=subprocess.PIPE, text=True)
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (UNREAD, "")


def test_camvid_takes_its_folder_from_the_variable(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CAMVID_DIR", raising=False)
    flags = ["--preset", "smoke", "--workers", "0"]
    presets, target = EXPERIMENTS["camvid"]
    assert main("camvid", presets, target, "", flags, data_variable="CAMVID_DIR") == 2
    assert "--data DIR" in capsys.readouterr().err
    monkeypatch.setenv("CAMVID_DIR", "/no/such")
    assert main("camvid", presets, target, "", flags, data_variable="CAMVID_DIR") == 2
    assert capsys.readouterr().err.startswith("error: /no/such: no such folder")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_renderer_is_the_users_to_mend(monkeypatch):
    from experiments import job, study
    from scene.render import RendererError

    def missing(name):
        raise RendererError("EGL is missing; install libegl1")

    monkeypatch.setattr(study, "renderer", missing)
    with pytest.raises(UserError, match="libegl1"):
        job.run(replace(cityscapes_config("smoke"), renderer="opengl"), cityscapes_target)
