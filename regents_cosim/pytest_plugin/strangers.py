"""Keeps pytest from running or obeying code of strangers around a suite.

A suite may come in an archive, with a `conftest.py` beside it. The user's own folders are the one in which pytest was
started, those of the tests that are named, and their parents; if an ini file names the suites, also the folders that
contain them. Where the command line names suites and no tests, only the suites run, for the project's own tests may
need other packages, and may take long.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from regents_cosim.cases.suite_code import code_for_pytest, run_by_pytest
from regents_cosim.pytest_plugin.settings import suites

_NODE = "::"  # separates a file from a test in it


def named_paths(config: pytest.Config, arguments: list[str]) -> list[Path]:
    """The files and folders of the tests that are named."""
    return [Path(config.invocation_params.dir, word.partition(_NODE)[0]).resolve() for word in arguments]


def require_no_strangers_code(config: pytest.Config) -> None:
    """Raise UsageError, before any test code has run, if pytest would run or obey code that may be a stranger's."""
    named = suites(config)
    for suite in named:
        if found := code_for_pytest(suite):
            raise pytest.UsageError(
                f"{suite} holds {', '.join(found)}, which pytest would run or obey: remove it, or start pytest in the "
                "suite's own folder if it is yours"
            )
    known = config.known_args_namespace
    given = [way for suite in named for way in {suite.resolve(), Path(os.path.abspath(suite))}]  # with links
    if not known.regents_suite:
        return
    tests = named_paths(config, known.file_or_dir)
    own = _Own(config.invocation_params.dir.resolve(), [one for one in tests if not _lies_in(one, given)])
    ini = config.inipath
    if ini is not None and not known.inifilename and not own.has(ini.parent) and _lies_in_line(ini.parent, given):
        raise pytest.UsageError(
            f"{ini} is not one of your files, but pytest would obey it: write --regents-suite=FOLDER"
        )
    for suite in given:
        ways = [folder for folder in suite.parents if not own.has(folder)]  # from the suite upwards
        code = _gone_through(suite, ways, tests)
        if code is not None:
            raise pytest.UsageError(
                f"{code} lies beside a suite, and pytest would run it: move the suite elsewhere, or name the folder of "
                "your tests as well if it is yours"
            )


class _Own:
    def __init__(self, here: Path, tests: list[Path]) -> None:
        self._above = {*tests, *(folder for place in (here / "_", *tests) for folder in place.parents)}
        self._tests = tests

    def has(self, folder: Path) -> bool:
        return folder in self._above or _lies_in(folder, self._tests)


def _gone_through(suite: Path, ways: list[Path], tests: list[Path]) -> Path | None:
    """Code that pytest would run on its way to a case of a named suite; None where there is none."""
    if not any(test.is_relative_to(suite) for test in tests):
        return None
    return next((folder / name for folder in ways for name in run_by_pytest(folder)), None)


def _lies_in(path: Path, folders: list[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def _lies_in_line(path: Path, suites: list[Path]) -> bool:
    return any(path.is_relative_to(suite) or suite.is_relative_to(path) for suite in suites)


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
