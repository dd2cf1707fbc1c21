"""Bounds of fields: which values they allow, and the name of the field that is out of bounds."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import pytest

from common.bounds import DISTINCT, POSITIVE, at_least, at_most, check_bounds, within
from common.errors import UserError


@dataclass(frozen=True)
class Inner:
    head_width: Annotated[int, at_least(1)] = 1
    words: str = ""


@dataclass(frozen=True)
class Outer:
    seed: Annotated[int, at_least(0), at_most(9)] = 0
    own_share: Annotated[float | None, within(0, 1, "(]")] = None
    counts: Annotated[tuple[int, ...] | None, at_least(1), DISTINCT] = None
    net: Inner = field(default_factory=Inner)
    dtype: Literal["float32", "bfloat16"] = "float32"
    mirror: bool = True
    rate: float = 0.5
    candidates: tuple[Literal["argmax", "broad"], ...] = ("argmax",)
    grid: tuple[int, int] | None = None


@pytest.mark.parametrize(("bound", "inside", "outside", "be"), [
    (at_least(1), (1, 1.5, 10**400), (0, -1, math.inf, math.nan), "be 1 or more"),
    (at_most(3), (3, -math.inf), (4, math.inf, math.nan), "be 3 or less"),
    (POSITIVE, (1e-300, 10**400), (0, -1, math.inf, math.nan), "be positive"),
    (within(0, 1), (0, 1), (-0.1, 1.1, math.nan), r"lie in \[0, 1\]"),
    (within(0, 1, "()"), (0.5,), (0, 1, math.nan), r"lie in \(0, 1\)"),
    (within(0, 1, "(]"), (0.5, 1), (0, 1.1), r"lie in \(0, 1\]"),
    (within(0, 1, "[)"), (0, 0.5), (-0.1, 1), r"lie in \[0, 1\)"),
])  # fmt: skip
def test_a_bound_takes_what_is_inside_and_says_what_the_others_must_be(bound, inside, outside, be):
    bound.refuse("--x", inside)
    for number in outside:
        with pytest.raises(UserError, match=f"^--x must {be}, not {number}$"):
            bound.refuse("--x", number)
        with pytest.raises(UserError, match=f"not {number}$"):
            bound.refuse("--x", (*inside, number))


@pytest.mark.parametrize(("wrong", "flag", "name"), [
    (Outer(seed=-1), "--seed must be 0 or more, not -1", "seed"),
    (Outer(seed=10), "--seed must be 9 or less, not 10", "seed"),
    (Outer(own_share=0.0), "--own-share must lie in (0, 1], not 0.0", "own_share"),
    (Outer(counts=(2, 0)), "--counts must be 1 or more, not 0", "counts"),
    (Outer(counts=()), "--counts needs at least one value", "counts"),
    (Outer(counts=(2, 2)), "--counts 2 2 has a value twice", "counts"),
    (Outer(dtype="float16"), "--dtype must be one of float32, bfloat16, not float16", "dtype"),
    (Outer(dtype=None), "--dtype must be one of float32, bfloat16, not None", "dtype"),
    (Outer(mirror="no"), "--mirror must be True or False, not 'no'", "mirror"),
    (Outer(mirror=1), "--mirror must be True or False, not 1", "mirror"),
    (Outer(seed=1.5), "--seed must be a whole number, not 1.5", "seed"),
    (Outer(seed=True), "--seed must be a whole number, not True", "seed"),
    (Outer(seed=None), "--seed must be a whole number, not None", "seed"),
    (Outer(rate="high"), "--rate must be a number, not 'high'", "rate"),
    (Outer(own_share="x"), "--own-share must be a number or None, not 'x'", "own_share"),
    (Outer(candidates=("x",)), "--candidates must be a tuple, each one of argmax, broad, not ('x',)",
     "candidates"),
    (Outer(grid=(1, 2, 3)), "--grid must be a tuple, each a whole number or None, not (1, 2, 3)", "grid"),
    (Outer(net=Inner(words=5)), "--net.words must be text, not 5", "net.words"),
    (Outer(net=Inner(0)), "--net.head-width must be 1 or more, not 0", "net.head_width"),
])  # fmt: skip
def test_the_field_is_named_as_a_flag_or_as_python_has_it(wrong, flag, name):
    with pytest.raises(UserError) as caught:
        check_bounds(wrong, "--")
    assert str(caught.value) == flag
    with pytest.raises(UserError) as caught:
        check_bounds(wrong)
    assert str(caught.value).split()[0] == name


def test_what_is_within_its_bounds_passes_and_none_is_never_asked():
    check_bounds(Outer())
    check_bounds(Outer(9, 1.0, (1, 2), Inner(7)))
    check_bounds(
        Outer(np.int32(9), 1, None, Inner(7), "bfloat16", False, np.float32(1), grid=(1, 2))
    )
