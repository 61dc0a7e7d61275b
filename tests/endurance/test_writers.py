"""The short form of `writers`."""

import pytest

from tests.endurance.writers import run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rounds", "writers", "adds"), [(1, 3, 4), pytest.param(10, 4, 25, marks=pytest.mark.slow, id="long")]
)
def test_what_several_processes_write_at_once_is_all_there(rounds, writers, adds, tmp_path):
    tally = run(rounds, writers, adds, tmp_path)
    assert not tally.failures, tally.problems
    assert tally.cases_saved == rounds * (writers * adds + 1)
    assert tally.reads
