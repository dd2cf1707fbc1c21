"""Fixtures of the tests of jobs, for scripts that start them."""

from tests.experiments.conftest import error_line, learnt_file  # noqa: F401
