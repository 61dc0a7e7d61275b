import subprocess
import sys
from textwrap import dedent

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.errors import NoWindowError, RegentsError
from regents_cosim.geometry.boxes import overlap
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.scenario.scenario import Signal
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.recording import Recording, speeds
from regents_cosim.sources.windows import RecordingOrigin, Windows, choose_windows, draw_slots, no_cars

CAR = VehicleType("car", 5.0, 1.8)
BIKE = VehicleType("bicycle", 1.6, 0.65)
ORIGIN = RecordingOrigin("sumo", "town.sumocfg", "0" * 64)
STEPS = 81
ROAD = RoadMap(
    lanes=(Lane("a", np.array([[-100.0, 0.0], [500.0, 0.0]]), 20.0, 30.0),),
    connections=(),
    drivable=shapely.box(-100.0, -10.0, 500.0, 10.0),
)


def recording(x, y=None, types=None, valid=None, begin_s=0.0, signals=()):
    """Vehicles that drive along x, one row each."""
    x = np.asarray(x, float)
    y = np.zeros_like(x) if y is None else np.zeros_like(x) + np.reshape(y, (len(x), -1))
    ids = tuple(f"v{i:03d}" for i in range(len(x)))
    types = types or (CAR,) * len(x)
    valid = np.ones(x.shape, bool) if valid is None else valid
    return Recording(begin_s, 0.1, ids, types, x, y, np.zeros_like(x), valid, signals)


def cruise(*starts, speed=10.0):
    return np.array(starts)[:, None] + speed * 0.1 * np.arange(STEPS)


def choose(*recordings, **asked):
    return choose_windows(recordings, ROAD, ORIGIN, Windows(**asked))


def test_a_window_among_moving_traffic():
    (scenario,) = choose(recording(cruise(0.0, 15.0, 30.0), begin_s=12.5), count=1)
    assert scenario.id.startswith("town-00012.5s-v0")
    assert scenario.tracks.steps == STEPS
    assert len(scenario.agents) == 3
    assert scenario.target == pytest.approx((scenario.tracks.x[0, -1], 0.0))
    np.testing.assert_allclose(scenario.tracks.speed, 10.0)
    assert scenario.provenance.begin_s == 12.5


STILL = np.zeros((1, STEPS))
REFUSALS = {
    "stood or crept": recording(np.vstack([STILL, STILL + 15.0, STILL + 30.0])),
    "fewer than 2 moving vehicles": recording(np.vstack([cruise(0.0, 15.0), STILL + 30.0])),
    "fewer than 2 moving": recording(np.vstack([cruise(0.0, 60.0, 120.0)])),
    "overlapped another": recording(cruise(0.0, 3.0, 6.0)),
    "left the lanes": recording(cruise(0.0, 15.0, 30.0), y=[11.0, 11.0, 11.0]),
    "not motor vehicles": recording(cruise(0.0, 15.0, 30.0), types=(BIKE,) * 3),
    "not there throughout": recording(cruise(0.0, 15.0, 30.0), valid=np.tile(np.arange(STEPS) > 0, (3, 1))),
    "jumped": recording(cruise(0.0, 15.0, 30.0), y=np.tile(3.2 * (np.arange(STEPS) > 40), (3, 1))),
}


@pytest.mark.parametrize("reason", REFUSALS)
def test_no_window_says_why_with_numbers(reason):
    with pytest.raises(NoWindowError, match=reason) as error:
        choose(REFUSALS[reason])
    assert "of 3 candidate egos in 1 slot of 8 s" in str(error.value)


def test_no_traffic_is_said():
    with pytest.raises(NoWindowError, match="no vehicle was on the road in 1 slot"):
        choose(recording(np.zeros((0, STEPS))))


