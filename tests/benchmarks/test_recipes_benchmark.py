"""What a change to a recipe is worth; nets that are the same are trained once."""

import pytest

from benchmarks import recipes


def rows(*values):
    return [dict(zip(recipes.ROWS, (v / 100 for v in own), strict=True)) for own in values]


def test_worth_by_hand():
    scores = {"recipe": rows((30, 40, 50), (32, 40, 50)), "other": rows((31, 43, 50), (35, 41, 50))}
    base, other = recipes.worth(scores)
    assert base["random"] == pytest.approx(31) and base["random_worth"] is None
    assert (base["gain"], other["gain"]) == (pytest.approx(9), pytest.approx(9))
    assert other["random_worth"] == other["default_worth"] == pytest.approx(2)
    assert other["random_error"] == pytest.approx(1)  # of 1 and 3
    assert recipes.worth({"recipe": rows((1, 2, 3)), "b": rows((1, 2, 3))})[1]["real_error"] is None


def test_changes_that_change_nothing_are_trained_once(tmp_path, monkeypatch, capsys):
    seen = []

    def score_rows(data, own, settings, seed):
        seen.append((settings.mirror, settings.colour, seed))
        return rows((1, 2, 3))[0], 0.0

    monkeypatch.setattr(recipes, "score_rows", score_rows)
    base = recipes.RECIPE["compact"]
    changes = {"same": {"lr": base.lr}, "b": {"mirror": False}}
    monkeypatch.setitem(recipes.VARIANTS, "compact", changes)
    flags = ["--data", ".", "--out", str(tmp_path), "--net", "compact", "--workers", "0"]
    assert recipes.main([*flags, "--seeds", "2"]) == recipes.main([*flags, "--seeds", "2"]) == 0
    assert seen == [(True, True, 0), (False, True, 0), (True, True, 1), (False, True, 1)]
    for wrong in (["--seeds", "0"], ["--workers", "-1"], ["--only", "no such"]):
        with pytest.raises(SystemExit, match=r"^2$"):
            recipes.main([*flags, *wrong])
        assert wrong[0] in capsys.readouterr().err
