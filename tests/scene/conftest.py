"""Shared by the tests of the engine: streets, assets, rays, own assets, refusals."""

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st

from scene import AssetPool, Street, StreetParams, default_unit, sample_street, street_params
from scene.assets.families import FAMILIES
from scene.mesh.mesh import Mesh
from scene.render import Renderer, RendererError, RenderSettings, renderer
from scene.render.embree import api, rays
from scene.street.extras import Mix
from tests.conftest import refused as refused

SEEDS = st.integers(0, 2**32 - 1)
UNITS = SEEDS.map(lambda seed: np.random.default_rng(seed).random(23))
POOL = AssetPool(0, 4)
TINY = RenderSettings(width=48, height=32)
LINES_ALONE = dict.fromkeys(
    ("bend", "gradient", "junction_share", "parked_share", "queue_share", "open_share"), 0.0
)


def lines_alone(unit: np.ndarray) -> StreetParams:
    """The parameters of a straight, level street with nothing but its lines."""
    return street_params(unit)._replace(**LINES_ALONE)


DEFAULT = lines_alone(default_unit())


def street(params=DEFAULT, seed=0, shots=1, pool=POOL) -> Street:
    return sample_street(params, seed, shots, pool, Mix())


def units(n: int) -> np.ndarray:
    return np.random.default_rng(0).random((n, 23), dtype=np.float32)


def kinds(families) -> list[tuple[str, str]]:
    """Every (family, kind)."""
    return [(family, kind) for family in families for kind in FAMILIES[family].kinds]


def make(family: str, kind: str, seed: int):
    return FAMILIES[family].draw(np.random.default_rng(seed), kind)


def solid(mesh: Mesh) -> trimesh.Trimesh:
    """A mesh as a trimesh."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def mirror(point: tuple[float, float, float]) -> tuple[float, float, float]:
    """The point on the other side."""
    return point[0], -point[1], point[2]


def chosen(name: str) -> Renderer:
    """The renderer of a name, or a skip where it cannot start."""
    try:
        return renderer(name)
    except RendererError as error:
        pytest.skip(str(error))


def free(bvh, starts, directions, needed, columns, reach=np.inf) -> np.ndarray:
    """Which rays meet nothing: f32[n], 1 if so, 0 if not, -1 where not needed.

    All on the thread that asks. The wheel's own classes start a device of Embree for each mesh, with threads;
    once they are gone, one of the threads may go on spinning, and slow down all that the process does after.
    """
    order = rays.by_tiles(np.asarray(needed, np.uint8), columns, len(needed) // columns, 4, 2)
    unblocked = rays.free(bvh, np.float32(starts), np.float32(directions), order, reach)
    return np.where(np.asarray(needed, bool), unblocked, -1)


def hits(mesh: trimesh.Trimesh, starts: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Which rays meet the mesh: bool[n] of f[n, 3] each, or of one direction for all."""
    mesh_bvh = api.MeshBVH(np.float32(mesh.vertices), np.int32(mesh.faces))
    bvh = api.SceneBVH([mesh_bvh], np.zeros(1), np.eye(3, 4, dtype=np.float32)[None])
    return free(bvh, starts, directions, np.ones(len(starts)), len(starts)) == 0


def cast(origin, directions, corners) -> tuple[np.ndarray, np.ndarray]:
    """Distances f64[rays, triangles], infinite where a ray misses, and which pass close to an edge.

    Source: Moeller, Trumbore 1997.
    """
    a, b, c = (corners[:, k].astype(float) for k in range(3))
    across, from_a = np.cross(directions[:, None], c - a), origin - a
    volume, up = (across * (b - a)).sum(-1), np.cross(from_a, b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (across * from_a).sum(-1) / volume
        v = directions @ up.T / volume
        t = (up * (c - a)).sum(-1) / volume
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        edge = np.minimum(np.minimum(abs(u), abs(v)), abs(1 - u - v)) < 1e-3
    return np.where(hit, t, np.inf), edge & (t > 0)


@pytest.fixture
def refusal(capsys):
    """``refusal(main, *arguments)``: the one line of error of a command that ends with exit code 2."""

    def ask(main, *arguments) -> str:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as end:  # argparse
            code = end.code
        error = capsys.readouterr().err
        assert code == 2 and error.count("\n") == 1, error
        return error

    return ask


@pytest.fixture
def printed(capsys):
    """``printed(main, *arguments)``: the output of a command that ends with exit code 0."""

    def ask(main, *arguments) -> str:
        assert main([str(argument) for argument in arguments]) == 0
        return capsys.readouterr().out

    return ask


@pytest.fixture
def shelf(tmp_path):
    """``shelf(path, mesh_or_bytes, column=...)`` writes a file with its row; returns the folder."""
    folder = tmp_path / "own"
    rows: list[dict[str, str]] = []

    def put(name, content, **columns) -> str:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content) if isinstance(content, bytes) else content.export(path)
        row = {"file": name, "author": "A. Maker", "licence": "CC0-1.0", "source": "own work"}
        rows.append({**row, **columns})
        header = dict.fromkeys(key for row in rows for key in row)
        lines = [header, *([row.get(key, "") for key in header] for row in rows)]
        (folder / "assets.csv").write_text("".join(",".join(line) + "\n" for line in lines))
        return str(folder)

    return put
