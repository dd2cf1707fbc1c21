"""Presets, groups, and every option that can be wrong."""

import math
import runpy
import sys
from dataclasses import asdict, fields, replace
from typing import get_type_hints

import numpy as np
import pytest

from common.errors import UserError
from common.files import write_json
from common.folder import as_json
from common.workers.pool import cores
from experiments.app.main_job import MAIN
from experiments.attribute_search.plans import plan_of
from experiments.config import (
    Fidelity,
    GroupsConfig,
    MainConfig,
    check,
    fidelities,
    make_space,
    start_of,
    trainers,
)
from experiments.config.cli import command
from experiments.config.jobs import STUDIES, TableConfig, defaults_of, methods_of
from experiments.config.limits import training_bytes
from experiments.config.presets import (
    CAMVID_GROUPS,
    CITYSCAPES_GROUPS,
    PRESETS,
    TABLES,
    TARGETS,
    defaults,
    in_space,
)
from experiments.studies import table
from experiments.tables.skeleton import check as refuse_wrong
from experiments.tables.skeleton import do
from experiments.targets.twin import FIRST_ASSET
from scene import parsers
from scene.attributes import NAMES, names
from scene.proposal import Histogram, describe, mixture, moments, random_proposal
from scene.version import ENGINE
from seg.recipes import RECIPES, with_steps
from seg.settings import TrainSettings

from .conftest import by_preset, main_job, never, parsed, startable, study


def parse(*arguments: str) -> MainConfig:
    return parsed(defaults(MainConfig, "twin", "smoke"), arguments)


def test_groups_are_the_papers_and_a_partition_of_the_23():
    # Cityscapes: 7 positions; 8 densities in four pairs; 8 of the environment.
    assert [len(group) for group in CITYSCAPES_GROUPS] == [7, 2, 2, 2, 2, 8]
    assert all(name.endswith("_position") for name in CITYSCAPES_GROUPS[0])
    assert CITYSCAPES_GROUPS[1:5] == (
        ("building_probability", "building_interval"), ("fence_interval", "tree_interval"),
        ("bicycle_interval", "person_interval"), ("pole_interval", "car_interval"),
    )  # fmt: skip
    # CamVid: positions in four, 2 + 2 + 2 + 1; 8 densities; 8 of the environment.
    assert [len(group) for group in CAMVID_GROUPS] == [2, 2, 2, 1, 8, 8]
    assert CAMVID_GROUPS[:4] == (
        ("building_position", "fence_position"), ("tree_position", "pole_position"),
        ("bicycle_position", "person_position"), ("car_position",),
    )  # fmt: skip
    for groups in (CITYSCAPES_GROUPS, CAMVID_GROUPS):
        assert all(name.startswith(("illumination", "camera")) for name in groups[-1])
        assert sorted(name for group in groups for name in group) == sorted(NAMES)


@pytest.mark.parametrize("target", TARGETS)
def test_another_space_has_groups_of_its_own_and_every_job_searches_it(target):
    config = in_space(defaults(MainConfig, target, "smoke"), "extended")
    assert in_space(config, "extended") is config
    assert plan_of(config).subset == names("extended") == make_space(config).names
    assert config.groups[:-4] == defaults(MainConfig, target, "smoke").groups


@pytest.mark.parametrize("target", TARGETS)
def test_the_paper_preset_has_the_papers_numbers(target):
    config = defaults(MainConfig, target, "paper")
    search = config.search
    assert (search.bins, search.learning_rate, search.updates_per_group) == (10, 1e-2, 50)
    assert search.datasets_per_update == 1
    assert plan_of(config).updates == 300
    assert (config.reward.images, config.reward.train.steps) == (180, 1000)
    assert (config.final.images, config.final.train.steps) == (450, 20_000)
    four_by_three = target in ("camvid", "labelmefacade")
    assert config.reward_images == (None if four_by_three else 500)
    assert config.reward.size == ("480x360" if four_by_three else "640x320")
    large = "480x360" if four_by_three else "1024x512"
    assert config.final.size == large
    for name in (*STUDIES, "main"):  # every size of every command
        named = config if name == "main" else defaults_of(name, target, "paper")
        sizes = {field: fidelity.size for field, fidelity in fidelities(named).items()}
        expected = {"reward": config.reward.size, "final": large, "compact": large, "vgg": large}
        assert sizes == {field: expected[field] for field in sizes}
    for fidelity in (config.reward, config.final):
        net = fidelity.train
        assert (net.net, net.optimizer, net.lr, net.batch) == ("deeplabv2", "sgd", 5e-4, 4)
        assert (net.momentum, net.weight_decay, net.power, net.warmup) == (0.9, 1e-4, 0.9, 0)
        assert (net.mirror, net.colour, net.blur, net.weighted) == (True, False, False, False)


