"""Which egos others can lawfully cross or join, on the networks `crossing` and `signals`."""

import dataclasses

import numpy as np
import pytest
from crossing_scenes import road

from regents_cosim.scenario import Signal
from regents_cosim.sources.conflicts import Conflicts
from regents_cosim.sources.recording import Recording
from regents_cosim.sources.sumo_types import VehicleType
from regents_cosim.sources.windows import RecordingOrigin, Windows, choose_windows

STEPS = 81
TIME = 0.1 * np.arange(STEPS)
EGO = (-70.0, -1.7, 0.0, 10.0)  # comes to the middle, (0, 0), after 7 s
NORTHWARD = np.pi / 2


def recorded(*vehicles, signals=(), valid=None):
    """Vehicles that go straight: x, y [m], yaw [rad] and speed [m/s] at first."""
    x, y, yaw, speed = np.array(vehicles, float).T[:, :, None]
    ids = tuple(f"v{i}" for i in range(len(vehicles)))
    there = np.ones((len(vehicles), STEPS), bool) if valid is None else valid
    along = speed * TIME
    places = x + along * np.cos(yaw), y + along * np.sin(yaw), yaw + 0.0 * along
    return Recording(0.0, 0.1, ids, (VehicleType("car", 4.6, 1.8),) * len(ids), *places, there, signals)


def possible(made, net="crossing", ego=0):
    speed = np.hypot(np.gradient(made.x, 0.1, axis=1), np.gradient(made.y, 0.1, axis=1))
    return Conflicts(made, made.valid, speed, road(net)).possible_for(ego)


@pytest.mark.parametrize(
    ("other", "may"),
    [
        ((1.7, -50.0, NORTHWARD, 8.0), True),  # comes from the right
        ((-1.7, 40.0, -NORTHWARD, 0.0), True),  # stands on the left, and may go
        ((60.0, 1.7, np.pi, 9.0), True),  # comes towards it, and may turn left
        ((-90.0, -1.7, 0.0, 9.0), False),  # follows it
        ((-40.0, -1.7, 0.0, 9.0), False),  # leads
        ((1.7, 30.0, NORTHWARD, 8.0), False),  # has left the junction
        ((1.7, -130.0, NORTHWARD, 0.5), False),  # is too far away
        ((1.7, -9.0, NORTHWARD, 12.0), False),  # is past before anyone could see what it does
    ],
)
def test_a_conflict_is_a_way_onto_the_path_at_a_time_when_the_ego_comes_by(other, may):
    assert possible(recorded(EGO, other)) is may
    assert possible(recorded(other, EGO), ego=1) is may


def test_an_ego_alone_or_away_from_junctions_has_none():
    assert not possible(recorded(EGO))
    away = (20.0, -1.7, 0.0, 10.0)
    assert not possible(recorded(away, (1.7, -50.0, NORTHWARD, 8.0)))


def test_one_that_has_gone_by_then_is_no_conflict():
    there = np.ones((2, STEPS), bool)
    there[1, 30:] = False
    assert not possible(recorded(EGO, (1.7, -50.0, NORTHWARD, 8.0), valid=there))


def test_a_red_light_keeps_others_out():
    net = road("signals")
    links = [link for links in net.exits.values() for link in links if link.signal]
    lane = next(lane for lane in net.lanes if lane.id == "south_stop_0")
    ahead = (lane.centre[-1] - lane.centre[-2]) / np.hypot(*(lane.centre[-1] - lane.centre[-2]))
    x, y = lane.centre[-1] - 12.0 * ahead
    waits = (x, y, np.arctan2(ahead[1], ahead[0]), 0.0)
    for letter, may in (("G", True), ("r", False)):
        letters = letter * (1 + max(link.link for link in links))
        lights = tuple(Signal(name, ((0, letters),)) for name in sorted({link.signal for link in links}))
        assert possible(recorded(EGO, waits, signals=lights), "signals") is may


def test_a_map_without_connections_has_none():
    made = recorded(EGO, (1.7, -50.0, NORTHWARD, 8.0))
    net = dataclasses.replace(road(), connections=())
    assert not Conflicts(made, made.valid, np.full(made.x.shape, 8.0), net).possible_for(0)


def test_windows_with_conflicts_come_first_and_the_rest_where_they_do_not_suffice():
    egos = [(-70.0 - 12.0 * k, -1.7, 0.0, 10.0) for k in range(6)]  # only the first comes to the middle in time
    made = recorded(*egos, (1.7, -50.0, NORTHWARD, 1.0))
    origin = RecordingOrigin("sumo", "town.sumocfg", "0" * 64)

    def chosen(count, prefer, seed):
        windows = Windows(count=count, seed=seed, prefer=prefer)
        return [window.ego.id for window in choose_windows([made], road(), origin, windows)]

    assert {chosen(1, "conflicts", seed)[0] for seed in range(8)} == {"v0"}
    assert len({chosen(1, "none", seed)[0] for seed in range(8)}) > 1
    assert set(chosen(9, "conflicts", 0)) == set(chosen(9, "none", 0))
