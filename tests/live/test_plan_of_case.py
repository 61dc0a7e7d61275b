"""The drive of a recorded adversary as a plan to begin with."""

import numpy as np
import pytest
from shipped_cases import crash_on

from regents_cosim.cases.files import load_case
from regents_cosim.errors import RegentsError
from regents_cosim.live.search.plan import plan_of_case


def test_it_is_where_the_case_has_it_and_meets_the_ego_when_that_does():
    case = load_case(crash_on("crossing"))
    plan = plan_of_case(case, 40.0)
    hit = case.collision
    row = case.index(plan.adversary)
    there = np.flatnonzero(case.tracks.valid[row])
    placed = np.array([plan.at(40.0 + step * case.dt) for step in there])
    recorded = np.stack([getattr(case.tracks, name)[row, there] for name in ("x", "y", "yaw", "speed")], axis=1)
    assert plan.adversary == hit.agent
    assert plan.meets_s == pytest.approx(40.0 + hit.time_s)
    assert np.allclose(placed, recorded, atol=1e-9)


def test_a_case_without_a_crash_has_none():
    case = load_case(crash_on("crossing")).before_attack()
    with pytest.raises(RegentsError, match="no crash"):
        plan_of_case(case, 0.0)
