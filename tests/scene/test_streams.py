"""No two random streams of a street are equal, and all are made in one place."""

import ast
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from scene.assets.catalogue import AssetPool
from scene.attributes import default_unit, street_params
from scene.render import RenderSettings, renderer
from scene.street.extras import Mix
from scene.street.street import sample_street

SCENE = Path(__file__).resolve().parents[2] / "scene"
HELPER, ASSETS = SCENE / "streams.py", SCENE / "assets"
SHOTS = 64
ALL = Mix(*[1.0] * len(Mix._fields))
FULL = dict.fromkeys(("junction_share", "parked_share", "queue_share"), 1.0)


@pytest.mark.parametrize("open_share", (0.0, 1.0))
def test_all_streams_of_a_street_of_many_shots_differ(monkeypatch, open_share):
    default_rng = np.random.default_rng
    places = defaultdict(list)  # state -> lines of code that asked for it

    def recorded(seed):
        frame = sys._getframe(1)
        while Path(frame.f_code.co_filename) == HELPER:
            frame = frame.f_back
        rng = default_rng(seed)
        name = Path(frame.f_code.co_filename)
        if name.is_relative_to(SCENE) and not name.is_relative_to(ASSETS):
            key = f"{name.relative_to(SCENE)}:{frame.f_lineno}"
            places[rng.bit_generator.state["state"]["state"]].append(key)
        return rng

    monkeypatch.setattr(np.random, "default_rng", recorded)
    params = street_params(default_unit("extended"))._replace(**FULL, open_share=open_share)
    street = sample_street(params, 3, SHOTS, AssetPool(0, 1), ALL)
    renderer("embree").render(street, RenderSettings(32, 16))
    assert [set(lines) for lines in places.values() if len(set(lines)) > 1] == []
    counts = defaultdict(list)
    for lines in places.values():
        counts[lines[0].split(":")[0]].append(len(lines))
    shot = sorted(counts["render/shot.py"])
    assert shot == [1] * SHOTS + [SHOTS]  # the noise of each shot; the one camera
    assert len(counts["street/extras.py"]) > 20 and len(counts["street/lines.py"]) >= 12


@pytest.mark.parametrize("path", sorted(SCENE.rglob("*.py")), ids=lambda p: p.stem)
def test_streams_are_made_in_one_place(path):
    """Except those of assets, whose seeds are their parameters."""
    uses = [
        node.lineno
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute | ast.Name)
        and "default_rng" in ast.unparse(node).split(".")
    ]
    assert not uses or path == HELPER or path.is_relative_to(ASSETS)
