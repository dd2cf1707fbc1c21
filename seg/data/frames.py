"""Images to segment: single files, folders of files, and the frames of videos."""

import os
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from common.files import IMAGES, files_below
from common.pictures import MOST_PIXELS
from seg.data.images import read_image
from seg.errors import DataError

VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")
UNREADABLE = (".heic", ".heif", ".avif", ".jp2", ".jxl", ".gif", ".dng", ".cr2", ".nef", ".arw")
"""Extensions of photographs that OpenCV does not read."""


class Source(NamedTuple):
    """An image file, or a video."""

    name: str  # path within the listed folder, without its suffix
    path: Path
    frames: int  # approximate for a video, 1 for an image or a broken video

    @property
    def video(self) -> bool:
        """Whether it is a video."""
        return self.path.suffix.lower() in VIDEOS


class Frame(NamedTuple):
    """An image of a source."""

    name: str  # the image's name, or the video's and the number of the frame, `drive/000012`
    image: np.ndarray  # u8[h, w, 3] RGB


def list_sources(path: str | Path) -> tuple[Source, ...]:
    """List the images and videos of a folder and its sub-folders, or one file, without reading images.

    Args:
        path: folder, image or video.

    Raises:
        DataError: there is no such file, no image or video, or two files whose results would have the same
            name.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path}: no such file or folder; expected images or a video")
    kinds = ", ".join(IMAGES + VIDEOS)
    if path.is_dir():
        paths = [p for p in files_below(path) if p.suffix.lower() in IMAGES + VIDEOS]
        if not paths:
            unreadable = f"; {note}" if (note := unreadable_note(path)) else ""
            raise DataError(f"{path}: no images or videos; expected {kinds}{unreadable}")
        named = [(p.relative_to(path).with_suffix("").as_posix(), p) for p in paths]
    elif path.suffix.lower() not in IMAGES + VIDEOS:
        raise DataError(f"{path}: not an image or video; expected {kinds}, or a folder of these")
    else:
        named = [(path.stem, path)]
    by_name: dict[str, Path] = {}
    videos = {name: file for name, file in named if file.suffix.lower() in VIDEOS}
    for name, file in named:
        if name in by_name:
            raise DataError(f"{file} and {by_name[name]} have the same name; rename one")
        by_name[name] = file
        folder = name.rpartition("/")[0]
        if folder in videos:
            raise DataError(
                f"{file}: its folder is named like the video {videos[folder]}, whose results go into a "
                "folder of that name; rename one"
            )
    return tuple(Source(name, file, _frames(file)) for name, file in named)


def unreadable_note(path: Path) -> str:
    """A note on photographs of a folder that cannot be read; empty if there are none."""
    if not path.is_dir():
        return ""
    kinds = Counter(file.suffix.lower() for file in files_below(path))
    counts = [f"{kinds[kind]} {kind}" for kind in UNREADABLE if kinds[kind]]
    return f"cannot read {', '.join(counts)}: convert them to JPEG or PNG" if counts else ""


def _frames(path: Path) -> int:
    if path.suffix.lower() not in VIDEOS:
        return 1
    try:
        with _opened(path) as video:
            return max(int(video.get(cv2.CAP_PROP_FRAME_COUNT)), 1)
    except DataError:
        return 1  # `frames` says what is wrong with it


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    """Open a video at its first frame, and close it. Raises DataError if it has none."""
    # FFmpeg's own lines would stand before the one that names the file.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    video = cv2.VideoCapture(str(path))
    try:
        _check(video, path)
        yield video
    finally:
        video.release()


def _check(video: cv2.VideoCapture, path: Path) -> None:
    if not video.isOpened() or not video.grab():
        raise DataError(
            f"{path}: OpenCV cannot read this video, or it has no frames; convert it, or extract its frames "
            "as images"
        )
    width, height = (
        int(video.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    if width * height > MOST_PIXELS:
        raise DataError(f"{path}: {width}x{height} is more than {MOST_PIXELS:,} pixels")


def frames(source: Source, skip: Callable[[str], bool]) -> Iterator[Frame | None]:
    """Yield the images of a source in order, and None for each name that is skipped.

    Args:
        source: from `list_sources`.
        skip: whether to skip the image of a name, which is then not decoded.

    Raises:
        DataError: the file is missing, broken or truncated, or a video without frames.
    """
    if not source.video:
        yield None if skip(source.name) else Frame(source.name, read_image(source.path))
        return
    with _opened(source.path) as video:
        number, has_frame = 0, True
        while has_frame:
            name = f"{source.name}/{number:06d}"
            if skip(name):
                yield None
            else:
                decoded, image = video.retrieve()
                if not decoded:
                    raise DataError(f"{source.path}: frame {number} is damaged")
                yield Frame(name, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            number, has_frame = number + 1, video.grab()
