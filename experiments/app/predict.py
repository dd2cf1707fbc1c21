"""Segment images and videos of any size with a trained network: `sdr-jax predict`."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import closing, nullcontext
from itertools import chain, islice
from pathlib import Path

import numpy as np

from common.command import Arguments, exit_code
from common.errors import UserError
from common.files import write
from common.folder import opened
from common.progress import Progress
from experiments.app.prelabels.files import CVAT, RANKING, STUDIO, write_files
from experiments.app.prelabels.ranking import SCORES, Scores, ranked, refuse_unranked
from experiments.config import parsers
from scene.dataset.formats.png import encode
from seg.data.frames import Frame, frames, list_sources, unread_words
from seg.model import PACKAGES, As, Model, load_model


def predict(
    model: Model | str | Path,
    images: str | Path,
    out: str | Path,
    how: As | None = None,
    *,
    probabilities: bool = False,
    rank: int | None = None,
    progress: bool = False,
) -> int:
    """Write a label picture of each image, and continue a stopped call.

    Args:
        model: a model, its folder, or the name of one that comes with the package.
        images: an image, a video, or a folder of both.
        out: the folder of the results, new or of the same call.
        how: ids, colours or overlays; by default as in the label files of the model's data.
        probabilities: whether to write `NAME.npy`, f16[h, w, classes], too.
        rank: order the images, the least certain first, and write pre-labels of so many for annotation tools.
        progress: whether to print progress and the time left.

    Returns:
        The number of images with results in `out`.

    Raises:
        UserError: no model, no images, a broken file, or a folder with other files.
        OSError: a file cannot be written; the error names it.
    """
    model = model if isinstance(model, Model) else load_model(model)
    images, out = Path(images), Path(out)
    sources = list_sources(images)
    if rank is not None:
        how = refuse_unranked(sources, how, probabilities, rank)
    how = how or model.written
    if images.is_dir() and out.resolve().is_relative_to(images.resolve()):
        raise UserError(f"--out {out} lies within {images}, whose images are read; choose another")
    job = {
        "command": "predict",
        "model": model.digest,
        "images": str(images.resolve()),
        "as": how,
        "probabilities": probabilities,
        "classes": [own._asdict() for own in model.classes],
    }
    if rank is not None:
        job["rank"] = True
    total = sum(source.frames for source in sources)
    bar = closing(Progress(total)) if progress else nullcontext()
    unread = unread_words(images)
    done = 0
    with opened(out, job, packages=PACKAGES), bar as told:
        if told is not None and unread:
            told.say(f"{images}: {unread}")
        scores = None if rank is None else Scores(out / SCORES, len(model.classes))

        def there(name: str) -> bool:
            return _label(out, name).exists() and (scores is None or name in scores.known)

        found = chain.from_iterable(frames(source, there) for source in sources)
        for some in _batches(found, model.settings.predict_batch):
            new = [frame for frame in some if frame is not None]
            _write(model, new, out, how, probabilities, scores)
            before, done = done, done + len(some)
            if told is not None:
                told.advance(len(some) - len(new), replayed=True)
                told.advance(len(new))
                if 100 * before // total < 100 * done // total:
                    told.update(f"{done} of {total} images")
        if scores is not None:
            assert rank is not None
            rows = ranked(sources, scores, images, lambda name: _label(out, name), rank)
            write_files(out, rows, rank, model)
    return done


def _batches(found: Iterator[Frame | None], size: int) -> Iterator[list[Frame | None]]:
    while some := list(islice(found, size)):
        yield some


def _label(out: Path, name: str) -> Path:
    return out / f"{name}.png"


def _write(
    model: Model,
    new: Sequence[Frame],
    out: Path,
    how: As,
    probabilities: bool,
    scores: Scores | None,
) -> None:
    """Write the results of some images; labels come last, since they mark an image as done."""
    if not new:
        return
    images = [frame.image for frame in new]
    if scores is not None:
        found, unsure = zip(*model.predict_with_uncertainty(images), strict=True)
        scores.add({frame.name: own for frame, own in zip(new, unsure, strict=True)})
    else:
        found = model.probabilities(images) if probabilities else model.predict(images)
    for frame, labels in zip(new, found, strict=True):
        path = _label(out, frame.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if probabilities:
            data = io.BytesIO()
            np.save(data, labels.astype(np.float16))
            write(path.with_name(f"{Path(frame.name).name}.npy"), data.getvalue())
            labels = labels.argmax(axis=-1).astype(np.uint8)
        write(path, encode(model.painted(labels, how, frame.image)))


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.predict().parse_args(arguments)

    def work() -> None:
        model = load_model(options.model, mirror=not options.no_mirror)
        done = predict(
            model,
            options.images,
            options.out,
            options.how,
            probabilities=options.probabilities,
            rank=options.first if options.rank else None,
            progress=True,
        )
        how = "ids" if options.rank else options.how or model.written
        print(f"{options.out}: {done} images, {how} of {', '.join(model.names)}")

        if options.rank:
            some = f"{min(options.first, done)} in {CVAT} and {STUDIO}"
            print(f"{options.out / RANKING}: label from the top; pre-labels of the first {some}")

    return exit_code(work, debug=options.debug)