def test_company_need_not_last_but_must_be_at_the_same_instant():
    late, early = np.arange(STEPS) > 60, np.arange(STEPS) < 20
    everyone = np.ones(STEPS, bool)
    together = recording(cruise(0.0, 15.0, 30.0), valid=np.array([everyone, late, late]))
    apart = recording(cruise(0.0, 15.0, 30.0), valid=np.array([everyone, late, early]))
    assert len(choose(together)) == 1
    with pytest.raises(NoWindowError):
        choose(apart)


def test_first_every_slot_gives_one_ego():
    slots = [recording(cruise(0.0, 15.0, 30.0), begin_s=8.1 * i) for i in range(3)]
    begins = [s.provenance.begin_s for s in choose(*slots, count=3)]
    assert begins == pytest.approx([0.0, 8.1, 16.2])
    more = choose(*slots, count=7)
    assert sorted(np.unique([s.provenance.begin_s for s in more], return_counts=True)[1]) == [2, 2, 3]
    assert len({s.id for s in more}) == 7
    assert len(choose(*slots, count=50)) == 9  # fewer than asked, and no more than there are


def test_the_seed_decides():
    slots = [recording(cruise(0.0, 15.0, 30.0), begin_s=8.1 * i) for i in range(6)]

    def hashes(seed):
        return [content_hash(s) for s in choose(*slots, count=4, seed=seed)]

    assert hashes(3) == hashes(3)
    assert len({tuple(hashes(seed)) for seed in range(5)}) > 1


TRUCK, MOTORCYCLE, LORRY = (
    VehicleType("truck", 16.5, 2.5), VehicleType("motorcycle", 2.2, 0.9), VehicleType("car", 12.0, 2.5),
)  # fmt: skip


def mixed(*types):
    """Slots of one vehicle of each type, 20 m apart, in several orders."""
    return [recording(cruise(*range(0, 20 * len(types), 20)), types=types, begin_s=8.1 * i) for i in range(4)]


@pytest.mark.parametrize("prefer", ["conflicts", "none"])
@pytest.mark.parametrize("seed", range(4))
def test_passenger_cars_are_egos_before_all_others(prefer, seed):
    slots = mixed(TRUCK, MOTORCYCLE, CAR, LORRY)
    assert {s.ego.id for s in choose(*slots, count=4, seed=seed, prefer=prefer)} == {"v002"}
    more = choose(*slots, count=7, seed=seed, prefer=prefer)
    assert sum(s.ego.id == "v002" for s in more) == 4  # where there are no more cars, what there is
    assert len(more) == 7


def test_any_vehicle_or_a_kind_alone_may_be_asked_for():
    slots = mixed(TRUCK, MOTORCYCLE, CAR, LORRY)
    assert len({s.ego.id for s in choose(*slots, count=16, ego_kind="any")}) == 4
    assert {s.ego.id for s in choose(*slots, count=16, ego_kind="truck")} == {"v000"}
    with pytest.raises(NoWindowError, match="16 were of another kind than `ego_kind` bus"):
        choose(*slots, ego_kind="bus")


@pytest.mark.slow
@given(
    st.lists(st.lists(st.sampled_from([CAR, TRUCK, MOTORCYCLE]), min_size=3, max_size=5), min_size=2, max_size=6),
    st.integers(0, 9),
)
def test_a_window_whose_ego_is_a_car_is_cut_as_if_none_were_preferred(kinds, seed):
    slots = [
        recording(cruise(*range(0, 20 * len(types), 20)), types=tuple(types), begin_s=8.1 * i)
        for i, types in enumerate(kinds)
    ]
    as_drawn = choose(*slots, count=len(slots), seed=seed, ego_kind="any")
    found = {content_hash(s) for s in choose(*slots, count=len(slots), seed=seed)}
    assert {content_hash(s) for s in as_drawn if s.ego.kind == "car"} <= found