@pytest.mark.parametrize("target", TARGETS)
def test_every_study_of_the_paper_preset_is_the_papers(target):
    of = {name: defaults_of(name, target, "paper") for name in STUDIES}
    for name, config in of.items():
        methods = methods_of(config) if isinstance(config, GroupsConfig) else ()
        assert methods in ((), ("sdr",)), name
    assert of["table"].nets == ("fcn8s", "deeplabv2") and of["table"].all_images
    assert of["assets"].attributes == "learnt"
    pretrain = of["pretrain"]  # fine-tuned on all 2,975 images of Cityscapes, searched on 500
    assert (pretrain.reward_images, pretrain.search_images) == (None, 500)
    assert pretrain.final.train == replace(RECIPES["paper"], net="fcn8s", steps=20_000)
    assert of["ablation"].evaluations == 300


@pytest.mark.parametrize(("name", "flags", "message"), [
    ("main", (), "--preset paper starts deeplabv2 (--reward.train) from ImageNet weights"),
    ("main", ("--reward.train.net", "lite0"), "(--final.train) from ImageNet weights"),
    ("main", ("--weights", "/no.npz"), "/no.npz: No such file"),
    ("main", ("--weights", "/no.npz", "--from-scratch"), "exclude each other"),
    ("main", ("--weights", "/no.npz", "--reward.train.net", "lite0", "--final.train.net", "lite0"),
     "--weights is for VGG networks and dinov2; this job trains lite0"),
    ("table", ("--reward.train.net", "lite0", "--final.train.net", "lite0"), "starts fcn8s (--nets)"),
    ("pretrain", (), "starts deeplabv2 (--reward.train)"),
    ("pretrain", ("--reward.train.net", "lite0"), "starts fcn8s (--final.train)"),
])  # fmt: skip
def test_the_paper_preset_needs_weights_and_says_how_to_get_them(
    name, flags, message, error_line, out
):
    flags = ("--preset", "paper", "--data", "none", "--out", str(out), *flags)
    code = (
        main_job("camvid", *flags) if name == "main" else study(name, "--target", "camvid", *flags)
    )
    assert code == 2 and not out.exists()
    line = error_line()
    assert message in line
    if "starts" in message:
        assert "--weights vgg16.npz, or --from-scratch" in line
        assert "sdr-jax weights convert vgg16-397923af.pth --out vgg16.npz" in line


def test_weights_are_those_of_every_net_that_starts_from_a_file():
    configs = []
    flags = ("--weights", "w.npz", "--final.train.weights", "v.npz", "--preset", "paper")
    command("camvid", flags, configs.append)
    flags = ("--weights", "w.npz", "--reward.train.net", "lite0", "--preset", "paper")
    command("camvid", flags, configs.append)
    weights = [[config.reward.train.weights, config.final.train.weights] for config in configs]
    assert weights == [["w.npz", "v.npz"], [None, "w.npz"]]
    paper = replace(RECIPES["paper"], weights="w.npz", steps=20_000)
    assert configs[1].final.train == paper


def unknown(kind: type, values: dict) -> list[str]:
    """What a table says of fields that a configuration lacks."""
    hints = get_type_hints(kind)
    inner = [n for k, v in values.items() if isinstance(v, dict) for n in unknown(hints[k], v)]
    return [name for name in values if name not in hints and name != "recipe"] + inner


def test_the_tables_of_presets_name_fields_that_there_are():
    assert unknown(TableConfig, {"final": {"train": {"step": 3}}, "sets": 1}) == [
        "sets",
        "step",
    ]
    for _, _, values in TABLES:
        assert unknown(TableConfig, values) == []


