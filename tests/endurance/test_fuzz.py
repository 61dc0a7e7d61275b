"""Hostile and mutated files for every reader: a value or one line, never anything else. `fuzz` does more."""

import pytest

from benchmarks.endurance.fuzz import TOO_SLOW, fuzz_all, tasks_of


@pytest.mark.slow
def test_no_reader_breaks_on_hostile_and_mutated_files():
    """How long an input takes is judged by the program alone, which has a machine of its own."""
    failures = {tally.reader: tally.failures.keys() - {TOO_SLOW} for tally in fuzz_all(tasks_of(30, seed=3))}
    assert {reader: failed for reader, failed in failures.items() if failed} == {}
