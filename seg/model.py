"""A trained network as a model: it is saved as files, loaded again, and used on images of any size.

A model is a folder of three files. `weights.safetensors` holds all variables that training returns. With a
frozen backbone these are the head's alone, since the backbone's weights come with a package or are a file of
the user's, which `config.json` names with its digest. `config.json` also holds the classes, the size, the
recipe and the versions. `README.md` is the card for people and Hugging Face; the program does not read it.
"""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import cv2
import jax
import numpy as np
from jaxtyping import Float32, UInt8
from safetensors import SafetensorError
from safetensors.numpy import load as parse_tensors
from safetensors.numpy import save as tensor_bytes

from common.bounds import check_fields
from common.errors import UserError, printable, suggestion
from common.files import digest, read_bytes, read_json, versions, whole_folder, write, write_json
from common.labels.target_file import TargetFile
from common.memory import refuse_larger
from seg.card import README, card
from seg.check import check_net
from seg.classes import IGNORE_LABEL, colorize
from seg.data.labelled import fitted, resize_image
from seg.errors import ModelError
from seg.inference import logits, variable_shapes
from seg.names import As
from seg.nets.backbones import backbone_of
from seg.settings import TrainSettings
from seg.step import Params
from seg.uncertainty import Uncertainty, uncertainty
from seg.weights.tensors import LARGEST

FORMAT = 2
"""The version of the folder's format; a newer one is refused. Format 1 has the backbone as "trunk"."""
CONFIG, WEIGHTS = "config.json", "weights.safetensors"
OF_RUN = "model"
"""The folder of the model in the folder of `sdr-jax fit`."""
SEEN = "image_files"
"""The note with the SHA-256 of each labelled image's file on which the network was trained, if it is
known."""
SHIPPED = Path(__file__).parent / "models"
"""The folder of the models that come with the package; a subfolder's name is its model's."""
PACKAGES = ("sdr-jax", "jax", "flax", "numpy", "opencv-python-headless", "safetensors")
"""The packages whose versions a saved model names."""

Written = Literal["ids", "colours"]
"""How label files name classes."""


class LabelClass(NamedTuple):
    """A class, and how label files name it."""

    name: str
    id: int  # in files of ids, 0..65535
    color: tuple[int, int, int]  # RGB


def label_classes(
    names: Sequence[str],
    ids: Sequence[int] | None = None,
    colors: Sequence[Sequence[int]] | None = None,
) -> tuple[LabelClass, ...]:
    """Classes in the order of the network's labels.

    Args:
        names: names of the classes.
        ids: ids in label files; by default 0, 1, 2 and so on.
        colors: RGB; by default the colours of PASCAL VOC.

    Raises:
        ValueError: not one id or colour for each name.
    """
    for what, values in (("ids", ids), ("colors", colors)):
        if values is not None and len(values) != len(names):
            raise ValueError(f"{what} has {len(values)} entries, but there are {len(names)} names")
    chosen = [_voc_color(k + 1) for k in range(len(names))] if colors is None else colors
    numbers = range(len(names)) if ids is None else ids
    return tuple(
        LabelClass(str(name), int(number), (int(rgb[0]), int(rgb[1]), int(rgb[2])))
        for name, number, rgb in zip(names, numbers, chosen, strict=True)
    )


def classes_of(target: TargetFile) -> tuple[LabelClass, ...]:
    """The classes of a target, with the first of the ids of each; 0, 1, 2 and so on if they have none.

    The class of the rest may lack ids where others have some; it gets the least unused one.
    """
    ids = {name: entry.ids[0] for name, entry in target.classes.items() if entry.ids}
    if target.rest is not None and {*target.classes} - {*ids} == {target.rest} and ids:
        used_ids = {*target.void, *(id for entry in target.classes.values() for id in entry.ids)}
        ids[target.rest] = next(id for id in range(2**16) if id not in used_ids)
    every = len(ids) == len(target.classes)
    numbers = [ids[name] for name in target.classes] if every else None
    return label_classes(target.class_names, numbers, target.palette)


def _voc_color(number: int) -> tuple[int, int, int]:
    """The colour of a number in PASCAL VOC: R, G and B take every third bit, the lowest bit on top."""
    channels = [0, 0, 0]
    for place in range(8):
        for channel in range(3):
            channels[channel] |= (number >> (3 * place + channel) & 1) << (7 - place)
    return channels[0], channels[1], channels[2]


