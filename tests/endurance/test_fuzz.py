"""Hostile and mutated files for every reader: a value or one line, never anything else. `fuzz` does more."""

import pytest

from benchmarks.endurance.fuzz import fuzz_all, tasks_of


@pytest.mark.slow
def test_no_reader_breaks_on_hostile_and_mutated_files():
    assert {t.reader: t.failures for t in fuzz_all(tasks_of(40, seed=3)) if not t.clean} == {}
