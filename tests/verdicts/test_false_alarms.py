"""How often the careful driver sees a danger in ordinary traffic, where nothing happens."""

import numpy as np
import pytest

from regents_cosim.cases.shipped import network
from regents_cosim.sources.record import record
from regents_cosim.verdicts.careful.careful_driver import perceives
from regents_cosim.verdicts.careful.ego_path import ego_path
from regents_cosim.verdicts.careful.foresight import all_risks

MOST = 0.15


def sees_a_danger(window):
    others = list(range(1, len(window.agents)))
    risks = all_risks(window, ego_path(window), others, window.tracks.steps)
    return any(perceives(risk, window.dt) is not None for risk in risks)


@pytest.mark.slow
def test_hard_braking_in_ordinary_traffic_is_rare():
    """In unselected windows; the standard suite's are selected for conflicts."""
    places = ("crossing", "grid", "signals")
    windows = [one for place in places for one in record(network(place), count=12, seed=0, prefer="none")]
    assert np.mean([sees_a_danger(window) for window in windows]) <= MOST
