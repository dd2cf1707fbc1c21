"""`experiments.fit`, `search` and `reward`: the commands as functions, with named results."""

import numpy as np
import pytest

import experiments
from common.errors import UserError
from common.files import write_json
from experiments.app import functions
from experiments.evaluation.job import Result
from scene.attributes import names
from scene.proposal import RELAXATION, default_proposal, describe

TINY = {"streets": 2, "width": 64, "height": 32, "train": {"steps": 2}}


def reward(streets="default", **options) -> experiments.Reward:
    small = {"reward_images": 2, "test_images": 2, "asset_count": 2}
    return experiments.reward(streets, preset="smoke", reward=TINY, **{**small, **options})


def test_a_reward_is_the_same_again_and_that_of_named_or_given_streets():
    named = reward()
    assert named == reward() == reward(default_proposal())
    assert 0 <= named.miou <= 1 and len(named.classes) == 19 and "road" in named.classes
    scored = [value for value in named.classes.values() if value is not None]
    assert named.miou == pytest.approx(np.mean(scored))


def test_a_reward_of_a_file_of_attributes(tmp_path):
    path = tmp_path / "attributes.json"
    write_json(path, describe(default_proposal()))
    assert reward(path) == reward()


def test_a_reward_is_that_of_a_search_with_its_labels_checkpoints_and_statistics(monkeypatch):
    evaluated = []

    def evaluate(recipe, source, seed, real):
        evaluated.append((recipe, source, len(real.images)))
        return Result(0.5, [None] * 19, 0.0, 0.0)

    monkeypatch.setattr(functions, "evaluate_miou", evaluate)
    reward(
        "random",
        few=1,
        few_share=0.25,
        search={"checkpoints": 2},
        fix=["field_of_view=90"],
        space="extended",
    )
    [(recipe, source, tested)] = evaluated
    assert (tested, recipe.checkpoints, recipe.statistics) == (1, 2, None)
    assert source.shares == (0.75, 0.25) and len(source.parts[1].images) == 1
    where = names("extended").index("field_of_view")
    assert source.parts[0].width[where] == 0 < np.delete(source.parts[0].width, where).min()
    train = TINY["train"] | {"net": "lite0", "head_statistics": "target"}
    small = {"reward_images": 2, "test_images": 2, "asset_count": 2}
    experiments.reward(preset="smoke", reward=TINY | {"train": train}, **small)
    mean, deviation = evaluated[1][0].statistics
    reward()
    assert evaluated[2][1].width.max() == np.float32(RELAXATION)
    assert mean.shape == deviation.shape and np.isfinite(mean).all() and (deviation > 0).all()


@pytest.mark.parametrize(("options", "words"), [
    ({"streets": "no such file"}, "streets: "),
    ({"target": "kitti"}, "target must be one of twin, cityscapes, camvid, labelmefacade"),
    ({"reward_image": 3}, "no option reward_image; did you mean reward_images"),
    ({"twin_seed": 1, "target": "camvid"}, "--twin-seed is for --target twin"),
    ({"target": "cityscapes"}, "target 'cityscapes' needs its folder, data="),
    ({"target": "twin", "data": "streets"}, "target 'twin' takes no data"),
    ({"reward": {"streets": 0}}, "--reward.streets must be 1 or more, not 0"),
    ({"reward": {"width": 33}}, "--reward.width and --reward.height must be multiples of 8"),
    ({"reward": {"train": {"steps": 0}}}, "--reward.train.steps must be 1 or more"),
])  # fmt: skip
def test_what_cannot_be_used_is_named(options, words):
    with pytest.raises(UserError, match=words):
        experiments.reward(options.pop("streets", "default"), preset="smoke", **options)
