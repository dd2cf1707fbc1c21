"""Plans of larger jobs: what bounds them, worked out by hand."""

import pytest

from benchmarks.scale import Export, Reward, dataset_plan, search_plan


@pytest.mark.parametrize(("workers", "hours", "busy", "first"), [
    (1, 1000 / 3600, 1.0, "workers"),
    (8, 125 / 3600, 1.0, "workers"),
    (64, 50 / 3600, 0.3125, "main process (files)"),
])  # fmt: skip
def test_a_dataset_is_as_fast_as_its_slowest_part(workers, hours, busy, first):
    row = dataset_plan(1000, Export(1.0, 0.05, 1e6), workers)
    assert row == {"what": "1,000 images", "workers": workers, "hours": pytest.approx(hours),
                   "busy": pytest.approx(busy), "first": first}  # fmt: skip


@pytest.mark.parametrize(("datasets", "workers", "seconds", "first"), [
    (4, 2, 2 * (2 * 10 + 0.01) + 10.01, "workers"),
    (4, 8, 2 * (4 * 2 / 8 + 8.01) + (2 * 2 / 8 + 8.01), "updates, one after the other"),
    (1, 1, 10 * 10.01, "workers"),
])  # fmt: skip
def test_a_search_is_as_wide_as_its_updates(datasets, workers, seconds, first):
    # Ten rewards: the last update of four asks for two.
    row = search_plan(10, datasets, Reward(2.0, 8.0, 0.01), workers)
    assert row["hours"] == pytest.approx(seconds / 3600) and row["first"] == first