@dataclass(frozen=True)
class Model:
    """A trained network with everything that its use needs.

    Attributes:
        settings: its recipe, which names the network.
        variables: all of its variables, as `seg.train` returns them.
        size: (height, width) of its training images; other images are brought to it.
        classes: the meaning of its labels 0, 1, 2 ...
        written: how label files of its data name classes: ids or colours.
        notes: its training data and results, as plain values.
        versions: versions of the packages that saved it.
    """

    settings: TrainSettings
    variables: Params
    size: tuple[int, int]
    classes: tuple[LabelClass, ...]
    written: Written = "ids"
    notes: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=lambda: versions(PACKAGES))

    def __post_init__(self) -> None:
        check_net(self.settings)
        _check_classes(self.classes, self.written)
        least = max(backbone_of(self.settings).strides) if self.settings.has_backbone else 1
        if min(self.size) < least:
            raise ValueError(f"size must be (height, width) of {least} or more; got {self.size}")
        # Of a pixel: its colour, and the scores of all classes.
        pixel, pixels = 3 + 4 * len(self.classes), self.size[0] * self.size[1]
        refuse_larger("size, in pixels,", pixels, lambda n: n * pixel, "scores")
        batch = self.settings.predict_batch
        refuse_larger("predict_batch", batch, lambda n: n * pixels * pixel, "scores")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the classes."""
        return tuple(label_class.name for label_class in self.classes)

    @property
    def digest(self) -> str:
        """SHA-256 of everything that decides predictions and how they are written."""
        decides = {k: v for k, v in self.config().items() if k not in ("versions", "notes")}
        # The content of a frozen backbone's file is in `backbone`; its path decides nothing.
        return digest({**decides, "recipe": {**decides["recipe"], "weights": None}})

    def predict(
        self,
        images: UInt8[np.ndarray, "n h w 3"] | Sequence[np.ndarray],
        among: Sequence[int] | None = None,
    ) -> Any:
        """Segment images of any size.

        An image is brought to the model's size with its aspect kept, by area averages if it shrinks, and
        a margin on the right or below; scores of classes are brought back to the image's own size.

        Args:
            images: RGB, one array u8[n, h, w, 3], or a list of arrays u8[h, w, 3] of any sizes.
            among: indices of the classes that may be predicted; None for all.

        Returns:
            Indices of `classes`, u8[n, h, w], or a list of u8[h, w] for a list.

        Raises:
            ValueError: an image is not RGB bytes, or has no pixel, or the array has no images, or `among` has
                no class or unknown ones.
            WeightsError: the frozen backbone's weights cannot be used.
        """
        places = range(len(self.classes)) if among is None else among
        if not len(places) or not all(0 <= place < len(self.classes) for place in places):
            raise ValueError(
                f"among must be indices of classes, 0..{len(self.classes) - 1}; got {list(places)}"
            )
        predictions = [_highest(scores, size, places) for scores, size in self._scores(images)]
        return np.stack(predictions) if isinstance(images, np.ndarray) else predictions

    def probabilities(self, images: UInt8[np.ndarray, "n h w 3"] | Sequence[np.ndarray]) -> Any:
        """The probability of each class: the softmax of the scores that `predict` compares.

        Args:
            images: as for `predict`.

        Returns:
            f32[n, h, w, classes], or a list of f32[h, w, classes] for a list.
        """
        probabilities = [_softmax(scores, size) for scores, size in self._scores(images)]
        return np.stack(probabilities) if isinstance(images, np.ndarray) else probabilities

    def predict_with_uncertainty(
        self, images: Sequence[np.ndarray]
    ) -> list[tuple[UInt8[np.ndarray, "h w"], Uncertainty]]:
        """What `predict` returns for a list, each with the network's uncertainty at the model's size."""
        places = range(len(self.classes))
        return [
            (_highest(scores, size, places), uncertainty(scores))
            for scores, size in self._scores(images)
        ]

    def _scores(
        self, images: Any
    ) -> Iterator[tuple[Float32[np.ndarray, "rows cols classes"], tuple[int, int]]]:
        """Scores of the part that shows the image, at the model's size, and the image's own size."""
        if isinstance(images, np.ndarray) and not len(images):
            raise ValueError(f"expected images u8[n, h, w, 3], n > 0; got {list(images.shape)}")
        for image in images:
            if image.ndim != 3 or image.shape[-1] != 3 or image.dtype != np.uint8 or not image.size:
                raise ValueError(
                    f"an image must be u8[h, w, 3]; got {image.dtype}{list(image.shape)}"
                )
        batch_size = self.settings.predict_batch
        for start in range(0, len(images), batch_size):
            batch = [fitted(image, self.size) for image in images[start : start + batch_size]]
            canvases = np.stack([canvas for canvas, _ in batch])
            if start:
                # The last batch has the shape of the others, for which the network is compiled.
                missing = batch_size - len(batch)
                canvases = np.pad(canvases, ((0, missing), (0, 0), (0, 0), (0, 0)))
            scores = logits(self.variables, canvases, self.settings, len(self.classes))
            for k, (_, (rows, cols)) in enumerate(batch):
                yield scores[k, :rows, :cols], images[start + k].shape[:2]

    def painted(
        self,
        labels: UInt8[np.ndarray, "h w"],
        how: As | None = None,
        image: UInt8[np.ndarray, "h w 3"] | None = None,
    ) -> np.ndarray:
        """Paint a prediction in the format of label files.

        Args:
            labels: from `predict`; 255 for ignored pixels, which become 255, or the least id without a class
                if 255 has one, and black in colours.
            how: the format; by default that of the label files of the model's data.
            image: the segmented image, for overlays.

        Returns:
            Ids u8[h, w], or u16[h, w] if one is above 255; or RGB u8[h, w, 3].
        """
        how = how or self.written
        if how == "ids":
            ids = [label_class.id for label_class in self.classes]
            ignored = next(id for id in (IGNORE_LABEL, *range(256)) if id not in ids)
            table = np.full(256, ignored, np.uint16 if max(ids) > 255 else np.uint8)
            table[: len(ids)] = ids
            return table[labels]
        colours = colorize(labels, [label_class.color for label_class in self.classes])
        if how == "colours":
            return colours
        if image is None:
            raise ValueError("an overlay needs the image")
        return cv2.addWeighted(image, 0.5, colours, 0.5, 0)

    def save(self, folder: str | Path) -> None:
        """Write the model into its own folder, whole or not at all; it replaces an older model.

        Raises:
            ModelError: the folder holds other files.
            ValueError: weights are not finite.
            OSError: a file cannot be written; the error names it.
        """
        folder = Path(folder)
        refuse_others(folder)
        for name, values in _named(self.variables):
            if not np.isfinite(values).all():
                raise ValueError(f"the weights {name} have values that are not finite")
        weights = self._weights()
        config = self._config(weights)
        with whole_folder(folder) as part:
            write(part / WEIGHTS, weights)
            write(part / README, card(config))
            write_json(part / CONFIG, config)

    def _weights(self) -> bytes:
        return tensor_bytes({name: np.ascontiguousarray(a) for name, a in _named(self.variables)})

    def config(self) -> dict[str, Any]:
        """The content of ``config.json``."""
        return self._config(self._weights())

    def _config(self, weights: bytes) -> dict[str, Any]:
        height, width = self.size
        recipe = asdict(self.settings)
        return {
            "format": FORMAT,
            "net": self.settings.net,
            "size": {"width": width, "height": height},
            "written": self.written,
            "classes": [
                {**label_class._asdict(), "color": list(label_class.color)}
                for label_class in self.classes
            ],
            "backbone": dict(backbone_of(self.settings).source) if self.settings.frozen else None,
            "weights": {"file": WEIGHTS, "sha256": hashlib.sha256(weights).hexdigest()},
            # NumPy's numbers, which settings may hold, are none of JSON.
            "recipe": {k: v.item() if isinstance(v, np.generic) else v for k, v in recipe.items()},
            "notes": dict(self.notes),
            "versions": dict(self.versions),
        }


def refuse_others(folder: Path) -> None:
    """Raise ModelError if a model cannot be saved in a folder, since it holds other files."""
    if not folder.exists():
        return
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    if other_names := names - {CONFIG, WEIGHTS, README}:
        raise ModelError(
            f"{folder} holds other files, such as {min(other_names)}; "
            "a model is saved into a new folder, or over an older model"
        )


def load_model(path: str | Path, mirror: bool = True) -> Model:
    """Load a model that `Model.save` wrote, or one that comes with the package.

    Args:
        path: its folder, or a name such as `renders19`.
        mirror: False for predictions from the image alone, in half the time, where the model averages over
            the mirror image.

    Raises:
        ModelError: no model, a damaged one, or one of a newer format; the message names file and field.
    """
    folder = Path(path)
    if str(path) in shipped():
        folder = SHIPPED / str(path)
    file = folder / CONFIG
    if not (folder / WEIGHTS).is_file() and (folder / OF_RUN / CONFIG).is_file():
        raise ModelError(f"{folder} is the folder of a run, whose model is {folder / OF_RUN}")
    if not file.is_file():
        names = f", or {' or '.join(shipped())}" if shipped() else ""
        raise ModelError(
            f"{folder} is not a model: pass a folder with {CONFIG} and {WEIGHTS}{names}"
            + suggestion(str(path), shipped())
        )
    try:
        model = _loaded(folder, read_json(file))
    except ModelError:
        raise
    except OSError as error:
        raise ModelError(f"{error.filename or folder}: {error.strerror or error}") from None
    except (UserError, ValueError) as error:
        raise ModelError(f"{file}: {printable(str(error).removeprefix(f'{file}: '))}") from None
    settings = replace(model.settings, average_mirror=model.settings.average_mirror and mirror)
    return replace(model, settings=settings)


def shipped() -> tuple[str, ...]:
    """Names of the models that come with the package."""
    return tuple(sorted(path.parent.name for path in SHIPPED.glob(f"*/{CONFIG}")))


def _loaded(folder: Path, config: Any) -> Model:
    """Load the model of a folder; ValueError says what is wrong in its config."""
    version = _field(config, "format", int)
    if not 1 <= version <= FORMAT:
        upgrade = "; upgrade sdr-jax to the version that wrote it" if version > FORMAT else ""
        raise ValueError(f"format is {version}, and this version reads 1 to {FORMAT}{upgrade}")
    recipe = _field(config, "recipe", dict)
    if version == 1:
        config, recipe = (
            {"backbone" if name == "trunk" else name: value for name, value in section.items()}
            for section in (config, recipe)
        )
    settings = _settings(recipe)
    if settings.has_backbone and settings.weights is not None:
        settings = replace(settings, weights=str(_backbone_file(folder, Path(settings.weights))))
    if settings.frozen:
        expected, available = _field(config, "backbone", dict), dict(backbone_of(settings).source)
        if expected != available:
            raise ValueError(
                f"its head was trained on the backbone {_source_text(expected)}, not on "
                f"{_source_text(available)}, which is installed"
            )
    rows = _field(config, "classes", list)
    classes = tuple(_label_class(f"classes[{k}]", row) for k, row in enumerate(rows))
    written = _field(config, "written", str)
    _check_classes(classes, written)
    size = _field(config, "size", dict)
    variables = _variables(
        folder / WEIGHTS,
        _field(_field(config, "weights", dict), "sha256", str, "weights."),
        settings,
        len(classes),
        version,
    )
    return Model(
        settings,
        variables,
        (_field(size, "height", int, "size."), _field(size, "width", int, "size.")),
        classes,
        written,
        _field(config, "notes", dict),
        _field(config, "versions", dict),
    )


def _field(value: Any, name: str, kind: type, where: str = "") -> Any:
    """A field of the object at `where`; ValueError if it is missing or of another type."""
    if not isinstance(value, dict) or name not in value:
        raise ValueError(f"{where}{name} is missing: the file is damaged, or not of a model")
    field_value = value[name]
    if not isinstance(field_value, kind) or isinstance(field_value, bool):
        raise ValueError(f"{where}{name} is {field_value!r}; expected {kind.__name__}")
    return field_value


def _settings(recipe: dict[str, Any]) -> TrainSettings:
    if unknown := sorted(recipe.keys() - {setting.name for setting in fields(TrainSettings)}):
        raise ValueError(f"recipe.{unknown[0]}: there is no such setting")
    check_fields(TrainSettings, recipe, "recipe.")
    settings = TrainSettings(**recipe)
    check_net(settings)
    return settings


def _label_class(where: str, row: Any) -> LabelClass:
    color = _field(row, "color", list, f"{where}.")
    if len(color) != 3 or any(type(v) is not int or not 0 <= v <= 255 for v in color):
        raise ValueError(f"{where}.color is {color}; expected three numbers 0..255")
    name, id = _field(row, "name", str, f"{where}."), _field(row, "id", int, f"{where}.")
    return LabelClass(name, id, tuple(color))


def _check_classes(classes: Sequence[LabelClass], written: str) -> None:
    """Raise ValueError unless label files can tell all classes apart."""
    if not 1 <= len(classes) <= IGNORE_LABEL:
        raise ValueError(f"a model has 1 to {IGNORE_LABEL} classes, not {len(classes)}")
    if written not in get_args(Written):
        raise ValueError(f"written is {written!r}; expected {' or '.join(get_args(Written))}")
    distinct_fields: dict[str, list[Any]] = {
        "name": [label_class.name for label_class in classes],
        "id": [label_class.id for label_class in classes],
    }
    if written == "colours":
        distinct_fields["color"] = [label_class.color for label_class in classes]
    for field_name, values in distinct_fields.items():
        for value in values:
            if values.count(value) > 1:
                raise ValueError(f"two classes have the {field_name} {value!r}")
    if any(not 0 <= label_class.id < 2**16 for label_class in classes):
        raise ValueError("ids of classes must be in 0..65535")
    for label_class in classes:
        if not all(0 <= value <= 255 for value in label_class.color):
            raise ValueError(
                f"the color of {label_class.name} is {label_class.color}, not in 0..255"
            )


def _variables(
    path: Path, expected: str, settings: TrainSettings, classes: int, version: int
) -> Params:
    """Read the network's variables from a file, and check each one."""
    data = read_bytes(path, LARGEST)
    sha256 = hashlib.sha256(data).hexdigest()
    if sha256 != expected:
        raise ModelError(
            f"{path}: its SHA-256 is {sha256[:8]}..., not {printable(expected[:8])}... as {CONFIG} says: "
            "it is damaged, or of another model"
        )
    try:
        arrays = parse_tensors(data)
        if version == 1:
            arrays = {re.sub("^trunk/", "backbone/", name): array for name, array in arrays.items()}
    except (SafetensorError, ValueError, KeyError) as error:
        raise ModelError(f"{path}: a damaged .safetensors ({error})") from None
    net = variable_shapes(settings, classes)
    leaves_by_name = dict(_named(net))
    if mismatched := sorted(leaves_by_name.keys() ^ arrays.keys()):
        problem = (
            "is missing"
            if mismatched[0] in leaves_by_name
            else f"is not part of the network {settings.net}"
        )
        raise ModelError(f"{path}: {mismatched[0]} {problem}; {CONFIG} is of another network")
    for name, leaf in leaves_by_name.items():
        array = arrays[name]
        if array.shape != leaf.shape or array.dtype != leaf.dtype:
            raise ModelError(
                f"{path}: {name}: {array.dtype}{list(array.shape)}; the network {settings.net} with "
                f"{classes} classes has {leaf.dtype}{list(leaf.shape)}"
            )
        if not np.isfinite(array).all():
            raise ModelError(f"{path}: {name}: holds values that are not finite")
    # On the device, or every call of the network would send them again.
    leaves = jax.device_put([arrays[name] for name in leaves_by_name])
    return jax.tree.unflatten(jax.tree.structure(net), leaves)


