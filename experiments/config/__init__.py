"""The configuration of a job: its fields, defaults by target and preset, checks, and command line.

Names are imported on first use, so that help texts load no net and no search; ``__init__.pyi`` lists them.
"""

from shell.lazy import import_on_use

__all__ = import_on_use(__name__)
