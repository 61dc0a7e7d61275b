"""What a crash of a live attack looks like as a case."""

from pathlib import Path

import numpy as np
from shapely import box

from regents_cosim.cases.suite import load_suite
from regents_cosim.live.attacker import Attack
from regents_cosim.live.case_keeper import CaseKeeper
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.windows import RecordingOrigin

ROAD = RoadMap((Lane("a_0", np.array([[0.0, 0.0], [200.0, 0.0]]), 3.2, 14.0),), (), box(-10.0, -10.0, 210.0, 10.0))
CAR = VehicleType("car", 4.7, 1.8)


def frame(step, begin_m=20.0):
    x, y = begin_m + 1.0 * step, max(3.0 - 0.1 * step, 1.0)
    return Frame(0.1 * step, ("ego", "other"), np.array([x, x]), np.array([0.0, y]), np.zeros(2),
                 np.array([10.0, 10.0]), np.zeros(2), (CAR, CAR), {})  # fmt: skip


def test_a_crash_is_a_judged_case_that_goes_on_as_foretold(tmp_path, monkeypatch):
    x = np.stack([20.0 + np.arange(71.0)] * 2)
    y, zero = np.repeat([[0.0], [3.0]], 71, axis=1), np.zeros((2, 71))
    tracks = Tracks(x, y, zero, zero + 10.0, np.ones((2, 71), bool), z=zero)
    before = Forecast(0.0, 0.1, ("ego", "other"), tracks)
    crash = Attack(Plan("other", 0.0, x[1], y[1], zero[1], zero[1] + 10.0, meets_s=3.0), None, 0.0, before)
    monkeypatch.chdir(tmp_path)
    keeper = CaseKeeper(LiveSettings(), "idm", live_config("focused-live"), Path("suite"))
    monkeypatch.chdir("/")  # as programs do
    frames = [frame(step) for step in range(15)]
    source = RecordingOrigin("sumo", "x", "")
    name = keeper.keep(frames, 0.1, ROAD, source, crash, before)
    (case,) = load_suite(tmp_path / "suite")
    assert case.id == name
    assert case.attack.method == "focused-live"
    assert (case.attack.outcome, case.collision.agent) == ("collision", "other")
    assert case.judgement is not None
    assert case.tracks.steps == len(frames) + 20
    assert case.log.y[1, 14] == 3.0
    again = keeper.keep(frames, 0.1, ROAD, RecordingOrigin("sumo", "x", ""), crash, before)
    other = keeper.keep(
        [frame(step, 21.0) for step in range(15)], 0.1, ROAD, RecordingOrigin("sumo", "x", ""), crash, before
    )
    assert (again, other) == (name, f"{name}-2")  # no crash replaces another
    assert [case.id for case in load_suite(tmp_path / "suite")] == [name, other]
