"""Where the command line names suites and no tests, the suites are what is run: not the project's own tests too.

These may need packages that the suites do not, and whoever asks for a suite wants no hour of other tests.
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
    """While pytest loads the first `conftest.py` files: those from here upwards hold, those of test folders do not."""
    if not suites_alone(config):
        yield
        return
    known, here = config.known_args_namespace, config.invocation_params.dir
    above = [folder for folder in (here, *here.parents) if folder.is_relative_to(config.rootpath)]
    nearest = next((file for folder in above if (file := folder / "conftest.py").is_file()), None)
    was = known.noconftest
    # pytest looks into testpaths and folders named test* unless a file is named
    known.file_or_dir, known.noconftest = [str(nearest)] if nearest else [], was or nearest is None
    try:
        yield
    finally:
        known.file_or_dir, known.noconftest = [], was
