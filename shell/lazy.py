"""Imports public names of a package on first use, from the table in its ``__init__.pyi``.

The stub tells type checkers the names and their modules; here it tells the import system the same.
"""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


class _Lazy(ModuleType):
    """A package that imports a public name on first use."""

    _homes: dict[str, str]  # name to module

    def __getattr__(self, name: str) -> Any:
        if name not in self.__dict__.get("_homes", ()):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(import_module(self._homes[name]), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Python binds a module to its package once it is loaded. If a function has the name of its
        # module (`sdr_jax.sdr`), the package offers the function, whatever is imported first.
        if not (isinstance(value, ModuleType) and name in self._homes):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        special = (name for name in super().__dir__() if name.startswith("__"))
        return sorted({*special, *self._homes})  # what is public


def import_on_use(package: str) -> list[str]:
    """Make a package import the names in its ``__init__.pyi`` on first use.

    Args:
        package: the name of the package, which is being imported.

    Returns:
        The sorted names for ``__all__``.
    """
    module = sys.modules[package]
    assert module.__file__ is not None
    tree = ast.parse(Path(module.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: node.module for node in imports for alias in node.names}
    module.__dict__["_homes"] = homes
    module.__class__ = _Lazy
    return sorted(homes)
