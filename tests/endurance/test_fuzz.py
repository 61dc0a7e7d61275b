"""Mutated files for every reader: a value or one line, never anything else. `tests.endurance.fuzz` does more."""

import pytest

from tests.endurance.fuzz import fuzz_all, tasks_of
from tests.endurance.readers import readers


def failures(names, count, hostile):
    return {t.reader: t.failures for t in fuzz_all(tasks_of(count, 3, names, hostile)) if not t.clean}


@pytest.mark.slow
def test_no_reader_breaks_on_mutated_files():
    assert failures([one.name for one in readers().values() if one.cost == 1], 15, hostile=False) == {}


@pytest.mark.slow
def test_no_reader_breaks_on_many_mutated_and_hostile_files():
    assert failures(list(readers()), 2000, hostile=True) == {}
