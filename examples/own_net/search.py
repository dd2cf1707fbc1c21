"""A search whose reward is your own network: any function from images and labels to a score.

    python examples/own_net/search.py examples/own_net/colours.py --real DIR --out runs/own
    python examples/own_net/search.py examples/own_net/torch_net.py --real DIR --out runs/own

The file defines `score(images, labels, real_images, real_labels)`, which trains on the first two and tests on
the last two; higher is better. DIR has real images in the layout of `sdr-jax render --format folders`:
images/ and masks/.
"""

import argparse
import json
import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

import scene
import sdr_jax
from scene import Proposal, describe

Score = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], float]


def read_real(folder: Path, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Read images u8[n, h, w, 3] and masks u8[n, h, w], whose values are classes; 255 is ignored."""
    masks = sorted((folder / "masks").glob("*.png"))
    if not masks:
        raise FileNotFoundError(f"{folder} has no masks/*.png")
    images, labels = [], []
    for mask in masks:
        image = next((folder / "images").glob(f"{mask.stem}.*"), None)
        if image is None:
            raise FileNotFoundError(f"{folder / 'images'} has no image named {mask.stem}")
        images.append(np.array(Image.open(image).convert("RGB").resize(size)))
        labels.append(np.array(Image.open(mask).resize(size, Image.Resampling.NEAREST)))
    return np.stack(images), np.stack(labels)


def search(
    score: Score,
    real: tuple[np.ndarray, np.ndarray],
    out: Path,
    *,
    evaluations: int = 64,
    at_once: int = 8,
    streets: int = 16,
    workers: int = 0,
    pool: scene.AssetPool | None = None,
) -> Proposal:
    """Find the attributes whose renders train the best network; a stopped search resumes."""
    size = real[0].shape[2], real[0].shape[1]
    space = sdr_jax.space([attribute.name for attribute in scene.ATTRIBUTES], bins=10)
    method = sdr_jax.surrogate(space)
    out.mkdir(parents=True, exist_ok=True)
    optimiser = sdr_jax.AskTell(space, method, n=at_once, seed=0, path=out / "history.jsonl")
    while optimiser.updates < evaluations // at_once:
        for trial in optimiser.ask():
            rendered = scene.stream(
                Proposal(*trial.proposal), trial.seed, size=size, images=streets, workers=workers, pool=pool
            )  # fmt: skip
            images, labels, _ = map(np.stack, zip(*rendered, strict=True))
            value = score(images, labels, *real)
            optimiser.tell(trial.id, value)
            print(f"{trial.id + 1} of {evaluations}: {value:.4f}", flush=True)
    answer = Proposal(*map(np.asarray, optimiser.solution()))
    (out / "attributes.json").write_text(json.dumps(describe(answer), indent=1))
    return answer


def main() -> None:
    """The command line."""
    command = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    command.add_argument("net", type=Path, help="Python file with a function score")
    command.add_argument("--real", type=Path, required=True, help="folder of images/ and masks/")
    command.add_argument("--out", type=Path, required=True, help="folder for the results")
    command.add_argument(
        "--size", type=int, nargs=2, default=(160, 120), metavar=("WIDTH", "HEIGHT")
    )
    command.add_argument("--evaluations", type=int, default=64)
    command.add_argument("--streets", type=int, default=16, help="images per evaluation")
    command.add_argument("--workers", type=int, default=2)
    options = command.parse_args()
    try:
        score = runpy.run_path(str(options.net)).get("score")
        real = read_real(options.real, tuple(options.size))
    except FileNotFoundError as error:
        command.error(str(error))
    if score is None:
        command.error(f"{options.net} has no function score")
    search(
        score, real, options.out,
        evaluations=options.evaluations, streets=options.streets, workers=options.workers,
    )  # fmt: skip


if __name__ == "__main__":  # workers are fresh processes, which import this file
    main()
