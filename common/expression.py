"""Refuse regular expressions in a user's file that may search a name for hours."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

LONGEST = 255
"""The most characters of a file's name."""
MOST_WAYS = 64 * (LONGEST + 1) ** 4
"""The most ways to match: four repetitions such as ``.*``, and a few optional parts."""


def expression_fault(expression: str) -> str:
    """Describe what is wrong with a regular expression; empty if nothing is.

    Python searches by trying all ways to match, and ``^(a+)+$`` has 2^n ways in n characters.
    """
    try:
        re.compile(expression)
        ways = _ways(re._parser.parse(expression))  # type: ignore[attr-defined]
    except (re.error, OverflowError, RecursionError) as error:
        return f"is not a regular expression: {error}"
    if ways > MOST_WAYS:
        return (
            "may search for hours; expected no repetition inside a repetition such as (a+)+, and at "
            "most four such as .* or \\d+"
        )
    return ""


def _ways(parts: Iterable[tuple[Any, Any]]) -> float:
    """Bound the number of ways through an expression from one start, as `re` parses it."""
    return math.prod(_ways_of(str(operator), value) for operator, value in parts)


def _ways_of(operator: str, value: Any) -> float:
    if operator == "BRANCH":
        return sum(map(_ways, value[1]))
    if operator == "SUBPATTERN":
        return _ways(value[-1])
    if operator in ("ASSERT", "ASSERT_NOT"):
        return _ways(value[1])
    if operator == "ATOMIC_GROUP":
        return _ways(value)
    if operator == "GROUPREF_EXISTS":
        return sum(_ways(part) for part in value[1:] if part)
    if operator.endswith("REPEAT"):
        least, most, inner = value
        most = min(most, LONGEST)
        ways = _ways(inner)
        if ways > 1:  # 64 repetitions of two ways are too many already
            return min(ways, 1e4) ** min(most, 64) + (least < most)
        return max(most - least, 0) + 1.0
    return 1.0
