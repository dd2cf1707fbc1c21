"""A contact sheet: rendered images with their labels and depth below.

python -m scene.preview --out sheet.png                      # streets set by eye
python -m scene.preview --attributes random --renderer opengl --out sheet.png
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from scene.attributes import NAMES, default_unit
from scene.catalogue import AssetPool
from scene.classes import colorize
from scene.dataset import render_street
from scene.render import RENDERERS, Frame, RendererError, RenderSettings

RELAXATION = 0.15
"""Width of the interval around the default that each street is drawn from."""
FAR = 80.0
"""Metres at which the depth picture is black."""


def units(attributes: str, streets: int, seed: int) -> np.ndarray:
    """Attributes f32[streets, 23]: around the street set by eye, or anywhere."""
    spread = np.random.default_rng(seed).uniform(-0.5, 0.5, (streets, len(NAMES)))
    if attributes == "random":
        return (0.5 + spread).astype(np.float32)
    return np.clip(default_unit() + RELAXATION * spread, 0, 1).astype(np.float32)


def tile(frame: Frame) -> np.ndarray:
    """Image, label and depth of one frame, one below the other, u8[3 h, w, 3] RGB."""
    near = np.where(frame.depth > 0, 1 - np.clip(frame.depth / FAR, 0, 1), 0)
    depth = np.repeat((255 * near[..., None]).astype(np.uint8), 3, axis=2)
    return np.concatenate([frame.image, colorize(frame.label), depth])


def sheet(streets: list[list[Frame]]) -> np.ndarray:
    """One row of tiles per street, u8[h, w, 3] RGB."""
    return np.concatenate(
        [np.concatenate([tile(frame) for frame in shots], axis=1) for shots in streets]
    )


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m scene.preview",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument("--attributes", choices=("default", "random"), default="default")
    parser.add_argument("--renderer", choices=RENDERERS, default="embree")
    parser.add_argument("--streets", type=int, default=3)
    parser.add_argument("--shots", type=int, default=4, help="images per street")
    parser.add_argument("--size", default="320x240", help="WIDTHxHEIGHT of each image")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    try:
        width, height = (int(v) for v in options.size.split("x"))
    except ValueError:
        parser.error(f"--size must look like 320x240, not {options.size!r}")
    settings = RenderSettings(width, height, samples=2)
    try:
        frames = [
            render_street(
                unit, options.seed, k, options.shots, settings, options.renderer, AssetPool()
            )
            for k, unit in enumerate(units(options.attributes, options.streets, options.seed))
        ]
        _, data = cv2.imencode(".png", sheet(frames)[..., ::-1])
        options.out.write_bytes(data.tobytes())
    except (ValueError, OSError, RendererError) as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
