"""What the report of many searches says of methods, with model selection and without."""

from experiments.searches import derive, text


def nets(*scores):
    return [{"miou": score, "class_iou": []} for score in scores]


BASELINES = {
    "random": nets(30.0, 32.0), "default": nets(34.0, 36.0), "real": nets(40.0, 40.0),
}  # fmt: skip


def search(seed, chosen, own, **more):
    found = {
        "method": "sdr",
        "seed": seed,
        "chosen_candidate": chosen,
        "rewards": [20.0, 30.0, 40.0],
    }
    return {**found, "nets": own, **more}


def report(*searches):
    about = {"note": "some", "scored_at": "480x360", "test_images": 1, "seeds": 2, "starts": {}}
    budget = {"evaluations": 3, "rewards_at": "240x176", "space": "scenex"}
    return derive({**about, **budget, "baselines": BASELINES, "searches": list(searches)})


def test_a_method_has_a_row_with_model_selection_and_one_without():
    found = report(
        search(0, "default", nets(34.0, 36.0), own_nets=nets(31.0, 31.0)),
        search(1, "half", nets(36.0, 38.0), own_nets=nets(33.0, 35.0)),
    )
    rows = {(row["name"], row["judged"]): row for row in found["rows"]}
    assert rows["sdr", True]["mean"] == 36.0
    assert rows["sdr", True]["gain_over_default"]["mean"] == 1.0
    assert rows["sdr", False]["mean"] == 32.5
    assert rows["sdr", False]["gain_over_default"]["mean"] == -2.5
    assert [each["own_answer"] for each in found["searches"]] == [31.0, 34.0]
    page = text(found)
    assert "learnt by sdr, without model selection | 2 | 32.5" in page
    assert "Answers that are hand-set: 1 of 2 of sdr." in page


def test_reports_from_before_own_answers_had_nets_are_read():
    found = report(search(0, "half", nets(36.0, 38.0)))
    assert [row["judged"] for row in found["rows"]] == [True] * 4
    page = text(found)
    assert "without model selection" not in page and "that are hand-set" not in page
