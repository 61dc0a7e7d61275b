"""Planners of other packages, in environments that have them: name the interpreters to run these tests.

python -m venv other && other/bin/pip install commonroad-reactive-planner msgspec shapely jaxtyping
REGENTS_REACTIVE_PLANNER=other/bin/python pytest -m slow tests/planners/test_adapters.py

`commonroad-idm-planner` and `fiss-planner` go by the names in `ADAPTERS`, and may share one environment.
"""

import os

import numpy as np
import pytest
from commonroad.scenario.state import CustomState
from scenes import platoon

from regents_cosim import evaluate, record
from regents_cosim.planners.adapters.commonroad import CommonRoadPlanner
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Scene, Snapshot
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.routes.route import route_of

ADAPTERS = {  # the variable that names an interpreter, and the least completion of its planner
    "reactive_planner:ReactivePlanner": ("REGENTS_REACTIVE_PLANNER", 0.9),
    "idm:IdmPlanner": ("REGENTS_IDM_PLANNER", 0.5),  # by its own settings it accelerates slowly
    "fiss:FissPlanner": ("REGENTS_FISS_PLANNER", 0.5),
    "frenetix:Frenetix": ("REGENTS_FRENETIX", 0.9),
}


@pytest.mark.slow
@pytest.mark.parametrize("net", ["crossing", "signals", "merge"])
@pytest.mark.parametrize("adapter", ADAPTERS)
def test_the_planner_of_another_package_drives_ordinary_traffic_to_its_end(adapter, net):
    variable, least = ADAPTERS[adapter]
    python = os.environ.get(variable) or pytest.skip(f"{variable} names no interpreter")
    name = f"python:{python}:regents_cosim.planners.adapters.{adapter}"
    windows = record(f"shipped:{net}", count=8, seed=3, ego_kind="car", progress=False)
    # An ego that stands at first, as before a red light, has too little time left to reach the end at its own pace.
    drives = evaluate([one for one in windows if one.tracks.speed[0, 0] > 3.0][:2], name).drives
    assert drives
    assert not any(drive.error for drive in drives)
    assert all(drive.completion > least for drive in drives)
    assert not any(drive.red_lights for drive in drives)


@pytest.mark.slow
def test_the_reactive_planner_takes_a_route_whose_heading_passes_a_full_turn():
    python = os.environ.get("REGENTS_REACTIVE_PLANNER") or pytest.skip("REGENTS_REACTIVE_PLANNER names no interpreter")
    windows = record("shipped:roundabout", count=10, seed=71909, prefer="none", progress=False)
    turning = [one for one in windows if np.unwrap(route_of(one).yaw).max() > 2.0 * np.pi]
    name = f"python:{python}:regents_cosim.planners.adapters.reactive_planner:ReactivePlanner"
    drives = evaluate(turning[:1], name).drives
    assert [drive.error for drive in drives] == [""]


@pytest.mark.slow
@pytest.mark.parametrize("adapter", ADAPTERS)
def test_the_planner_of_another_package_tells_which_path_it_takes(adapter):
    python = os.environ.get(ADAPTERS[adapter][0]) or pytest.skip(f"{ADAPTERS[adapter][0]} names no interpreter")
    case = record("shipped:crossing", count=1, seed=3, ego_kind="car", progress=False)[0]
    host = HostProcess("it", planner=f"python:{python}:regents_cosim.planners.adapters.{adapter}")
    try:
        host.reset([Scene.of(case, 6.0, 0.3)])
        tracks = case.tracks
        seen = Snapshot(*(v[:, 0] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid)))
        (answer,) = host.act(0, [seen], debug=True)
    finally:
        host.close()
    told = answer.decision.debug
    assert len(told.chosen) > 1
    assert len(told.candidates) == len(told.costs)
    assert bool(len(told.candidates)) == (adapter != "idm:IdmPlanner"), "which weighs none"


class Diverges(CommonRoadPlanner):
    """Plans a speed that is no number from the second step on."""

    told = ""

    def plan(self, observation):
        speeds = observation.ego.speed, observation.ego.speed, np.nan, np.nan
        return [CustomState(time_step=step, velocity=speed) for step, speed in enumerate(speeds)]

    def act(self, observation):
        control = super().act(observation)
        Diverges.told = control.debug.text
        return control


def test_a_planner_of_the_family_brakes_where_its_speed_is_no_number():
    planner = PlannerUnderTest.of(Diverges(), own_process=False)
    (drive,) = evaluate([platoon()], planner).drives
    assert drive.error == ""
    assert drive.completion < 0.9
    assert Diverges.told == "from step 2 on its speed or place is not finite, there it brakes"
