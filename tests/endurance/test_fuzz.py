"""Mutated files for every reader: a value or one line, never anything else. `fuzz` does more, and hostile files."""

import pytest

from tests.endurance.fuzz import fuzz_all, tasks_of
from tests.endurance.readers import readers


@pytest.mark.slow
def test_no_reader_breaks_on_mutated_files():
    quick = [one.name for one in readers().values() if one.cost == 1]
    assert {t.reader: t.failures for t in fuzz_all(tasks_of(15, 3, quick, hostile=False)) if not t.clean} == {}
