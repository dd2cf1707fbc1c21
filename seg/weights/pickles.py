"""Reads the pickle inside a PyTorch file without running any of it.

A pickle is a program. This reader knows only the instructions that PyTorch writes for a dictionary of
tensors, and only the functions below, which record their arguments. Everything else is an error. It uses
Python's slow unpickler, because its instructions can be removed.
"""

import pickle
from collections import OrderedDict
from collections.abc import Callable
from io import BufferedIOBase
from typing import Any

from seg.errors import WeightsError
from seg.weights.tensors import DTYPES, Tensor

_INSTRUCTIONS = (
    "PROTO FRAME STOP MARK POP_MARK NONE NEWTRUE NEWFALSE BININT BININT1 BININT2 LONG1 BINFLOAT "
    "BINSTRING SHORT_BINSTRING BINUNICODE SHORT_BINUNICODE EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 "
    "EMPTY_LIST APPEND APPENDS EMPTY_DICT SETITEM SETITEMS GLOBAL STACK_GLOBAL REDUCE BUILD "
    "BINPERSID BINGET LONG_BINGET BINPUT LONG_BINPUT MEMOIZE"
).split()


class _Refused(Exception):
    """An instruction or a function that no file of weights needs."""


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any, *_: Any) -> Tensor:
    key, dtype, elements = storage
    if not isinstance(key, str):
        raise _Refused("it has a storage without a name")
    sizes, steps = (tuple(int(n) for n in numbers) for numbers in (shape, strides))
    return Tensor(str(key), dtype, int(elements), int(offset), sizes, steps)


def _parameter(data: Any, *_: Any) -> Any:
    return data


def _ordered_dict(*arguments: Any) -> OrderedDict[Any, Any]:
    if any(arguments):
        raise _Refused("it makes a dictionary of something else")
    return OrderedDict()


_FUNCTIONS: dict[tuple[str, str], Callable[..., Any]] = {
    ("collections", "OrderedDict"): _ordered_dict,
    ("torch._utils", "_rebuild_tensor"): _tensor,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _parameter,
}


class _Unpickler(pickle._Unpickler):
    """An unpickler that knows only the instructions above."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _FUNCTIONS:
            return _FUNCTIONS[module, name]
        kind = name.removesuffix("Storage")
        if module == "torch" and name.endswith("Storage") and kind in DTYPES:
            return DTYPES[kind]
        raise _Refused(f"it calls {module}.{name}")

    def persistent_load(self, pid: Any) -> Any:
        """A storage: ("storage", type, key, device, elements), and in old files the viewed storage."""
        kind, dtype, key, _, elements, *view = pid
        if kind != "storage" or dtype not in DTYPES.values() or any(v is not None for v in view):
            raise _Refused("it refers to something that is no whole storage")
        return key, dtype, elements


def _refuse(unpickler: Any) -> None:
    raise _Refused("it holds an instruction that no state dict needs")


def _reduce(unpickler: Any) -> None:
    arguments = unpickler.stack.pop()
    function = unpickler.stack[-1]
    if not any(function is allowed for allowed in _FUNCTIONS.values()):
        raise _Refused("it calls something that is no function")
    unpickler.stack[-1] = function(*arguments)


def _set_item(unpickler: Any) -> None:
    value, key = unpickler.stack.pop(), unpickler.stack.pop()
    _put(unpickler.stack[-1], key, value)


def _set_items(unpickler: Any) -> None:
    items = unpickler.pop_mark()
    for key, value in zip(items[::2], items[1::2], strict=True):
        _put(unpickler.stack[-1], key, value)


def _put(into: Any, key: Any, value: Any) -> None:
    """Set an item with a text as key; nested tuples could take for ever to look up or to print."""
    if not isinstance(into, dict) or not isinstance(key, str | int):
        raise _Refused(f"it has a {type(key).__name__} as a name")
    into[key] = value


def _build(unpickler: Any) -> None:
    """Ignore the attributes of a state dict, which hold the versions of its layers."""
    unpickler.stack.pop()
    if not isinstance(unpickler.stack[-1], dict):
        raise _Refused("it sets attributes of something that is no dictionary")


def _allowed_instructions() -> dict[int, Callable[[Any], None]]:
    allowed = {getattr(pickle, name)[0] for name in _INSTRUCTIONS}
    every = pickle._Unpickler.dispatch
    table = {code: load if code in allowed else _refuse for code, load in every.items()}
    replaced = {"REDUCE": _reduce, "BUILD": _build, "SETITEM": _set_item, "SETITEMS": _set_items}
    return {**table, **{getattr(pickle, name)[0]: load for name, load in replaced.items()}}


_Unpickler.dispatch = _allowed_instructions()


def load(file: BufferedIOBase, where: str) -> Any:
    """Read one pickle exactly to its end: plain values, with tensors as `Tensor`.

    Args:
        file: at the beginning of the pickle.
        where: the file's name in messages.

    Raises:
        WeightsError: the pickle is damaged, or would do more than describe tensors.
    """
    try:
        return _Unpickler(file, encoding="utf-8").load()
    except _Refused as error:
        raise WeightsError(
            f"{where}: {error}; expected a state dict, nothing but named tensors "
            "(torch.save(net.state_dict(), FILE)), and nothing else is run"
        ) from None
    except OSError:
        raise
    except Exception as error:  # bytes that are no pickle may cause any error
        raise WeightsError(f"{where}: not a pickle, or a damaged one ({error!r})") from None
