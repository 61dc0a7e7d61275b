"""SUMO's own driver as the planner under test."""

from dataclasses import replace

import numpy as np
import pytest
from bridged_drives import bridged_drive
from scenes import platoon
from shipped_cases import shipped_window, shipped_windows

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import DriveError, PlannerError
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Signal


@pytest.fixture(scope="module")
def sumo():
    process = HostProcess("sumo")
    yield process
    process.close()


@pytest.mark.parametrize("name", ["grid", "merge", "roundabout", "signals"])
def test_in_ordinary_traffic_it_comes_to_its_target_without_a_contact(sumo, name):
    case = shipped_window(name)
    tracks, ego = case.tracks, dict(zip(("x", "y", "yaw", "speed"), bridged_drive(sumo, case), strict=True))
    driven = {name: np.concatenate([own[None], getattr(tracks, name)[1:]]) for name, own in ego.items()}
    assert first_contact(case.agents, replace(tracks, **driven, accel=None, curvature=None)) is None
    assert np.hypot(ego["x"] - case.target[0], ego["y"] - case.target[1]).min() < 4.0  # it may keep to the lane beside
    went = np.hypot(np.diff(ego["x"]), np.diff(ego["y"])) / case.dt
    assert went == pytest.approx(ego["speed"][1:], abs=0.5)


def test_every_drive_is_the_same(sumo):
    case = shipped_window("roundabout")
    first = bridged_drive(sumo, case)
    bridged_drive(sumo, shipped_window("grid"))
    np.testing.assert_array_equal(bridged_drive(sumo, case), first)


def only(case, *rows, x, y, speed):
    """The agents `rows` of a case, all going straight east from x, y [agent] at `speed` [agent]."""
    columns = [np.asarray(values, float)[:, None] for values in (x, y, speed)]
    time = case.dt * np.arange(case.tracks.steps)
    zero = np.zeros((len(rows), len(time)))
    tracks = replace(
        case.tracks,
        x=columns[0] + columns[2] * time,
        y=columns[1] + zero,
        yaw=zero,
        speed=columns[2] + zero,
        valid=zero == 0.0,
        z=zero,
        accel=None,
        curvature=None,
    )
    return replace(case, agents=tuple(case.agents[row] for row in rows), tracks=tracks, signals=())


def test_a_lane_change_takes_its_time(sumo):
    """Behind a slow car SUMO changes lanes in one step; the ego needs three seconds."""
    case = shipped_window("multilane")
    _, y0 = case.road.lane["main_0"].centre[0]
    alone = only(case, 0, 1, x=[30.0, 90.0], y=[y0, y0], speed=[20.0, 8.0])
    x, y, yaw, _ = bridged_drive(sumo, alone)
    assert y[-1] - y0 == pytest.approx(case.road.lane["main_0"].width, abs=0.3)
    assert np.abs(np.diff(y)).max() < 0.2
    across = np.flatnonzero((y > y0 + 0.1) & (y < y[-1] - 0.1))
    assert 20 <= len(across) <= 40
    heading = np.arctan2(np.diff(y), np.diff(x))
    assert heading == pytest.approx(yaw[1:], abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("letter", "stops"), [("r", True), ("G", False)])
def test_it_stops_at_a_red_light(sumo, letter, stops):
    westward = (case for case in shipped_windows("signals") if case.agents[0].id.startswith("east_in.west_out"))
    case = next(westward)  # the light is at x = 16
    alone = only(case, 0, x=[100.0], y=[case.tracks.y[0, 0]], speed=[10.0])
    lights = tuple(Signal(light.id, ((0, letter * len(light.letters(0))),)) for light in case.signals)
    x, _, _, speed = bridged_drive(sumo, replace(alone, signals=lights))
    assert (speed[-1] < 1.0) == (x[-1] > 16.0) == stops


@pytest.mark.slow
def test_a_map_that_is_not_sumo_s(sumo):
    with pytest.raises(DriveError, match="needs a case recorded in SUMO"):
        bridged_drive(sumo, platoon())


@pytest.mark.slow
def test_a_name_too_long():
    with pytest.raises(PlannerError, match="expected `sumo`"):
        PlannerUnderTest.of("sumo:fast")


@pytest.mark.slow
def test_an_attack_runs_to_an_outcome():
    config = REGENTS.but(iterations=20)
    (attacked,) = attack([shipped_window("merge")], config, "sumo")
    assert attacked.attack.outcome in ("collision", "no_collision")
    assert attacked.attack.act_time.decisions >= 160
