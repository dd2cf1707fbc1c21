"""Takes the tensors of a file by name, and checks each one."""

from collections.abc import Iterable, Mapping

import numpy as np

from seg.errors import WeightsError


class Named:
    """The tensors of a file that have not been taken yet.

    Args:
        arrays: the file's arrays.
        where: the file's name in messages.
        net: the expected network, in words.
        unused: names that may be left over.
    """

    def __init__(
        self,
        arrays: Mapping[str, np.ndarray],
        where: str,
        net: str,
        unused: Iterable[str] = (),
    ) -> None:
        self._left = {name: array for name, array in arrays.items() if name not in set(unused)}
        self._where, self._net = where, net

    def take(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """Take a tensor f32 of this shape.

        Raises:
            WeightsError: it is missing, of another shape or type, or not finite.
        """
        if name not in self._left:
            raise self.error(f"{name} is missing; expected all of {self._net}")
        array = self._left.pop(name)
        if array.shape != shape or array.dtype != np.float32:
            raise self.error(
                f"{name}: {array.dtype}{list(array.shape)}; {self._net} has float32{list(shape)}"
            )
        if not np.isfinite(array).all():
            raise self.error(f"{name}: holds values that are not finite")
        return array

    def refuse_others(self) -> None:
        """Raise WeightsError if a tensor was not taken."""
        if self._left:
            raise self.error(
                f"{min(self._left)}: {self._net} has no such tensor; these weights are of another "
                "network"
            )

    def error(self, text: str) -> WeightsError:
        """The error of the file with a text."""
        return WeightsError(f"{self._where}: {text}")