@by_preset
def test_every_preset_is_sound_and_says_which_it_is(target, preset):
    config = startable(defaults(MainConfig, target, preset))
    check(config)
    assert (config.preset, config.target) == (preset, target)
    plan = plan_of(config)
    # SDR goes through its groups and ends; other methods take any number of updates.
    assert plan.search.updates == (plan.updates if plan.method == "sdr" else None)
    assert (plan.method == "sdr") == (preset == "paper")
    # Told to, every preset estimates the gradient as the paper does.
    search = config.search
    assert (search.baseline, search.normalise, search.learning_rate) == ("ema", False, 1e-2)
    assert (search.squared_reward, search.unoptimised) == (False, "random")


def test_a_search_starts_from_the_moments_of_probabilities_and_not_from_a_mixture(tmp_path):
    file = tmp_path / "attributes.json"
    histogram = Histogram(np.tile(np.float32([0.25, 0.5, 0.25]), (len(NAMES), 1)))
    config = parse("--start", str(file), "--space", "scenex")
    write_json(file, describe(histogram))
    np.testing.assert_array_equal(start_of(config), moments(histogram))
    write_json(file, describe(mixture((0.5, 0.5), (random_proposal(), histogram))))
    with pytest.raises(UserError, match=f"--search.start {file} holds 2 components"):
        start_of(config)
    with pytest.raises(UserError, match=r"or an attributes\.json; did you mean default"):
        start_of(parse("--start", "defalt"))


def test_every_field_is_a_flag():
    config = parse(
        "--search.method", "random_search", "--search.bins", "4", "--search.normalise",
        "--reward.train.net", "fcn8s", "--final.width", "128",
        "--reward-images", "None", "--test-images", "3", "--twin-seed", "7", "--preset", "smoke",
    )  # fmt: skip
    search = config.search
    assert (search.method, search.bins, search.normalise) == ("random_search", 4, True)
    assert (config.reward.train.net, config.final.train.net) == ("fcn8s", "compact")
    assert (config.reward.width, config.final.width) == (64, 128)
    assert (config.reward_images, config.test_images, config.twin_seed) == (None, 3, 7)
    assert config.groups == CITYSCAPES_GROUPS


def test_any_partition_can_be_given_as_groups():
    first, rest = ",".join(NAMES[:5]), ",".join(NAMES[5:])
    config = parse("--groups", first, rest)
    assert config.groups == (NAMES[:5], NAMES[5:])
    assert make_space(config).groups == (tuple(range(5)), tuple(range(5, 23)))
    assert parse("--groups", *NAMES).groups == tuple((name,) for name in NAMES)