def test_egos_that_are_no_passenger_cars_are_named():
    slots = mixed(TRUCK, MOTORCYCLE, CAR, LORRY)
    assert no_cars(choose(*slots, count=4)) == ""
    said = no_cars(choose(*slots, count=16))
    assert said.startswith("the ego is no passenger car in 12 of 16 windows: ")
    assert {"truck 16.5 m", "motorcycle 2.2 m", "car 12 m"} <= set(said.split(": ")[1].partition(" (")[0].split(", "))


def test_a_vehicle_that_jumps_is_no_ego_and_is_there_throughout():
    y = np.zeros((4, STEPS))
    y[3] = 3.2 + 3.2 * (np.arange(STEPS) >= 60)  # changes lanes at once
    scenarios = choose(recording(cruise(0.0, 15.0, 30.0, 5.0), y=y), count=9)
    assert {s.ego.id for s in scenarios} == {"v000", "v001", "v002"}
    track = scenarios[0].tracks
    last = [a.id for a in scenarios[0].agents].index("v003")
    assert track.valid[last].all()


def test_the_nearest_64_come_along():
    offsets = np.concatenate([[0.0], np.repeat(np.arange(1, 12) * 8.0, 9)])
    lateral = np.concatenate([[0.0], np.tile(np.arange(-4, 5) * 2.0, 11)])
    scenario = choose(recording(cruise(*offsets), y=lateral), count=1, seed=1)[0]
    assert len(scenario.agents) == 64
    ids = [a.id for a in scenario.agents[1:]]
    assert ids == sorted(ids)
    ego = int(scenario.ego.id[1:])
    way = np.hypot(offsets - offsets[ego], lateral - lateral[ego])
    way[ego] = np.inf
    taken = {int(name[1:]) for name in ids}
    assert max(way[i] for i in taken) <= min(way[i] for i in range(len(way)) if i not in taken and i != ego)


def test_agents_out_of_reach_stay_out():
    (scenario,) = choose(recording(cruise(0.0, 15.0, 30.0, 400.0)), count=1, radius_m=100.0)
    assert "v003" not in [a.id for a in scenario.agents]


def test_overlaps_of_others_are_recorded_as_such():
    scenarios = choose(recording(cruise(0.0, 15.0, 30.0, 45.0, 48.0)), count=9)
    assert {s.ego.id for s in scenarios} == {"v000", "v001", "v002"}
    for scenario in scenarios:
        (found,) = scenario.overlaps
        assert (set(found.agents), found.first_step, found.last_step) == ({"v003", "v004"}, 0, 80)
        assert not overlap(*([type(scenario.boxes)(*(v[i] for v in scenario.boxes)) for i in (0, 1)])).any()


def test_only_signals_of_the_map_come_along():
    (scenario,) = choose(recording(cruise(0.0, 15.0, 30.0), signals=(Signal("far", ((0, "r"),)),)), count=1)
    assert scenario.signals == ()


def test_ids_are_folder_names():
    strange = Recording(
        0.0, 0.1, ("..x", "a/b", "a:b", "a_b-2"), (CAR,) * 4, cruise(0.0, 15.0, 30.0, 45.0),
        np.zeros((4, STEPS)), np.zeros((4, STEPS)), np.ones((4, STEPS), bool),
    )  # fmt: skip
    names = [s.id for s in choose_windows([strange], ROAD, RecordingOrigin("fcd", "ä b.xml.gz", ""), Windows())]
    assert len({*names}) == 4  # a number behind a name may be that of another vehicle
    assert all(name.replace("_", "").replace("-", "").replace(".", "").isascii() for name in names)
    assert not any(set(name) & set('/:\\ "') for name in names)


@pytest.mark.parametrize("asked", [{"count": 0}, {"horizon_s": 0.0}, {"radius_m": -1.0}, {"seed": -1}])
def test_senseless_requests_are_refused(asked):
    with pytest.raises(RegentsError, match="expected"):
        Windows(**asked)


