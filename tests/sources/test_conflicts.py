"""Which egos others can lawfully cross or join, on the networks `crossing` and `signals` and on a zebra crossing."""

import dataclasses

import numpy as np
import pytest
from crossing_scenes import road
from walkers import zebra

from regents_cosim.scenario.scenario import Signal
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.conflicts import Conflicts, Possible
from regents_cosim.sources.recording import Recording
from regents_cosim.sources.windows import RecordingOrigin, Windows, choose_windows

STEPS = 81
TIME = 0.1 * np.arange(STEPS)
AT_ZEBRA = (-10.0, 0.0, 0.0, 10.0)  # comes to the crossing, at x = 40, after 5 s
WAITS = (38.0, 5.5, 0.0, 0.0)  # on the far side of it, which ends at y = -1.6 and 4.8
EGO = (-70.0, -1.7, 0.0, 10.0)  # comes to the middle, (0, 0), after 7 s
NORTHWARD = np.pi / 2


def recorded(*vehicles, signals=(), valid=None, on_foot=()):
    """Vehicles, then persons, that go straight: x, y [m], yaw [rad] and speed [m/s] at first."""
    types = (VehicleType("car", 4.6, 1.8),) * len(vehicles) + (VehicleType("pedestrian", 0.5, 0.6),) * len(on_foot)
    vehicles = (*vehicles, *on_foot)
    x, y, yaw, speed = np.array(vehicles, float).T[:, :, None]
    ids = tuple(f"v{i}" for i in range(len(vehicles)))
    there = np.ones((len(vehicles), STEPS), bool) if valid is None else valid
    along = speed * TIME
    places = x + along * np.cos(yaw), y + along * np.sin(yaw), yaw + 0.0 * along
    return Recording(0.0, 0.1, ids, types, *places, there, signals)


def possible(made, net="crossing", ego=0, others="all"):
    return bool(who_could(made, net, ego, others))


def who_could(made, net="crossing", ego=0, others="all"):
    speed = np.hypot(np.gradient(made.x, 0.1, axis=1), np.gradient(made.y, 0.1, axis=1))
    made = dataclasses.replace(made, given_speed=speed)
    return Conflicts(made, road(net) if isinstance(net, str) else net).possible_for(ego, others)


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


def test_one_who_stands_on_lanes_that_are_closed_is_no_conflict():
    """Their speed limit is 0."""
    open_to_all = road("crossing")
    lanes = tuple(dataclasses.replace(lane, speed_limit=0.0) for lane in open_to_all.lanes)
    others = recorded(EGO, (-1.7, 40.0, -NORTHWARD, 0.0))
    assert possible(others, open_to_all)
    assert not possible(others, dataclasses.replace(open_to_all, lanes=lanes))


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
    none = tuple(Signal(light.id, ((0, ""),)) for light in lights)  # nothing is known of it
    assert possible(recorded(EGO, waits, signals=none), "signals")


def test_a_map_without_connections_has_none():
    made = recorded(EGO, (1.7, -50.0, NORTHWARD, 8.0))
    net = dataclasses.replace(road(), connections=())
    assert not Conflicts(made, net).possible_for(0)


@pytest.mark.parametrize(
    ("person", "may"),
    [
        (WAITS, True),
        ((36.0, -2.3, 0.0, 0.0), True),  # on the near side
        ((40.0, 4.0, NORTHWARD, 1.0), True),  # is leaving it, and may turn round
        ((20.0, 5.5, 0.0, 1.4), False),  # is too far away to be there in time
        ((34.5, -2.3, 0.0, 0.0), True),
        ((33.0, -2.3, 0.0, 0.0), False),  # would step out in front of the ego
    ],
)
def test_who_walks_is_a_conflict_on_a_crossing_that_the_ego_drives_over(person, may):
    made = recorded(AT_ZEBRA, on_foot=[person])
    assert possible(made, zebra()) is may
    assert possible(made, zebra(), others="pedestrians") is may


def test_who_walks_keeps_to_lights_and_lanes_are_not_for_them():
    for letters, may in (("rG", True), ("Gr", False)):
        made = recorded(AT_ZEBRA, on_foot=[WAITS], signals=(Signal("J", ((0, letters),)),))
        assert possible(made, zebra(light=True)) is may
    assert not possible(recorded(EGO, on_foot=[(1.7, -50.0, NORTHWARD, 8.0)]))
    assert not possible(recorded(EGO, (1.7, -50.0, NORTHWARD, 8.0)), others="pedestrians")


def test_windows_with_a_pedestrian_who_may_cross_come_first():
    egos = [(-10.0 + 12.0 * k, 0.0, 0.0, 10.0) for k in range(6)]  # only the first comes to the crossing after 4 s
    made, origin = recorded(*egos, on_foot=[WAITS]), RecordingOrigin("sumo", "town.sumocfg", "0" * 64)
    for prefer in ("conflicts", "pedestrians"):
        asked = [Windows(count=1, seed=seed, prefer=prefer) for seed in range(8)]
        assert {choose_windows([made], zebra(), origin, one)[0].ego.id for one in asked} == {"v0"}


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


FROM_SOUTH = (1.7, -70.0, NORTHWARD, 10.0)  # on the minor road, comes to the middle after 7 s
FROM_WEST = (-70.0, -1.7, 0.0, 10.0)  # on the major road, at the same time


def test_an_ego_meets_one_with_the_right_of_way_where_it_has_to_give_way():
    assert who_could(recorded(FROM_SOUTH, FROM_WEST)) is Possible.WITH_RIGHT_OF_WAY
    assert who_could(recorded(FROM_WEST, FROM_SOUTH)) is Possible.OTHERS
    assert who_could(recorded(FROM_WEST)) is Possible.NOBODY


def test_an_ego_that_is_in_the_junction_at_first_has_gone_on_already():
    inside = (1.7, -9.0, NORTHWARD, 1.5)
    assert who_could(recorded(inside, (-70.0, -1.7, 0.0, 12.0))) is not Possible.WITH_RIGHT_OF_WAY


def test_windows_in_which_the_ego_gives_way_come_first():
    late = (-78.0, *FROM_WEST[1:])
    assert who_could(recorded(late, FROM_SOUTH)) is Possible.OTHERS
    made, origin = recorded(late, FROM_SOUTH), RecordingOrigin("sumo", "town.sumocfg", "0" * 64)
    for seed in range(8):
        asked = Windows(count=1, seed=seed, company=0)
        assert choose_windows([made], road(), origin, asked)[0].ego.id == "v1"
