"""Runs only the suites where the command line names suites and no tests, and not the project's own tests.

The project's tests may need other packages, and may take long.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


def suites_alone(config: pytest.Config) -> bool:
    """Whether the command line names suites and nothing else."""
    known = config.known_args_namespace
    return bool(known.regents_suite) and not known.file_or_dir


@contextmanager
def conftests_of_tests_left_out(config: pytest.Config) -> Iterator[None]:
    """While pytest loads the first `conftest.py` files, skip those of test folders; those from here upwards apply."""
    if not suites_alone(config):
        yield
        return
    known, here = config.known_args_namespace, config.invocation_params.dir
    above = [folder for folder in (here, *here.parents) if folder.is_relative_to(config.rootpath)]
    nearest = next((file for folder in above if (file := folder / "conftest.py").is_file()), None)
    was = known.noconftest
    # pytest loads those of testpaths and of folders named test* unless a file is named
    known.file_or_dir, known.noconftest = [str(nearest)] if nearest else [], was or nearest is None
    try:
        yield
    finally:
        known.file_or_dir, known.noconftest = [], was
