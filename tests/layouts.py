"""Small folders of four images in the published layouts of data sets, the same in every process."""

import io
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

SIZE = (12, 16)
FACADE = np.array([
    (128, 0, 0), (128, 128, 0), (0, 0, 128), (128, 0, 128), (128, 128, 128), (128, 64, 0), (0, 128, 128),
    (0, 128, 0), (0, 0, 0),
], np.uint8)  # fmt: skip
"""LabelMeFacade's colours: building, door, window, car, pavement, road, sky, vegetation, void."""
FACADE_IDS = np.array([0, 0, 0, 1, 2, 3, 4, 5, 255], np.uint8)
"""Its six classes, building, car, sidewalk, road, sky and vegetation, at those colours."""
# Layout -> paths of an image and its label, the names in two splits, and the values in label files.
LAYOUTS = {
    "camvid": (
        "{split}/{name}.png", "{split}annot/{name}.png",
        {"train": ["0001TP_1", "0006R0_2", "0006R0_3"], "test": ["Seq05VD_f4"]}, 11,
    ),
    "cityscapes": (
        "leftImg8bit/{split}/{name}_leftImg8bit.png", "gtFine/{split}/{name}_gtFine_labelIds.png",
        {"train": ["bonn/bonn_000001_000019", "aachen/aachen_000002_000019"],
         "val": ["ulm/ulm_000001_000019", "ulm/ulm_000000_000019"]}, 33,
    ),
    "labelmefacade": (
        "images/{name}.jpg", "labels/{name}.png",
        {"train": ["town__p10", "boston_may__img_7", "town__p9"], "test": ["laredo__street"]}, FACADE,
    ),
    "kitti": (
        "training/image_2/{name}.png", "training/semantic/{name}.png",
        {"train": ["000000_10", "000001_10", "000002_10", "000003_10"]}, 33,
    ),
    "gta5": ("images/{name}.png", "labels/{name}.png", {"train": ["00001", "00002", "00003", "00004"]}, 34),
    "synthia": ("RGB/{name}.png", "GT/LABELS/{name}.png", {"train": ["0000", "0001", "0002", "0003"]}, 22),
    "idd-lite": (
        "leftImg8bit/{split}/{name}_image.jpg", "gtFine/{split}/{name}_label.png",
        {"train": ["0/024541", "87/357164", "87/024541"], "val": ["132/475092"]}, 6,
    ),
    "camvid-32": (
        "701_StillsRaw_full/{name}.png", "LabeledApproved_full/{name}_L.png",
        {"train": ["0006R0_f1", "0016E5_2"], "test": ["Seq05VD_f3", "Seq05VD_f4"]},
        np.array([(128, 64, 128), (0, 0, 192), (192, 64, 128), (0, 0, 0), (64, 64, 0)], np.uint8),
    ),
}  # fmt: skip


def write(layout: str, root: Path) -> Path:
    """Random images, and labels in blocks of two pixels by two; files called .jpg hold PNG."""
    image, label, splits, values = LAYOUTS[layout]
    for k, (split, name) in enumerate((s, name) for s, own in splits.items() for name in own):
        rng = np.random.default_rng([k, len(layout)])
        save(root / image.format(split=split, name=name), rng.integers(0, 256, (*SIZE, 3)))
        highest = values if isinstance(values, int) else len(values) - 1
        places = np.kron(
            rng.integers(0, highest + 1, (SIZE[0] // 2, SIZE[1] // 2)), np.ones((2, 2), int)
        )
        path = root / label.format(split=split, name=name)
        if layout == "synthia":
            write_packed(path, places)
        else:
            save(path, values[places] if isinstance(values, np.ndarray) else places)
    if layout == "camvid":
        lines = [f"/SegNet/CamVid/{image} /SegNet/CamVid/{label}".format(split="train", name=name) + "\n"
                 for name in splits["train"]]  # fmt: skip
        (root / "train.txt").write_text("".join(lines))
    if layout == "labelmefacade":
        for split, names in splits.items():
            (root / f"{split}.txt").write_text("\n".join(names) + "\n\n")
    return root


def save(path: Path, pixels: np.ndarray) -> None:
    """A PNG, whatever the file is called."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(data, "PNG")
    path.write_bytes(data.getvalue())


def write_packed(path: Path, values: np.ndarray, dtype: type = np.uint16) -> None:
    """Labels as SYNTHIA has them: ids in the first channel, instances in the second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    instances = np.arange(values.size).reshape(values.shape)
    channels = np.stack([np.zeros_like(values), instances, values], axis=2).astype(dtype)
    assert cv2.imwrite(str(path), channels)  # which turns the channels round
