"""The short form of `places`."""

import pytest

from benchmarks.endurance.places import run


@pytest.mark.slow
def test_a_few_of_all_places_kinds_and_deeds(tmp_path):
    tally = run(60, 0, tmp_path)
    assert not tally.problems
    assert tally.tried
