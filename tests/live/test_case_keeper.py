"""Which attacks become cases, and what a near miss looks like as one."""

import numpy as np
import pytest
from shapely import box

from regents_cosim.cases.suite import load_suite
from regents_cosim.live.attacker import Attack
from regents_cosim.live.case_keeper import CaseKeeper
from regents_cosim.live.host.frame import Frame
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.scenario import Tracks
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.windows import RecordingOrigin

ROAD = RoadMap((Lane("a_0", np.array([[0.0, 0.0], [200.0, 0.0]]), 3.2, 14.0),), (), box(-10.0, -10.0, 210.0, 10.0))
CAR = VehicleType("car", 4.7, 1.8)


def frame(step):
    x = 20.0 + 1.0 * step
    return Frame(0.1 * step, ("ego", "other"), np.array([x, x]), np.array([0.0, 3.0]), np.zeros(2),
                 np.array([10.0, 10.0]), np.zeros(2), (CAR, CAR), {})  # fmt: skip


def attack(closest_m):
    x = np.stack([20.0 + np.arange(51.0)] * 2)
    y, zero = np.repeat([[0.0], [3.0]], 51, axis=1), np.zeros((2, 51))
    tracks = Tracks(x, y, zero, zero + 10.0, np.ones((2, 51), bool), z=zero)
    plan = Plan("other", 0.0, x[1], y[1], zero[1], zero[1] + 10.0, meets_s=3.0)
    made = Attack(plan, None, 0.0, Forecast(0.0, 0.1, ("ego", "other"), tracks))
    made.closest_m = closest_m
    return made


@pytest.mark.parametrize(("keep", "closest_m", "outcome", "wanted"), [
    ("crashes", 0.0, "collision", True), ("crashes", 0.5, "no_collision", False),
    ("near-misses", 0.5, "no_collision", True), ("near-misses", 2.5, "no_collision", False),
])  # fmt: skip
def test_crashes_are_kept_and_near_misses_where_they_are_asked_for(keep, closest_m, outcome, wanted):
    keeper = CaseKeeper(LiveSettings(keep=keep), "idm", live_config("focused-live"), None)
    assert keeper.wants(attack(closest_m), outcome) == wanted


def test_a_near_miss_is_a_case_without_a_collision_that_ends_where_it_ended(tmp_path):
    missed = attack(1.2)
    keeper = CaseKeeper(LiveSettings(keep="near-misses"), "idm", live_config("focused-live"), tmp_path / "suite")
    frames = [frame(step) for step in range(41)]
    name = keeper.keep(frames, 0.1, ROAD, RecordingOrigin("sumo", "x", ""), missed, "no_collision", missed.before)
    (case,) = load_suite(tmp_path / "suite")
    assert case.id == name
    assert case.attack.method == "focused-live"
    assert case.attack.outcome == "no_collision"
    assert case.attack.collision is None
    assert case.judgement is None
    assert case.tracks.steps == len(frames)