@pytest.mark.slow
def test_words_that_are_none_are_refused():
    """Outside of these tests, in which types are checked."""
    code = """
        from regents_cosim.errors import RegentsError
        from regents_cosim.exports.export import export
        from regents_cosim.sources.windows import Windows
        for asked in (dict(prefer="conflict"), dict(ego_kind="cars")):
            try:
                Windows(**asked)
            except RegentsError as error:
                print(error)
        try:
            export(None, "opendrive", "out")
        except RegentsError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, "-c", dedent(code)], capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "`prefer` 'conflict', did you mean conflicts?",
        "`ego_kind` 'cars', did you mean car?",
        "`to` 'opendrive', expected one of fcd, csv, openscenario, commonroad",
    ], done.stderr


@given(st.integers(1, 500), st.integers(1, 60), st.integers(0, 9))
def test_slots_are_spread_over_the_time(total, count, seed):
    slots = draw_slots(total, Windows(count=count, seed=seed))
    assert slots == sorted(set(slots))
    assert all(0 <= slot < total for slot in slots)
    assert len(slots) <= max(4, total // 3)
    assert np.diff([-1, *slots, total]).max() <= 2 * -(-total // len(slots))


@given(st.floats(0.0, 30.0), st.floats(-4.0, 4.0), st.floats(-0.1, 0.1))
def test_speed_of_a_bicycle_is_found_again(speed, accel, curvature):
    time = 0.1 * np.arange(30)
    stop = speed / -accel if accel < 0 else np.inf
    t = np.minimum(time, stop)
    gone = speed * t + 0.5 * accel * t**2
    yaw = curvature * gone
    x = np.where(abs(curvature) < 1e-6, gone, np.sin(yaw) / (curvature or 1.0))
    y = np.where(abs(curvature) < 1e-6, 0.0, (1.0 - np.cos(yaw)) / (curvature or 1.0))
    found = speeds(x[None], y[None], yaw[None], np.ones((1, 30), bool), 0.1)[0]
    expected = np.maximum(speed + accel * t, 0.0)
    moving = np.abs(time - stop) > 0.21  # where it stops the acceleration changes at once
    np.testing.assert_allclose(found[moving], expected[moving], atol=0.02, rtol=0.02)
    assert (found >= 0).all()


def test_speeds_of_short_tracks():
    x = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [0.0, 1.0, 3.0]])
    valid = np.array([[True, True, False], [False, False, True], [True, True, True]])
    found = speeds(x, np.zeros((3, 3)), np.zeros((3, 3)), valid, 0.1)
    np.testing.assert_allclose(found, [[10.0, 10.0, 0.0], [0.0, 0.0, 0.0], [5.0, 15.0, 25.0]])


def test_speeds_beside_a_jump_are_those_of_driving():
    """Also where the jump is the first or the last step of the window, or two follow each other."""
    jumps = np.array([np.arange(40) >= at for at in (1, 25, 39)] + [np.maximum(np.arange(40) - 24, 0).clip(max=2)])
    x = 10.0 * 0.1 * np.arange(40) + 50.0 * jumps**2
    found = speeds(x, np.zeros((4, 40)), np.zeros((4, 40)), np.ones((4, 40), bool), 0.1)
    np.testing.assert_allclose(found, 10.0)


def test_others_are_where_they_were_recorded_whatever_they_do():
    """A teleport, a change of lanes at once, and a gap: none costs an instant."""
    x, y = cruise(0.0, 15.0, 30.0, 45.0), np.zeros((4, STEPS))
    x[1, 40:] += 60.0
    y[2, 50:] += 3.2
    valid = np.ones(x.shape, bool)
    valid[3, 20:23] = False
    (scenario,) = choose(recording(x, y, valid=valid), count=1, company=1)
    assert scenario.ego.id == "v000"
    np.testing.assert_array_equal(scenario.tracks.valid, valid)
    np.testing.assert_array_equal(scenario.tracks.x[valid], x[valid])
    np.testing.assert_array_equal(scenario.tracks.y[valid], y[valid])
    np.testing.assert_allclose(scenario.tracks.speed[valid], 10.0)
