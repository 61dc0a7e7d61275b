"""The short form of `writers`."""

import pytest

from benchmarks.endurance.writers import run


@pytest.mark.slow
def test_what_several_processes_write_at_once_is_all_there(tmp_path):
    tally = run(1, 3, 4, tmp_path)
    assert not tally.failures, tally.problems
    assert tally.cases_saved == 3 * 4 + 1
    assert tally.reads
