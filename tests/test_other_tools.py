"""Examples for other tools run as they stand on the page, where a tool is there; so does the own net."""

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from common.labels.target_file import shipped
from scene import CLASS_NAMES, AssetPool, RenderSettings, export_dataset
from scene.dataset.export import read_dataset
from scene.proposal import draw, parse_streets, random_proposal
from tests.conftest import ROOT
from tests.test_docs import FENCE

PAGE = "".join(
    (ROOT / page).read_text(encoding="utf-8") for page in ("docs/howto/other_tools.md", "README.md")
)
POOL = AssetPool(0, 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the exports that the page makes, but small."""
    folder = tmp_path_factory.mktemp("tools")
    units, options = draw(random_proposal(), 1, 3), {"shots": 1, "pool": POOL}
    export_dataset(
        units, 1, folder / "streets", settings=RenderSettings(64, 48), format="folders", **options
    )
    return folder


def example(line: str) -> str:
    """The one block of the pages with such a line."""
    [block] = [text for _, text in FENCE.findall(PAGE) if line in text]
    return block


def ran(line: str) -> dict:
    scope: dict = {"__name__": "page"}
    exec(compile(example(line), line, "exec"), scope)
    return scope


def test_the_pytorch_dataset(folder, monkeypatch):
    pytest.importorskip("torch", reason="needs PyTorch")
    monkeypatch.chdir(folder)
    found, wanted = ran("class Streets(torch.utils.data.Dataset)"), read_dataset(folder / "streets")
    assert found["images"].shape == (2, 3, 48, 64) and found["labels"].shape == (2, 48, 64)
    np.testing.assert_array_equal(found["labels"].numpy(), wanted.labels[:2])


@pytest.mark.parametrize(
    "line", ["class Endless(", "class Streets(torch.utils.data.IterableDataset)"]
)
def test_the_pytorch_stream(line):
    pytest.importorskip("torch", reason="needs PyTorch")
    found = ran(line)
    labels = found["labels"]
    assert found["images"].shape == (2, 3, 80, 160) and labels.shape == (2, 80, 160)
    assert labels[labels != 255].max() < 19


def test_datasets_loads_the_parquet_files(folder, monkeypatch, tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra parquet")
    datasets = pytest.importorskip("datasets", reason="needs the package datasets")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path)
    export_dataset(
        draw(random_proposal(), 1, 2), 1, folder / "streets-parquet", shots=1, pool=POOL,
        settings=RenderSettings(64, 48), format="parquet",
    )  # fmt: skip
    found = ran("from datasets import")
    assert found["names"] == list(CLASS_NAMES) and len(found["streets"]) == 2
    assert found["streets"][0]["image"].size == (64, 48)


@pytest.fixture(scope="module")
def of_target(folder):
    """The same streets with masks in colours of a target, in a folder of the name that the page has."""
    units, options = draw(random_proposal(), 1, 3), {"shots": 1, "pool": POOL}
    export_dataset(
        units, 1, folder / "colours" / "streets", settings=RenderSettings(64, 48), format="folders",
        target="labelmefacade", **options,
    )  # fmt: skip
    return folder / "colours"


@pytest.mark.parametrize("colours", [False, True])
def test_the_data_of_mmsegmentation_are_files_of_indices(colours, folder, of_target, monkeypatch):
    """Rules: mmseg's ``BaseSegDataset``: both suffixes exchanged, below ``data_root`` and ``data_prefix``."""
    folder = of_target if colours else folder
    monkeypatch.chdir(folder)
    ran('root / "indices"')
    scope = {"names": ran('root / "indices"')["names"]}
    exec(example("BaseSegDataset"), scope)
    data = scope["train_dataloader"]["dataset"]
    target = shipped("labelmefacade")
    wanted = target.class_names if colours else CLASS_NAMES
    assert data["metainfo"]["classes"] == list(wanted)
    root, prefix = folder / data["data_root"], data["data_prefix"]
    shown = [
        np.array(Image.open(path)) for path in sorted((root / prefix["seg_map_path"]).iterdir())
    ]
    np.testing.assert_array_equal(shown, read_dataset(folder / "streets").labels)
    images = sorted((root / prefix["img_path"]).glob(f"*{data['img_suffix']}"))
    stems = [path.name.removesuffix(data["img_suffix"]) for path in images]
    assert len(stems) == 3
    for stem in stems:
        assert (root / prefix["seg_map_path"] / f"{stem}{data['seg_map_suffix']}").exists()


@pytest.mark.parametrize("colours", [False, True])
def test_fiftyone_gets_a_name_for_each_value_of_the_masks(colours, folder, of_target, monkeypatch):
    streets = SimpleNamespace()
    fiftyone = SimpleNamespace(
        Dataset=SimpleNamespace(from_dir=lambda **_: streets),
        types=SimpleNamespace(ImageSegmentationDirectory=None),
        launch_app=lambda _: None,
    )
    monkeypatch.setitem(sys.modules, "fiftyone", fiftyone)
    monkeypatch.chdir(of_target if colours else folder)
    ran("import fiftyone")
    if not colours:
        names = dict(enumerate(CLASS_NAMES))
        assert streets.default_mask_targets == {**names, 255: "void"}
        return
    wanted = {
        "#" + bytes(kind.colours[0]).hex(): name
        for name, kind in shipped("labelmefacade").classes.items()
    }
    assert wanted.items() <= streets.default_mask_targets.items()
    pixels = np.concatenate(
        [np.array(Image.open(p)).reshape(-1, 3) for p in Path("streets/masks").iterdir()]
    )
    values = {"#" + bytes(value).hex() for value in np.unique(pixels, axis=0)}
    assert values <= {*streets.default_mask_targets}


@pytest.fixture
def own_net(monkeypatch):
    """The names of ``examples/own_net/search.py``."""
    monkeypatch.setattr(sys, "argv", ["search.py"])
    return runpy.run_path(str(ROOT / "examples/own_net/search.py"), run_name="own_net")


@pytest.mark.parametrize("net", ["colours", "torch_net"])
def test_a_search_for_ones_own_net_learns_from_its_scores_and_goes_on(
    net, own_net, folder, tmp_path, capsys
):
    if net == "torch_net":
        pytest.importorskip("torch", reason="needs PyTorch")
    score = runpy.run_path(str(ROOT / f"examples/own_net/{net}.py"))["score"]
    score.__globals__["STEPS"] = 5  # of the net's training
    real = own_net["read_real"](folder / "streets", (48, 32))
    assert real[0].shape == (3, 32, 48, 3) and real[1].shape == (3, 32, 48)
    told = []

    def counted(*data):
        told.append(score(*data))
        return told[-1]

    options = {"at_once": 2, "streets": 2, "pool": POOL}
    first = own_net["search"](counted, real, tmp_path, evaluations=2, **options)
    assert len(told) == 2 and all(0 < value < 1 for value in told) and told[0] != told[1]
    again = own_net["search"](counted, real, tmp_path, evaluations=2, **options)
    assert len(told) == 2 and np.array_equal(first.centre, again.centre)
    own_net["search"](counted, real, tmp_path, evaluations=4, **options)
    assert len(told) == 4 and "4 of 4: " in capsys.readouterr().out
    parse_streets(json.loads((tmp_path / "attributes.json").read_text()))


def test_a_toy_scores_labels_that_fit_above_labels_that_do_not(folder):
    score = runpy.run_path(str(ROOT / "examples/own_net/colours.py"))["score"]
    images, labels = read_dataset(folder / "streets")
    assert score(images, labels, images, labels) > score(images, labels[::-1], images, labels)
