"""``dataset.json``: the settings that determine a dataset, and its statistics."""

from __future__ import annotations

import platform
import zlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numpy as np

from common import files
from common.files import folder_digest
from common.folder import as_json
from common.labels.classes import OWN as OWN_ROW
from scene.assets import library
from scene.assets.catalogue import AssetPool
from scene.assets.own_class import OwnClass
from scene.classes import CLASS_NAMES, OWN, VOID
from scene.dataset.formats.labels import Labels, labels_of
from scene.dataset.formats.layout import Layout, layout
from scene.dataset.read import WORK
from scene.proposal import Streets, describe, shortest
from scene.render import RenderSettings
from scene.version import ENGINE, MAKERS

PACKAGES = ("sdr-jax", *MAKERS, "scipy", "trimesh", "pyrender")
ENCODINGS = {
    "depth": "u16, centimetres along the optical axis, 0 for the sky",
    "normals": "u8 RGB, 127.5 (n + 1); camera frame: x right, y up, z towards the camera; black: sky",
    "panoptic": "segment id = R + 256 G + 256^2 B; labelId * 1000 + k for things, else labelId",
}


class Plan(NamedTuple):
    """The plan of an export, for every worker."""

    folder: Path
    format: str
    split: str
    images: int
    shots: int
    seed: int
    settings: RenderSettings
    renderer: str
    pool: AssetPool
    target: dict[str, Any] | None = None  # entry of the labels' target in `dataset.json`

    @property
    def layout(self) -> Layout:
        """The layout of the files."""
        return layout(self.format)

    @property
    def labels(self) -> Labels:
        """The classes of label images."""
        own_class = self.pool.own_class
        description = {"target": self.target, "own_class": own_class and own_class._asdict()}
        return labels_of(description, self.layout.published)

    @property
    def work(self) -> Path:
        """The folder that exists during the export only."""
        return self.folder / WORK

    @property
    def own_folder(self) -> str:
        """The folder of own assets if they are used, else empty."""
        return "" if self.pool.use == "built-in" else self.pool.own

    def record(self, street: int) -> Path:
        """The file that marks a street as finished, with its outcome."""
        return self.work / "streets" / f"{street:06d}.json"

    def shots_of(self, street: int) -> int:
        """Number of images of one street; the last street may have fewer."""
        return min(self.shots, self.images - street * self.shots)


def settings(plan: Plan, units: np.ndarray, streets: Streets | None) -> dict[str, Any]:
    """All settings that determine the files, as in ``dataset.json``."""
    of_target = {} if plan.target is None else {"target": plan.target}
    of_own = (
        {} if plan.pool.own_class is None else {"own_class": own_class_entry(plan.pool.own_class)}
    )
    pool = {k: v for k, v in plan.pool.identity.items() if k not in of_own}
    render = {**plan.settings._asdict(), "response": plan.settings.response._asdict()}
    return {
        "engine": ENGINE,
        "versions": versions(layout(plan.format).packages),
        "format": plan.format,
        **of_target,
        **of_own,
        "split": plan.split,
        "images": plan.images,
        "shots": plan.shots,
        "seed": plan.seed,
        "renderer": plan.renderer,
        "render": as_json(render),
        "assets": {**pool, "own": Path(plan.pool.own).name},
        "own_assets": _own_assets(plan.own_folder),
        "own_files": own_files(plan.own_folder),
        "attributes": None if streets is None else _units(streets),
        "streets": [[shortest(value) for value in row] for row in units.tolist()],
    }


def _units(streets: Streets) -> dict[str, Any]:
    """Streets in the form for `scene.proposal.parse_streets`, without physical values."""
    rows = [
        {**row, "attributes": {name: entry["unit"] for name, entry in row["attributes"].items()}}
        for row in describe(streets)["components"]
    ]
    attributes: dict[str, Any] = rows[0]["attributes"]
    return {"components": rows} if len(rows) > 1 else attributes


def own_class_entry(own_class: OwnClass) -> dict[str, Any]:
    """The entry of a user's own class: its ids and colour in labels, and its asset."""
    file = Path(own_class.file)
    return {
        "name": own_class.name,
        "train_id": OWN,
        "label_id": OWN_ROW.file_id,
        "colour": list(OWN_ROW.colour),
        "place": own_class.place,
        "file": file.name,
        "sha256": folder_digest(file),
    }


def own_files(folder: str) -> str:
    """A digest of all files of the folder of own assets, with textures and manifest; empty without one."""
    return folder_digest(Path(folder)) if folder else ""


def _own_assets(folder: str) -> list[dict[str, Any]]:
    """The manifest's entry of every own asset with a checksum, since a file may be replaced."""
    rows = library.manifest(folder) if folder else ()
    return [
        {**row._asdict(), "crc32": zlib.crc32((Path(folder) / row.file).read_bytes())}
        for row in rows
    ]


def outcome(streets: Iterable[dict[str, Any]], pixels: int, labels: Labels) -> dict[str, Any]:
    """Statistics of a dataset: shares and image counts of classes, mean colour, objects, retaken shots.

    Args:
        streets: the records of all streets.
        pixels: pixels of one image.
        labels: the classes to count.
    """
    of_engine = labels.of_engine[: OWN + 1].tolist()
    count, images = np.zeros(VOID + 1, np.int64), 0
    containing, rgb = np.zeros(VOID + 1, np.int64), np.zeros(3, np.int64)
    retaken = refused = 0
    placed: Counter[str] = Counter()
    for street in streets:
        placed.update(street["placed"])
        for record in street["images"]:
            image_counts = np.bincount(of_engine, record["pixels"], minlength=VOID + 1).astype(
                np.int64
            )
            count += image_counts
            containing += image_counts > 0
            rgb += record["rgb"]
            retaken += record["retaken"] > 0
            refused += record["refused"]
            images += 1
    total = pixels * images
    return {
        "class_frequency": _by_class(labels, np.round(count / total, 9)),
        "images_with_class": _by_class(labels, containing),
        "mean_rgb": np.round(rgb / total, 3).tolist(),
        "shots_retaken": round(retaken / images, 6),
        "shots_refused": round(refused / images, 6),
        "placed": {name: placed[name] for name in (*CLASS_NAMES, *placed) if name in placed},
    }


def _by_class(labels: Labels, values: np.ndarray) -> dict[str, Any]:
    return dict(zip(labels.names, values.tolist(), strict=False))


def versions(more: tuple[str, ...] = ()) -> dict[str, str]:
    """Versions of all that affects the bytes, and the processor for which the shader is compiled."""
    cpu = llvmlite.binding.get_host_cpu_name()
    libraries = files.versions((*PACKAGES, *more))
    return {"python": platform.python_version(), "processor": cpu, **libraries}
