"""The twin: a stand-in for real data where there is none.

Our engine renders it with hidden attribute values drawn from a known prior, with assets that the search may
not use, and through another camera. Its optimum is known. It is not real data, and its results do not carry
over to real data.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from common.labels.target_file import shipped
from common.workers.pool import Workers
from experiments.config import TwinName
from scene.assets.catalogue import AssetPool
from scene.attributes import NAMES, SPACES, default_unit
from scene.dataset.render import render_dataset
from scene.proposal import slide
from scene.render import RenderSettings
from scene.render.sensor import CameraResponse
from seg.classes import class_table, table_text
from seg.data import LabelledImages

PRIOR_STD = 0.12
"""Near: hidden centres are normal around the default street, with this standard deviation (unit)."""
FAR = (0.1, 0.9)
"""Far: hidden centres are uniform in this range (unit), independent of the default street."""
FAR_CAMERA = {"camera_position_y": (1.0, 2.5), "camera_rotation_x": (-8.0, 8.0)}
"""Far: ranges of these attributes (m, deg), narrow enough that the camera sees a street."""
HIDDEN_WIDTH = 0.15
"""Streets of the twin are uniform on an interval of this width around the hidden centre."""
FIRST_ASSET = 100_000
"""The first asset of the twin; the search may only use earlier ones."""
ASSETS = 48
"""Assets of each family in the twin, unless the search has fewer."""
SHOTS: dict[TwinName, int] = {"near": 6, "far": 1}
"""Images per street, which is a sequence. With fewer images, networks generalise better to other streets."""
IMAGES = 120
"""The most images in each of its two splits."""
TABLE = table_text(msgspec.structs.replace(shipped("cityscapes"), outlines={}))
"""Cityscapes' classes for `class_table`, without its outlines: labels of a twin are exact to the pixel."""


class TwinWorld(NamedTuple):
    """The hidden attributes and camera."""

    centre: np.ndarray  # f32[attributes of scenex or extended] unit
    width: np.ndarray  # f32[attributes]
    response: CameraResponse
    seed: int
    shots: int  # images per street


def twin_world(twin_seed: int, twin: TwinName = "near") -> TwinWorld:
    """Draw a twin.

    Near: each of the paper's 23 centres is the default's unit value plus N(0, 0.12), kept inside [0.08,
    0.92]. Far: each centre of the extended space is uniform in `FAR`, or in `FAR_CAMERA`; an interval that
    sticks out of [0, 1] is moved inside. The camera of both has a white balance that is off by up to 8 %, a
    gamma that is off by up to 12 %, a lens that blurs by 0.3-0.7 pixels, and twice the engine's noise.

    Args:
        twin_seed: seed of the twin; near and far twins with one seed have nothing in common.
        twin: near or far.
    """
    # Another first word, since a third word would collide with the second half of a long seed.
    rng = np.random.default_rng([2006 if twin == "near" else 2007, twin_seed])
    if twin == "near":
        sample = default_unit() + rng.normal(0, PRIOR_STD, len(NAMES))
        centre = np.clip(sample, 0.08, 0.92).astype(np.float32)
    else:
        centre = slide(rng.uniform(*_far_ranges()), HIDDEN_WIDTH).centre
    response = CameraResponse(
        exposure=float(rng.uniform(0.85, 1.15)),
        gain=tuple(rng.uniform(0.92, 1.08, 3).tolist()),
        gamma=float(rng.uniform(0.94, 1.12)),
        blur=float(rng.uniform(0.3, 0.7)),
        noise=0.012,
        variation=0.0,  # one camera takes all images
    )
    return TwinWorld(
        centre,
        np.full(len(centre), HIDDEN_WIDTH, np.float32),
        response,
        int(rng.integers(2**31)),
        SHOTS[twin],
    )


def _far_ranges() -> np.ndarray:
    """Return the lowest and highest centres of a far twin, f64[2, attributes of extended] unit."""
    rows = []
    for attribute in SPACES["extended"]:
        bounds = FAR_CAMERA.get(attribute.name)
        rows.append(FAR if bounds is None else [attribute.to_unit(value) for value in bounds])
    return np.array(rows).T


def twin_names(split: str, images: int | None, shots: int) -> tuple[tuple[str, str], ...]:
    """List (name, sequence) of every image of a split, without rendering; a sequence has ``shots`` images."""
    count = min(images or IMAGES, IMAGES)
    sequences = [f"twin-{split}-{k // shots:03d}" for k in range(count)]
    return tuple((f"{s}_{k % shots}", s) for k, s in enumerate(sequences))


def twin_split(
    world: TwinWorld,
    split: str,
    size: tuple[int, int],
    *,
    images: int | None,
    renderer: str,
    workers: Workers,
    assets: int = ASSETS,
) -> LabelledImages:
    """Render the split ``train`` (for the search) or ``test`` at ``size`` (height, width).

    It shows ``assets`` assets of every family, none of which the search may use. Streets of the two splits
    are drawn separately, so that no sequence is in both. The same world, split and size give the same images.
    """
    names, sequences = zip(*twin_names(split, images, world.shots), strict=True)
    count, streets = len(names), len(set(sequences))
    number = ("train", "test").index(split)
    rng = np.random.default_rng([world.seed, number])
    unit = world.centre + world.width * rng.uniform(-0.5, 0.5, (streets, len(world.centre)))
    dataset = render_dataset(
        np.clip(unit, 0, 1),
        world.seed + 1 + number,
        shots=world.shots,
        settings=RenderSettings(size[1], size[0], samples=2, response=world.response),
        renderer_name=renderer,
        pool=AssetPool(FIRST_ASSET, assets),
        workers=workers,
    )
    labels = class_table(TABLE).from_train_id[dataset.labels[:count]]
    return LabelledImages(dataset.images[:count], labels, names, sequences)
