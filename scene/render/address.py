"""Read arrays in place: compiled code that follows addresses in a table."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def float_pointer(typing_context: Any, address: Any) -> Any:
    """The float pointer that an integer ``address`` stands for."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.PointerType(ir.FloatType()))

    return types.CPointer(types.float32)(address), generate


@intrinsic
def int_pointer(typing_context: Any, address: Any) -> Any:
    """The pointer to 32-bit integers that an integer ``address`` stands for."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.PointerType(ir.IntType(32)))

    return types.CPointer(types.int32)(address), generate
