"""Label images and videos of any size with a trained model.

    sdr-jax predict renders19 photos --out labels --as overlay
    sdr-jax predict runs/fit/model video.mp4 --out frames
    sdr-jax predict runs/fit/model unlabelled --rank --out next

MODEL is a folder from `sdr-jax fit` or `Model.save`, or the name of a model in the package: `renders19` has
the 19 classes of Cityscapes and was trained on renders alone. IMAGES is an image, a video, or a folder of
both. Each image becomes a PNG of the same name and size in the folder --out; frames of a video become
NAME/000000.png and so on. The same command resumes a stopped run.
With --rank, ranking.csv lists the images in the order in which to label them, least certain first. cvat.zip
and label_studio.json have predicted labels of the first ones, to correct in these tools.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from common.command import Arguments, exit_code, say
from common.errors import Unfinished, UserError, counted
from common.files import write
from common.folder import opened
from common.progress import Progress
from experiments.app.prelabels.files import CVAT, RANKING, STUDIO, write_files
from experiments.app.prelabels.ranking import SCORES, Scores, ranked, refuse_unranked
from experiments.config import parsers
from scene.dataset.formats.png import encode
from seg.data.frames import Frame, Source, frames, list_sources, unreadable_note
from seg.errors import DataError
from seg.model import PACKAGES, As, Model, load_model

MOST_NAMED = 8
"""The most broken files that are named."""


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
    """Write a label PNG for each image; a stopped call resumes.

    Broken files are left out, and reported once all others have their results.

    Args:
        model: a model, its folder, or the name of one that comes with the package.
        images: an image, a video, or a folder of both.
        out: the folder of the results, new or of the same call.
        how: ids, colours or overlays; by default as in the label files of the model's data.
        probabilities: whether to write `NAME.npy`, f16[h, w, classes], too.
        rank: rank the images, least certain first, and write pre-labels of this many for annotation tools.
        progress: whether to print progress and the time left.

    Returns:
        The number of images with results in `out`.

    Raises:
        UserError: no model, no readable images, or a folder with other files.
        Unfinished: some of the files are broken.
        OSError: a file cannot be written; the error names it.
    """
    model = model if isinstance(model, Model) else load_model(model)
    images, out = Path(images), Path(out)
    sources = list_sources(images)
    if rank is not None:
        how = refuse_unranked(sources, how, probabilities, rank)
    how = how or model.written
    if images.is_dir() and out.resolve().is_relative_to(images.resolve()):
        raise UserError(
            f"--out {out} is inside {images}, whose images are read; choose another folder"
        )
    job = _job(model, images, how, probabilities, rank is not None)
    unread, is_new = unreadable_note(images), not out.exists()
    broken: list[tuple[Source, DataError]] = []
    total = sum(source.frames for source in sources)
    progress_bar = closing(Progress(total)) if progress else nullcontext()
    with opened(out, job, packages=PACKAGES), progress_bar as bar:
        if bar is not None and unread:
            bar.say(f"{images}: {unread}")
        scores = None if rank is None else Scores(out / SCORES, len(model.classes))

        def is_done(name: str) -> bool:
            return _label(out, name).exists() and (scores is None or name in scores.by_name)

        done = 0
        all_frames = _frames(sources, is_done, broken)
        for batch in _batches(all_frames, model.settings.predict_batch):
            new = [frame for frame in batch if frame is not None]
            _write(model, new, out, how, probabilities, scores)
            before, done = done, done + len(batch)
            if bar is not None:
                bar.advance(len(batch) - len(new), replayed=True)
                bar.advance(len(new))
                if 100 * before // total < 100 * done // total:
                    bar.update(f"{done} of {total} images")
        if scores is not None and done:
            assert rank is not None
            faulty = [source for source, _ in broken]
            sources = tuple(source for source in sources if source not in faulty)
            rows = ranked(sources, scores, images, lambda name: _label(out, name), rank)
            write_files(out, rows, rank, model)
    if broken and is_new and not done:
        shutil.rmtree(out)
    if broken:
        raise _error_of(broken, out, done)
    return done


def _job(model: Model, images: Path, how: As, probabilities: bool, ranks: bool) -> dict[str, Any]:
    """What a call must share with the stopped one that it resumes."""
    return {
        "command": "predict",
        "model": model.digest,
        "images": str(images.resolve()),
        "as": how,
        "probabilities": probabilities,
        "classes": [label._asdict() for label in model.classes],
        **({"rank": True} if ranks else {}),
    }


def _error_of(broken: Sequence[tuple[Source, DataError]], out: Path, done: int) -> Exception:
    """The error of the first broken file if no image has labels, otherwise one that names these files."""
    if not done:
        return broken[0][1]
    names = ", ".join(str(source.path) for source, _ in broken[:MOST_NAMED])
    names += ", ..." if len(broken) > MOST_NAMED else ""
    return Unfinished(
        f"{out}: labels of {counted(done, 'image')}; {counted(len(broken), 'broken file')}: {names}"
    )


def _frames(
    sources: Sequence[Source],
    is_done: Callable[[str], bool],
    broken: list[tuple[Source, DataError]],
) -> Iterator[Frame | None]:
    """Yield the frames of all sources, as `frames` does; add broken sources with their error to a list."""
    for source in sources:
        try:
            yield from frames(source, is_done)
        except DataError as error:
            broken.append((source, error))


def _batches(all_frames: Iterator[Frame | None], size: int) -> Iterator[list[Frame | None]]:
    while batch := list(islice(all_frames, size)):
        yield batch


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
    """Write the results of a batch; labels come last, since they mark an image as done."""
    if not new:
        return
    images = [frame.image for frame in new]
    if scores is not None:
        predictions, uncertainties = zip(*model.predict_with_uncertainty(images), strict=True)
        names = (frame.name for frame in new)
        scores.add(dict(zip(names, uncertainties, strict=True)))
    else:
        # The probabilities of a batch of photographs would not fit into memory.
        by_image = (model.probabilities([image])[0] for image in images)
        predictions = by_image if probabilities else model.predict(images)
    for frame, labels in zip(new, predictions, strict=True):
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
        say(
            f"{options.out}: labels of {counted(done, 'image')} as {how}; classes: {', '.join(model.names)}"
        )

        if options.rank:
            count, files = min(options.first, done), f"{CVAT} and {STUDIO}"
            print(f"{options.out / RANKING}: label these images first, from the top")
            print(f"{files}: pre-labels of the first {count}")

    return exit_code(work, debug=options.debug)
