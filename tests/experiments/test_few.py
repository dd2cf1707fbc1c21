"""A few labelled images beside every training set: which, what is trained on them, and what they are not."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.files import read_json
from experiments.app.report import summary
from experiments.evaluation import in_worker
from experiments.evaluation.cache import FOLDER
from experiments.evaluation.job import Job, LabelledSubset
from experiments.tables.row_names import FEW_ROWS
from experiments.targets.few import spread
from experiments.targets.named import named_target
from scene.proposal import default_proposal, random_proposal
from seg.data import LabelledImages
from seg.mixing import TrainingSet

from .conftest import POOL, Counted, lines, main_job, never, runner_of
from .test_cache import REAL, RECIPE, TARGET, TEST
from .test_target import flat


@given(st.lists(st.integers(1, 30), min_size=1, max_size=5), st.integers(0, 99), st.data())
def test_the_few_are_spread_over_sequences_and_their_time(sizes, seed, data):
    names = [f"{n:04d}" for size in sizes for n in range(size)]
    sequences = [f"s{k}" for k, size in enumerate(sizes) for _ in range(size)]
    count = data.draw(st.integers(0, len(names)))
    order = np.random.default_rng(seed).permutation(len(names))  # files in any order
    shuffled = [names[k] for k in order], [sequences[k] for k in order]
    chosen = spread(*shuffled, count, seed)
    assert len(set(chosen.tolist())) == count and list(chosen) == sorted(chosen)
    np.testing.assert_array_equal(chosen, spread(*shuffled, count, seed))
    of = Counter(shuffled[1][k] for k in chosen)
    most = max(of.values(), default=0)
    for k, size in enumerate(sizes):  # none has less than another that is not used up
        assert of[f"s{k}"] >= min(size, most - 1)
        times = sorted(int(shuffled[0][i]) for i in chosen if shuffled[1][i] == f"s{k}")
        assert all(abs(step - size / len(times)) < 1 for step in np.diff(times))


def test_the_few_give_no_reward(tiny_camvid):
    all_images = named_target(tiny_camvid, POOL)
    target = named_target(replace(tiny_camvid, few=2), POOL)
    assert [name[0] for name in target.few_names] == ["A", "B"]
    assert sorted(target.reward_names + target.few_names) == sorted(all_images.reward_names)
    assert "2 of the 4 (A 1, B 1) are mixed with every training set" in target.title
    split, all_ = target.at(12, 16), all_images.at(12, 16)["reward"]
    for part, names in ((split["reward"], target.reward_names), (split["few"], target.few_names)):
        assert part.names == names
        for name, image, label in zip(names, part.images, part.labels, strict=True):
            k = all_.names.index(name)
            assert np.array_equal(image, all_.images[k]) and np.array_equal(label, all_.labels[k])
    assert split["labelled"].names == all_.names and split["test"].names == target.test_names
    subsets = {
        named_target(replace(tiny_camvid, few=0.5, seed=s), POOL).few_names for s in range(9)
    }
    assert subsets == {target.few_names}  # runs of all seeds share them


@pytest.mark.parametrize(("flags", "words"), [
    (("--few", "9"), "--few 9 is more than the 4 labelled images of camvid; 3 leave one"),
    (("--few", "4"), "--few 4 selects all 4 labelled images of camvid, which leaves none"),
    (("--few", "1.0"), "--few 1.0 selects all 4 labelled images"),
    (("--few", "0.1"), "--few 0.1 selects none of the 4 labelled images of camvid; 0.25 or more"),
    (("--few", "0"), "--few must be a number of images, 1 or more, or a share in (0, 1], not 0"),
    (("--few", "1.5"), "--few must be a number of images, 1 or more, or a share in (0, 1], not 1.5"),
    (("--few", "nan"), "a share in (0, 1], not nan"),
    (("--few", "2", "--few-share", "0"), "--few-share must lie in (0, 1), not 0"),
    (("--few", "2", "--few-share", "0.01"), "0.01 takes none of the 48 images of --reward.train.steps 12"),
    (("--few", "2", "--few-share", "0.995"), "takes all of the 48 images"),
])  # fmt: skip
def test_bad_input_is_one_line(flags, words, camvid, out, error_line):
    assert main_job("camvid", "--data", str(camvid), "--out", str(out), *flags) == 2
    assert words in error_line() and not out.exists()


@pytest.mark.parametrize(("few", "sequence", "words"), [
    (2, "A", "--few 2: the 1 images chosen of sequence A show none of the 11 classes of camvid"),
    (3, "AB", "no pixel of the training images has a class"),
])  # fmt: skip
def test_a_sequence_without_classes_is_refused(few, sequence, words, camvid, out, error_line):
    for path in camvid.glob(f"trainannot/[{sequence}]_*.png"):
        flat(11)(path)
    assert main_job("camvid", "--data", str(camvid), "--out", str(out), "--few", str(few)) == 2
    assert words in error_line(begun=True) and not out.exists()


@pytest.mark.parametrize("ignored", [True, False])
def test_images_left_for_the_search_must_show_a_class(ignored, tiny_camvid, out, error_line):
    """Otherwise networks would be scored on no labelled pixel."""
    few = named_target(replace(tiny_camvid, few=2), POOL).few_names
    (*paths,) = (p for p in tiny_camvid.data.glob("trainannot/*.png") if p.stem not in few)
    assert len(paths) == 2
    for path in paths[not ignored :]:  # one of the two is enough
        flat(11)(path)
    flags = ("--data", str(tiny_camvid.data), "--out", str(out), "--few", "2")
    if not ignored:
        named_target(replace(tiny_camvid, few=2), POOL).at(12, 16)
        return
    assert main_job("camvid", *flags) == 2
    message = "--few 2: the 2 images left for the search show none of the 11 classes of camvid"
    assert message in error_line(begun=True) and not out.exists()


def test_an_evaluation_is_named_by_its_few(tmp_path):
    runner = runner_of(TARGET, tmp_path)
    few, other = LabelledSubset(REAL, (1, 2)), LabelledSubset(REAL, (1, 3))
    streets, default = random_proposal(), default_proposal()

    def mixed(rendered, few, share=0.5):
        return TrainingSet((rendered, few), (1 - share, share))

    def keys_of(*sources):
        return [runner.key(Job(RECIPE, source, 1, {})) for source in sources]

    sources = [streets, few, mixed(streets, few), mixed(streets, other), mixed(streets, few, 0.3)]
    keys = keys_of(*sources, mixed(default, few))
    assert len(set(keys)) == len(keys)
    again = REAL.take([1, 2])
    assert keys_of(again, mixed(streets, again)) == keys[1:3]
    records = [runner.about(Job(RECIPE, source, 1, {})) for source in sources]
    assert len({record["config"] for record in records}) == 4  # none, two sets, two shares
    assert records[2]["few"] == 2 and "few" not in records[1]


def test_nets_share_files_and_renders_and_are_those_of_arrays(tmp_path, monkeypatch):
    few = [LabelledSubset(REAL, indices) for indices in ((3, 17, 24), (5, 6, 7))]
    streets = default_proposal()
    sources = [*(TrainingSet((streets, subset), (0.5, 0.5)) for subset in few), streets]
    arrays = [
        *(TrainingSet((streets, REAL.take(subset.indices)), (0.5, 0.5)) for subset in few),
        streets,
    ]
    rewards = []
    for source in arrays:
        in_worker._LAST_SET.clear()
        rewards.append(in_worker.evaluate_miou(RECIPE, source, 5, TEST).reward)
    assert len(set(rewards)) == 3
    in_worker._LAST_SET.clear()
    rendered = Counted(in_worker.render)
    monkeypatch.setattr(in_worker, "render", rendered)
    results = runner_of(TARGET, tmp_path / "run").run([Job(RECIPE, s, 5, {}) for s in sources])
    assert [results[k].reward for k in range(3)] == rewards and len(rendered.calls) == 1
    # Images and features of those tested on, and of all that the few were chosen from.
    assert len(list((tmp_path / "run" / FOLDER).iterdir())) == 4
    monkeypatch.setattr(in_worker, "render", never)
    in_worker.evaluate_miou(RECIPE, arrays[1], 5, TEST)
    with pytest.raises(AssertionError, match="known"):
        in_worker.evaluate_miou(RECIPE, arrays[1], 6, TEST)


def test_a_job_searches_beside_the_few_and_tells_their_worth(camvid, out, counted, monkeypatch):
    flags = ("--few", "2", "--few-share", "0.4", "--data", str(camvid))
    assert main_job("camvid", "--out", str(out), *flags) == 0
    sources = [source for _, source, *_ in counted.calls]
    assert all(
        isinstance(source, TrainingSet) and source.shares[1] == 0.4 for source in sources[:12]
    )
    sizes = [
        len(s.images) if isinstance(s, LabelledImages) else isinstance(s, TrainingSet)
        for s in sources[12:]
    ]
    # What is rendered takes longer, and begins first.
    assert sizes == [*[False, False, False, True, True, True] * 2, 2, 4, 2, 4]
    assert [len(task[3].images) for task in counted.calls[:12]] == [2] * 12
    report = read_json(out / "summary.json")
    assert list(report["rows"]) == ["random", "default", "learnt", *FEW_ROWS, "real"]
    assert len(report["few_images"]) == 2 and report["few_share"] == 0.4
    optimised, labels_alone = (report["rows"][row]["miou"] for row in ("few+learnt", "few"))
    gain = report["gains"]["few+learnt"]["few"]["mean"]
    assert gain == pytest.approx(np.subtract(optimised, labels_alone).mean()) and gain != 0
    printed = summary.text(report)
    gained = f"| 2 labelled images + optimised streets over 2 labelled images alone | {gain:+.1f} |"
    assert gained in printed
    assert (
        "all 4 labelled images" in printed and "all 4 labelled" in (out / "report.html").read_text()
    )
    configs = {line["config"] for line in lines(out / "evaluations.jsonl")}
    assert len(configs) == 1 and lines(out / "evaluations.jsonl")[0]["few"] == 2
    # The dataset's note says how to train on both, and what it says runs.
    note = (out / "dataset" / "few.md").read_text()
    assert "together with 2 labelled images" in note and "40 % of every batch" in note
    (code,) = re.findall(r"```python\n(.*?)```", note, flags=re.DOTALL)
    monkeypatch.chdir(out)
    scope: dict = {}
    exec(compile(code, "few.md", "exec"), scope)
    assert list(scope["real"].names) == report["few_images"]
    assert len(scope["renders"].images) == 6 and "params" in scope
