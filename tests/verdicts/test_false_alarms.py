"""How often the reference drivers brake hard in ordinary traffic, where nothing happens."""

import numpy as np
import pytest

from regents_cosim.cases.shipped import network
from regents_cosim.sources.record import record
from regents_cosim.verdicts.careful.ego_path import ego_path
from regents_cosim.verdicts.careful.foresight import all_risks
from regents_cosim.verdicts.careful.reference_drivers import SAFETY_MODELS, braked_by, perceives

MOST = {"careful": 0.15, "fuzzy": 0.1, "rss": 0.35}


def ordinary(places):
    """Unselected windows; the standard suite's are selected for conflicts."""
    return [one for place in places for one in record(network(place), count=12, seed=0, prefer="none")]


def brakes_hard(window):
    """The drivers that brake for any agent with more than 4 m/s^2 and harder than the ego did."""
    path, others, steps = ego_path(window), range(1, len(window.agents)), window.tracks.steps
    risks = all_risks(window, path, list(others), steps)
    found = {"careful"} if any(perceives(risk, window.dt) is not None for risk in risks) else set()
    own = -np.diff(window.tracks.speed[0]) / window.dt
    for model in SAFETY_MODELS:
        for agent in others:
            braked = -np.diff(braked_by(model, window, path, agent, steps).speed[:steps]) / window.dt
            if ((braked > 4.0) & (braked > own + 0.1)).any():
                found.add(model.driver)
    return found


@pytest.mark.slow
def test_hard_braking_in_ordinary_traffic_is_rare():
    windows = ordinary(("crossing", "grid", "signals"))
    found = [brakes_hard(window) for window in windows]
    for driver, most in MOST.items():
        share = np.mean([driver in hard for hard in found])
        assert share <= most, (driver, share, len(windows))
