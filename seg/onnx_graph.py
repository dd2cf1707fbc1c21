"""Writes a model as an ONNX graph, operation by operation of its JAX trace.

The network is traced for one image, and each operation becomes one or two nodes. Operations on constants
alone are computed here. The variants that networks have for XLA's CPU backend are not used: a convolution
becomes a Conv, not a sum of shifted copies.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jax.extend.core import Literal

from seg.errors import ModelError
from seg.inference import apply
from seg.model import Model

OPSET, IR = 18, 9
"""Versions of the files; onnxruntime 1.15 and newer reads both."""
_INNER = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
}
"""Operations that call a function, and the parameter that holds it."""
_SAME = ("stop_gradient", "copy", "copy_p")
_ELEMENTWISE = {
    "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "max": "Max", "min": "Min", "pow": "Pow",
    "gt": "Greater", "ge": "GreaterOrEqual", "lt": "Less", "le": "LessOrEqual", "eq": "Equal",
    "exp": "Exp", "log": "Log", "neg": "Neg", "abs": "Abs", "sqrt": "Sqrt", "tanh": "Tanh", "and": "And",
    "or": "Or", "not": "Not",
}  # fmt: skip
Value = Any  # a constant NumPy array, or the name of a value that the graph computes


def onnx_package() -> Any:
    """The package onnx.

    Raises:
        ModelError: it is not installed.
    """
    try:
        import onnx
    except ImportError:
        raise ModelError("ONNX files need the package onnx: pip install 'sdr-jax[onnx]'") from None
    return onnx


def onnx_bytes(model: Model) -> bytes:
    """Write a model as the bytes of an ONNX file.

    Its input is `image`, u8[1, height, width, 3], RGB of the model's size; its outputs are `labels`,
    u8[1, height, width], indices of the classes, and `logits`, f32[1, height, width, classes]. Its metadata
    names the classes, their ids and colours, and whether logits are averaged over the mirror image.

    Raises:
        ModelError: the package onnx is not installed, or the network has an operation that cannot be written.
    """
    settings = replace(model.settings, dtype="float32")  # few runtimes compute in bfloat16
    onnx = onnx_package()
    shape, classes = (1, *model.size, 3), len(model.classes)

    def logits_of(image: jax.Array) -> jax.Array:
        return apply(model.variables, image, settings, classes)

    traced = jax.make_jaxpr(logits_of)(jax.ShapeDtypeStruct(shape, np.uint8))
    graph = Graph()
    (logits,) = graph.run(traced.jaxpr, traced.consts, ["image"])
    graph.node("Identity", logits, output="logits")
    places = graph.node("ArgMax", logits, axis=3, keepdims=0)
    graph.node("Cast", places, output="labels", to=onnx.TensorProto.UINT8)
    described = onnx.helper.make_tensor_value_info
    graph_proto = onnx.helper.make_graph(
        graph.nodes,
        model.settings.net,
        [described("image", onnx.TensorProto.UINT8, shape)],
        [
            described("labels", onnx.TensorProto.UINT8, shape[:3]),
            described("logits", onnx.TensorProto.FLOAT, (*shape[:3], classes)),
        ],
        graph.constants,
    )
    opset = [onnx.helper.make_opsetid("", OPSET)]
    model_proto = onnx.helper.make_model(
        graph_proto, opset_imports=opset, ir_version=IR, producer_name="sdr-jax"
    )
    metadata = {
        "classes": json.dumps([label_class._asdict() for label_class in model.classes]),
        "padding": "the last column or row is repeated on the right or below",
        "mirror": "averaged" if model.settings.average_mirror else "not averaged",
        "model": model.digest,
    }
    onnx.helper.set_model_props(model_proto, metadata)
    onnx.checker.check_model(model_proto)
    return model_proto.SerializeToString()


class Graph:
    """Nodes and constants of a graph under construction.

    Attributes:
        nodes: ONNX nodes in order.
        constants: arrays that nodes use.
    """

    def __init__(self) -> None:
        self._onnx = onnx_package()
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._names: dict[tuple[Any, ...], str] = {}

    def constant(self, array: Any) -> str:
        """The name of an array, which is stored once."""
        array = np.asarray(array)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._names:
            self._names[key] = f"c{len(self._names)}"
            self.constants.append(self._onnx.numpy_helper.from_array(array, self._names[key]))
        return self._names[key]

    def node(self, kind: str, *inputs: Value, output: str | None = None, **attributes: Any) -> str:
        """Append a node; returns the name of its output."""
        names = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        name = output or f"v{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, names, [name], **attributes))
        return name

    def run(self, jaxpr: Any, constants: Sequence[Any], inputs: Sequence[Value]) -> list[Value]:
        """Append a traced function; returns its outputs.

        Raises:
            ModelError: an operation that no network of ours has.
        """
        values: dict[Any, Value] = dict(
            zip(jaxpr.constvars, map(np.asarray, constants), strict=True)
        )
        values |= zip(jaxpr.invars, inputs, strict=True)

        def value(variable: Any) -> Value:
            return np.asarray(variable.val) if isinstance(variable, Literal) else values[variable]

        for step in jaxpr.eqns:
            outputs = self._step(step, [value(variable) for variable in step.invars])
            values.update(zip(step.outvars, outputs, strict=True))
        return [value(variable) for variable in jaxpr.outvars]

    def _step(self, step: Any, inputs: list[Value]) -> list[Value]:
        name, params = step.primitive.name, step.params
        if name in _INNER:
            inner = params[_INNER[name]]
            constants = getattr(inner, "consts", ())
            return self.run(getattr(inner, "jaxpr", inner), constants, inputs)
        if name in (*_SAME, "optimization_barrier"):
            return inputs
        if name == "platform_index":
            return [np.int32(params["platforms"].index(None))]
        if name == "cond":
            inner = params["branches"][int(inputs[0])]
            return self.run(inner.jaxpr, inner.consts, inputs[1:])
        shape = step.outvars[0].aval.shape
        if not any(isinstance(value, str) for value in inputs):
            if name == "broadcast_in_dim":
                return [np.broadcast_to(_spread(inputs[0], params, shape), shape)]
            results = step.primitive.bind(*inputs, **params)
            return [
                np.asarray(value)
                for value in (results if step.primitive.multiple_results else [results])
            ]
        if name == "split":
            stops = np.cumsum(params["sizes"]).tolist()
            pieces = zip([0, *stops], stops, strict=False)
            return [self._cut(inputs[0], [a], [b], [params["axis"]], [1]) for a, b in pieces]
        if name in _ELEMENTWISE:
            return [self.node(_ELEMENTWISE[name], *map(_thin, inputs))]
        write: Callable[..., str] | None = getattr(self, f"_{name}", None)
        if write is None:
            raise ModelError(f"the operation {name} of this network cannot be written as ONNX")
        keywords = {**params, "shape": shape, "avals": [value.aval for value in step.invars]}
        return [write(*inputs, **keywords)]

    def _cut(self, x: Value, starts: Any, stops: Any, axes: Any, steps: Any) -> str:
        return self.node(
            "Slice", x, *(np.array(numbers, np.int64) for numbers in (starts, stops, axes, steps))
        )

    # One method for each JAX operation that needs more than a new name; keywords are its parameters.

    def _conv_general_dilated(
        self, x: Value, kernel: Value, *, shape: Any, avals: Any, **params: Any
    ) -> str:
        numbers, padding = params["dimension_numbers"], params["padding"]
        if params["batch_group_count"] != 1 or np.min(padding) < 0:
            raise ModelError("a convolution of this network has no counterpart in ONNX")
        x = self.node("Transpose", x, perm=numbers.lhs_spec)
        sizes = [avals[0].shape[axis] for axis in numbers.lhs_spec]
        for axis, times in enumerate(params["lhs_dilation"], 2):
            x, sizes = self._dilated(x, sizes, axis, times)
        result = self.node(
            "Conv",
            x,
            np.transpose(kernel, numbers.rhs_spec),
            strides=params["window_strides"],
            dilations=params["rhs_dilation"],
            group=params["feature_group_count"],
            pads=[int(p) for pads in zip(*padding, strict=True) for p in pads],
        )
        return self.node("Transpose", result, perm=np.argsort(numbers.out_spec).tolist())

    def _dilated(
        self, x: Value, sizes: list[int], axis: int, times: int
    ) -> tuple[Value, list[int]]:
        """Put zeros between the cells along an axis; return the result and its sizes."""
        if times == 1:
            return x, sizes
        before, n, behind = sizes[:axis], sizes[axis], sizes[axis + 1 :]
        x = self.node("Reshape", x, np.array([*before, n, 1, *behind], np.int64))
        pads = np.zeros(2 * (len(sizes) + 1), np.int64)
        pads[len(sizes) + 1 + axis + 1] = times - 1
        x = self.node("Pad", x, pads, np.float32(0))
        x = self.node("Reshape", x, np.array([*before, n * times, *behind], np.int64))
        end = n * times - (times - 1)
        return self._cut(x, [0], [end], [axis], [1]), [*before, end, *behind]

    def _dot_general(
        self, x: Value, y: Value, *, dimension_numbers: Any, avals: Any, **_: Any
    ) -> str:
        (of_x, of_y), (batch_x, batch_y) = dimension_numbers
        letters = iter("abcdefghijklmnopqrstuvwxyz")
        left = [next(letters) for _ in avals[0].shape]
        right = [next(letters) for _ in avals[1].shape]
        for i, j in zip((*of_x, *batch_x), (*of_y, *batch_y), strict=True):
            right[j] = left[i]
        batch = [left[i] for i in batch_x]
        free = [left[i] for i in range(len(left)) if i not in (*of_x, *batch_x)]
        free += [right[j] for j in range(len(right)) if j not in (*of_y, *batch_y)]
        if (of_x, of_y, len(left), len(right), batch) == ((1,), (0,), 2, 2, []):
            return self.node("MatMul", x, y)
        equation = f"{''.join(left)},{''.join(right)}->{''.join(batch + free)}"
        return self.node("Einsum", x, y, equation=equation)

    def _slice(
        self, x: Value, *, start_indices: Any, limit_indices: Any, strides: Any, **_: Any
    ) -> str:
        axes = list(range(len(start_indices)))
        return self._cut(x, start_indices, limit_indices, axes, strides or [1] * len(axes))

    def _rev(self, x: Value, *, dimensions: Any, **_: Any) -> str:
        count = len(dimensions)
        return self._cut(x, [-1] * count, [-(2**31)] * count, dimensions, [-1] * count)

    def _broadcast_in_dim(self, x: Value, *, shape: Any, avals: Any, **params: Any) -> str:
        thin = [1] * len(shape)
        for axis, size in zip(params["broadcast_dimensions"], avals[0].shape, strict=True):
            thin[axis] = size
        x = self.node("Reshape", x, np.array(thin, np.int64))
        return x if tuple(thin) == shape else self.node("Expand", x, np.array(shape, np.int64))

    def _reshape(self, x: Value, *, shape: Any, **_: Any) -> str:
        return self.node("Reshape", x, np.array(shape, np.int64))

    _squeeze = _reshape

    def _transpose(self, x: Value, *, permutation: Any, **_: Any) -> str:
        return self.node("Transpose", x, perm=permutation)

    def _concatenate(self, *parts: Value, dimension: int, **_: Any) -> str:
        return self.node("Concat", *parts, axis=dimension)

    def _pad(self, x: Value, filling: Value, *, padding_config: Any, **_: Any) -> str:
        low, high, between = np.array(padding_config, np.int64).T
        if min(*low, *high) < 0 or between.any():
            raise ModelError("a padding of this network has no counterpart in ONNX")
        return self.node("Pad", x, np.concatenate([low, high]), filling)

    def _reduce_sum(self, x: Value, *, axes: Any, **_: Any) -> str:
        return self.node("ReduceSum", x, np.array(axes, np.int64), keepdims=0)

    def _reduce_max(self, x: Value, *, axes: Any, **_: Any) -> str:
        return self.node("ReduceMax", x, np.array(axes, np.int64), keepdims=0)

    def _convert_element_type(self, x: Value, *, new_dtype: Any, avals: Any, **_: Any) -> str:
        if np.dtype(new_dtype) == avals[0].dtype:
            return x
        return self.node(
            "Cast", x, to=self._onnx.helper.np_dtype_to_tensor_dtype(np.dtype(new_dtype))
        )

    def _select_n(self, which: Value, first: Value, second: Value, **_: Any) -> str:
        return self.node("Where", which, second, first)

    def _integer_pow(self, x: Value, *, y: int, avals: Any, **_: Any) -> str:
        return self.node("Pow", x, np.array(y, avals[0].dtype))

    def _square(self, x: Value, **_: Any) -> str:
        return self.node("Mul", x, x)

    def _erfc(self, x: Value, **_: Any) -> str:
        return self.node("Sub", np.float32(1), self.node("Erf", x))

    def _rsqrt(self, x: Value, **_: Any) -> str:
        return self.node("Reciprocal", self.node("Sqrt", x))


def _spread(x: np.ndarray, params: Any, shape: Sequence[int]) -> np.ndarray:
    """A constant with axes of length 1 where it is to be repeated."""
    thin = [1] * len(shape)
    for axis, size in zip(params["broadcast_dimensions"], x.shape, strict=True):
        thin[axis] = size
    return np.asarray(x).reshape(thin)


def _thin(value: Value) -> Value:
    """A repeated constant in its shape before, since nodes with two inputs repeat it themselves."""
    if isinstance(value, str) or value.ndim == 0 or math.prod(value.shape) == 0:
        return value
    return value[tuple(slice(0, 1) if s == 0 else slice(None) for s in value.strides)]
