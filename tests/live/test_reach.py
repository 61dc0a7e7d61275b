"""Whether a vehicle could meet the ego, asked before its drives are looked for."""

import pytest
from shipped_cases import shipped_windows

from regents_cosim.attacks.starts import starts
from regents_cosim.live.reach import could_meet
from regents_cosim.verdicts.ordinary import ordinary

EARLIEST_S = 1.5


@pytest.mark.slow
@pytest.mark.parametrize("network", ["crossing", "grid", "merge"])
def test_none_that_has_a_drive_is_left_out(network):
    said = []
    for window in shipped_windows(network)[:2]:
        ego = window.tracks  # of which the ego is the first
        limits = ordinary(window, "vehicle")
        for agent in range(1, len(window.agents)):
            could = could_meet(window, agent, ego, EARLIEST_S, limits)
            assert could or not starts(window, agent, ego, 1, limits)
            said.append(could)
    assert True in said
    assert False in said