def _named(tree: Params) -> Iterator[tuple[str, Any]]:
    """Leaves by their path in the network, such as `head/score/kernel`, without the collection."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        yield "/".join(str(key.key) for key in path[1:]), leaf


def _backbone_file(folder: Path, file: Path) -> Path:
    """The file of a backbone's weights: at its old path, or in the folder of a model that was moved.

    Raises:
        ModelError: it is in neither place.
    """
    places = (file, folder / file.name)
    for place in places:
        if place.is_file():
            return place
    raise ModelError(
        f"{folder}: the weights of its backbone are missing; expected {places[0]} or {places[1]}"
    )


def _source_text(source: Mapping[str, Any]) -> str:
    """Describe the weights of a backbone in words."""
    return " ".join(f"{str(v)[:8]}..." if k == "sha256" else str(v) for k, v in source.items())


def _plane(scores: np.ndarray, place: int, size: tuple[int, int]) -> np.ndarray:
    """The scores f32[h, w] of one class at a size (height, width)."""
    return resize_image(np.ascontiguousarray(scores[..., place]), size)


def _highest(scores: np.ndarray, size: tuple[int, int], places: Sequence[int]) -> np.ndarray:
    """The class of each pixel's highest score; class by class, since an array of all scores is large."""
    best = _plane(scores, places[0], size)
    labels = np.full(size, places[0], np.uint8)
    for place in places[1:]:
        plane = _plane(scores, place, size)
        labels[plane > best] = place
        best = np.maximum(best, plane)
    return labels


def _softmax(scores: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    planes = np.stack([_plane(scores, k, size) for k in range(scores.shape[-1])], axis=-1)
    planes -= planes.max(axis=-1, keepdims=True)
    np.exp(planes, out=planes)
    planes /= planes.sum(axis=-1, keepdims=True)
    return planes