def test_all_help_names_every_flag_and_what_it_means(capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        main_job("cityscapes", "--help-all")
    text = capsys.readouterr().out
    flags = {f"--{field.name.replace('_', '-')}" for field in fields(MainConfig)}
    assert all(flag in text for flag in flags - {"--target"})  # the command's name says it
    assert "NAME,NAME,..." in text


FROM_0 = ("--workers", "--seed", "--twin-seed")
COUNTS = ("--final.train.steps", "--final.train.predict-batch", "--reward.streets", "--reward.shots",
          "--search.updates-per-group", "--seeds", "--reward-images", "--asset-count")  # fmt: skip
SIZES = ("--reward.streets", "--reward.shots", "--final.samples", "--final.train.batch", "--seeds",
         "--reward.train.predict-batch", "--reward.train.steps", "--workers",
         "--search.datasets-per-update", "--search.updates-per-group")  # fmt: skip


@pytest.mark.parametrize(("arguments", "words"), [
    (["--reward.train.lr", "0"], ["--reward.train.lr", "positive"]),
    (["--reward.width", "60"], ["--reward.width", "multiples of 8", "60x32"]),
    (["--final.height", "0"], ["--final", "64x0"]),
    (["--final.samples", "9"], ["--final", "samples", "1..8"]),
    (["--search.bins", "1"], ["--search.bins", "2 or more"]),
    (["--method", "sdr", "--search.datasets-per-update", "1", "--search.baseline", "leave_one_out"],
     ["2 or more"]),
    (["--method", "sdr", "--search.learning-rate", "-1"], ["--search.learning-rate", "positive"]),
    (["--search.relaxation", "2"], ["--search.relaxation", "[0, 1]"]),
    (["--search.relaxation", "2", "--search.method", "random_search"], ["--search.relaxation", "[0, 1]"]),
    (["--final.train.net", "resnet"], ["--final.train.net", "unknown network 'resnet'", "compact", "lite1"]),
    (["--groups", ",".join(NAMES[1:])], ["--groups", NAMES[0], "in no group"]),
    (["--groups", "hats"], ["--groups", "unknown", "'hats'"]),
    (["--groups", ",".join(NAMES), NAMES[2]], ["--groups", NAMES[2]]),
    (["--test-images", "-3"], ["--test-images", "1 or more"]),
    *(([flag, "0"], [flag, "1 or more"]) for flag in COUNTS),
    *(([flag, "-1"], [flag, "0 or more"]) for flag in FROM_0),
    (["--asset-count", str(FIRST_ASSET)], ["--asset-count", "less than"]),
    (["--asset-fraction", "0"], ["--asset-fraction", "(0, 1]"]),
    (["--asset-use", "own"], ["--asset-use 'own'", "folder"]),
    (["--assets", "/no/such"], ["--assets", "/no/such", "does not exist"]),
    (["--seed", str(2**31)], ["--seed", "2147483647 or less"]),
    (["--asset-count", "2000000"], ["--asset-count", "1,000,000 or less"]),
    (["--search.bins", "1001"], ["--search.bins", "1000 or less"]),
    *(([flag, str(10**12)], [flag, " of memory for ", "use at most"]) for flag in SIZES),
    (["--seeds", str(10**400)], ["--seeds", "more than 4,000 PB"]),
    (["--reward.train.warmup", str(10**12)], ["--reward.train.warmup", "2147483647 or less"]),
    (["--holdout", "ulm"], ["--holdout", "--data", "twin"]),
    (["--test-split", "val"], ["--test-split", "--data", "twin"]),
    (["--data", "/no/such"], ["/no/such", "no such folder", "leftImg8bit"]),
    (["--data", "/no/such", "--twin", "far"], ["--twin far is for the twin", "not cityscapes"]),
])  # fmt: skip
def test_a_wrong_option_is_one_line_and_exit_code_2(arguments, words, error_line, tmp_path):
    out = tmp_path / "new" / "run"
    target = "cityscapes" if "--data" in arguments else "twin"
    assert main_job(target, "--out", str(out), *arguments) == 2
    line = error_line()
    assert all(word in line for word in words), line
    assert not out.parent.exists()


def test_memory_is_counted_for_all_workers(monkeypatch):
    config = defaults(MainConfig, "camvid", "quick")
    need = training_bytes(config.final)
    monkeypatch.setattr("common.memory.memory", lambda: 4 * need)
    check(replace(config, workers=4))
    with pytest.raises(
        UserError, match=r"--workers 5 .*for training sets of --final.* use at most 4"
    ):
        check(replace(config, workers=5))
    # Processes that only render hold no training set.
    monkeypatch.setattr(trainers, "usable_gpus", lambda: ["0", "1", "2", "3", "4"])
    check(replace(config, workers=6, trainers=4))
    with pytest.raises(UserError, match=r"--trainers 5 would take .* use at most 4"):
        check(replace(config, workers=1))


FIDELITIES = [*fidelities(defaults_of("table", "camvid", "smoke"))]


@pytest.mark.parametrize("name", FIDELITIES)
def test_every_number_of_every_fidelity_is_checked(name):
    config = defaults_of("table", "camvid", "smoke")
    original = getattr(config, name)
    wrong, tried = {int: (-1,), float: (-1.0, math.nan)}, 0
    for kind, old in ((Fidelity, original), (TrainSettings, original.train)):
        for field, of in get_type_hints(kind).items():
            for value in wrong.get(of, ()):
                new = replace(old, **{field: value})
                fidelity = new if old is original else replace(original, train=new)
                with pytest.raises(UserError, match=rf"^--{name}\b.*{field.replace('_', '[-_]')}"):
                    refuse_wrong(table.STUDY, replace(config, **{name: fidelity}))
                tried += 1
    assert tried > 20


@pytest.mark.parametrize("name", FIDELITIES)
@pytest.mark.parametrize(("flags", "message"), [
    (("train.lr=-1",), ".train.lr must be positive, not -1.0"),
    (("train.warmup=500",), ".train: warmup must be less than the "),
    (("train.net=lite0", "width=24"), ": images of 24x48 are too small for lite0"),
])  # fmt: skip
def test_a_wrong_fidelity_has_exit_code_2(name, flags, message, error_line, out):
    values = [f"--{name}.{flag}" for flag in flags]
    fixed = ("--target", "camvid", "--preset", "smoke", "--data", "none", "--out", str(out))
    assert study("table", *fixed, *values) == 2
    assert error_line().startswith(f"error: --{name}{message}") and not out.exists()


def test_a_net_of_the_table_needs_images_that_are_large_enough(error_line, out):
    fixed = ("--target", "camvid", "--preset", "smoke", "--data", "none", "--out", str(out))
    assert study("table", *fixed, "--nets", "lite0", "--final.width", "24") == 2
    assert error_line().startswith("error: --nets: images of 24x48 are too small for lite0")


@pytest.mark.parametrize(("arguments", "words"), [
    (["--preset", "huge"], ["--preset", "smoke", "quick", "paper"]),
    (["--search.method", "magic"], ["--search.method", "surrogate", "gaussian"]),
    (["--renderer", "vulkan"], ["--renderer", "embree", "opengl"]),
    (["--reward.train.optimizer", "lion"], ["--reward.train.optimizer", "adam", "sgd"]),
    (["--twin", "other"], ["--twin", "near", "far"]),
    (["--target", "camvid"], ["no option --target: the command chooses the target: use", "camvid",
                              "cityscapes without --data uses the twin"]),
    (["--stat", "random"], ["no option --stat; did you mean --start?"]),
])  # fmt: skip
def test_what_the_parser_refuses_has_exit_code_2(arguments, words, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        main_job("twin", *arguments)
    message = capsys.readouterr().err
    assert all(word in message for word in words) and message.count("\n") == 1
    assert "--target" not in arguments or "did you mean" not in message


@pytest.mark.parametrize("target", ["camvid", "labelmefacade"])
def test_a_target_takes_its_folder_from_the_variable(target, monkeypatch, error_line, tmp_path):
    variable = f"{target.upper()}_DIR"
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(variable, raising=False)
    assert main_job(target) == 2
    needed = f"{target} needs its folder: --data DIR (or the variable {variable})"
    assert error_line() == f"error: {needed}\n"
    monkeypatch.setenv(variable, "/no/such")
    assert main_job(target) == 2
    assert error_line().startswith("error: /no/such: no such folder")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("arguments", "default"), [
    ([], "quick"), (["--seed", "1", "--preset", "paper"], "paper"), (["--preset=smoke"], "smoke"),
])  # fmt: skip
def test_the_preset_decides_the_defaults(arguments, default):
    configs = []
    command("cityscapes", arguments, configs.append)
    (config,) = configs
    assert config.preset == default and str(config.out) == f"runs/cityscapes-{default}"
    assert config.final == defaults(MainConfig, "twin", default).final


@pytest.fixture
def called(monkeypatch):
    """Calls `sdr-jax cityscapes`; returns the configuration that it would work with."""

    def call(*arguments: str) -> MainConfig:
        configs = []
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", ["cityscapes", *arguments])
            patch.setattr("experiments.app.main_job.RUN", configs.append)
            with pytest.raises(SystemExit, match=r"^0$"):
                runpy.run_module("experiments.cityscapes", run_name="__main__")
        return configs[0]

    return call


@pytest.mark.parametrize("preset", PRESETS)
def test_data_give_cityscapes_defaults_and_none_the_twins(preset, called, cityscapes):
    data = ("--data", str(cityscapes))
    for flags, target in (
        (data, "cityscapes"),
        ((f"--data={cityscapes}",), "cityscapes"),
        ((), "twin"),
    ):
        config = called(*flags, "--preset", preset)
        expected = defaults(MainConfig, target, preset)
        assert config == replace(expected, data=config.data, out=config.out)
        assert config.target == target and (config.data is None) == (target == "twin")
    config = called("--preset", preset, "--reward.width", "96", *data)
    assert config.reward == replace(defaults(MainConfig, "cityscapes", preset).reward, width=96)


@pytest.mark.parametrize(("flags", "space"), [
    (("--twin", "far"), "extended"), (("--twin=far",), "extended"), (("--twin", "near"), "scenex"),
    (("--twin", "far", "--space", "scenex"), "scenex"),
    (("--twin", "near", "--space", "extended"), "extended"),
])  # fmt: skip
def test_a_far_twin_is_searched_in_the_extended_space_unless_told_otherwise(called, flags, space):
    config = called(*flags, "--preset", "smoke")
    assert config.space == space and config.groups[:6] == CITYSCAPES_GROUPS
    assert make_space(config).names == plan_of(config).subset == names(space)


def test_the_help_shows_the_defaults_that_hold(capsys, called, monkeypatch):
    for flags, target, width in ((), "twin", 128), (("--data", "DIR"), "cityscapes", 256):
        monkeypatch.setattr(sys, "argv", ["cityscapes", *flags, "--help-all"])
        with pytest.raises(SystemExit, match=r"^0$"):
            runpy.run_module("experiments.cityscapes", run_name="__main__")
        text = " ".join(capsys.readouterr().out.split())
        assert (
            f"those of --preset quick for {target}; add --preset and --data DIR to --help" in text
        )
        assert f"(default: {width})" in text.partition("--reward.width")[2][:300]


def test_a_folder_with_the_twins_sizes_is_not_continued_with_others(
    called, cityscapes, out, scored_by
):
    scored_by(never)
    old = replace(
        defaults(MainConfig, "twin", "quick"),
        target="cityscapes", data=cityscapes, out=out,
    )  # fmt: skip
    out.mkdir()
    write_json(out / "config.json", as_json({"engine": ENGINE, **asdict(old)}))
    flags = ("--data", str(cityscapes), "--out", str(out), "--workers", "0")
    with pytest.raises(
        UserError, match=r"a run with final.height = 64, not 128; restore that value"
    ):
        do(MAIN, called(*flags))
    assert [path.name for path in out.iterdir()] == ["config.json"]


def test_a_training_has_as_many_steps_as_checkpoints(error_line, out):
    flags = ("--target", "camvid", "--data", "none", "--out", str(out), "--reward.train.steps", "9")
    assert study("ablation", *flags, "--search.checkpoints", "10") == 2
    line = "error: --search.checkpoints 10 needs as many --reward.train.steps, not 9"
    assert error_line().startswith(line) and not out.exists()


@pytest.mark.parametrize(("arguments", "recipe", "steps"), [
    (["--final.train.net", "compact"], "compact", 1000),
    (["--final.train.net=fcn8s"], "scratch", 1000),
    (["--final.train.net", "fcn8s", "--final.train.weights", "w.npz"], "vgg-adam", 1000),
    (["--final.train.backbone", "tuned", "--final.train.steps", "7"], "lite0-tuned", 7),
    (["--final.train.steps", "7"], "lite0-frozen", 7),
    (["--preset", "smoke", "--final.train.net", "lite0"], "lite0-frozen", 20),
    (["--final.train.heads", "3", "--final.width", "64"], "lite0-heads", 1000),
])  # fmt: skip
def test_the_net_decides_how_it_is_trained(arguments, recipe, steps):
    configs = []
    command("camvid", arguments, configs.append)
    train, expected = configs[0].final.train, RECIPES[recipe]
    mirror = "smoke" not in arguments  # final networks of quick average
    same = {"net": train.net, "weights": train.weights, "average_mirror": mirror}
    assert train == replace(with_steps(expected, steps), **same)
    assert configs[0].reward.train.net == ("compact" if "smoke" in arguments else "lite0")


def test_workers_are_one_per_core_unless_set():
    assert cores() == MainConfig.workers == parsers.render().parse_args(["--out", "x"]).workers
