"""A scene for every offence, on straight roads, a hand-made crossing and SUMO networks."""

import dataclasses
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import shapely
from crossing_scenes import EGO, STEPS, scenario, straight
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import DT, TIME, crash, moved, moving, scene, straight_road
from two_car_scenes import crossroads, lane_change, transformed

from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.grades import GROSS_OFFENCES, Conduct
from regents_cosim.scenario.scenario import Signal
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.verdicts.law.offences import MEASURES, acts, law_of
from regents_cosim.verdicts.law.offences_on_foot import MEASURES_ON_FOOT


def changed(log, agent, **tracks):
    return crash(log, moved(log, agent, **tracks))


def names(offences):
    return {offence.name for offence in offences}


def two_way(lanes=1, width=3.2):
    """A road with `lanes` lanes to the east from y = 0 up, and one lane to the west above them."""
    east = np.array([[-200.0, 0.0], [600.0, 0.0]])
    ids = [f"east{i}" for i in range(lanes)]
    made = [
        Lane(
            name, east + np.array([0.0, i * width]), width, 15.0,
            left=ids[i + 1] if i + 1 < lanes else None, right=ids[i - 1] if i else None,
        )
        for i, name in enumerate(ids)
    ]  # fmt: skip
    made.append(Lane("west", east[::-1] + np.array([0.0, lanes * width]), width, 15.0))
    return RoadMap(tuple(made), (), shapely.box(-200, -width / 2, 600, (lanes + 0.5) * width))


def oncoming(shift, road=None):
    """An adversary that drives west and moves `shift` [m] to the south, into the ego's lane."""
    log = scene((0, 0, 10), (100, 3.2, 10), road=road or two_way())
    log = moving(log, 1, x=100 - 10 * TIME, yaw=np.full(81, np.pi))
    return log, {"y": lane_change(1.0, 3.2, 3.2 - shift)}


@pytest.mark.parametrize(
    ("shift", "expected"), [(3.2, {"oncoming_lanes", "against_direction"}), (1.5, {"oncoming_lanes"})]
)
def test_into_oncoming_lanes(shift, expected):
    log, change = oncoming(shift)
    law = law_of(changed(log, 1, **change))
    assert names(law.adversary) & GROSS_OFFENCES == expected
    assert law.conduct is Conduct.GROSS
    assert not names(law.ego) & GROSS_OFFENCES
    found = next(offence for offence in law.adversary if offence.name == "oncoming_lanes")
    assert found.unit == "share of its body"
    assert 0.17 < found.amount <= 1.0
    assert 1.0 < found.time_s < 1.8


def test_a_nose_across_the_line_counts_head_on():
    # 15 % of its body is beyond the line, and the ego is 0.4 m left of the middle of its lane
    log = scene((0, 0.4, 10), (100, 3.2, 10), road=two_way())
    log = moving(log, 1, x=100 - 10 * TIME, yaw=np.full(81, np.pi))
    law = law_of(changed(log, 1, y=np.full(81, 2.2)))
    assert names(law.adversary) & GROSS_OFFENCES == {"oncoming_lanes"}
    assert law.ego == ()


def test_what_the_log_did_to_the_same_degree_is_no_offence():
    log, change = oncoming(3.2)
    same = moving(log, 1, **change)
    assert not names(law_of(crash(same)).adversary) & GROSS_OFFENCES
    less, _ = oncoming(3.2)
    less = moving(less, 1, y=lane_change(1.0, 3.2, 3.2 - 1.2))
    assert "oncoming_lanes" in names(law_of(changed(less, 1, **change)).adversary)


def test_roles_may_be_reversed():
    log, change = oncoming(3.2)
    law = law_of(changed(log, 1, **change))
    swapped = scene((100, 3.2, 10), (0, 0, 10), road=two_way())
    swapped = moving(swapped, 0, x=100 - 10 * TIME, yaw=np.full(81, np.pi))
    back = law_of(changed(swapped, 0, **change))
    assert (back.ego, back.adversary) == (law.adversary, law.ego)
    assert back.conduct is Conduct.KEEPS_RULES


def test_lanes_drawn_on_each_other_have_no_oncoming_side():
    lanes = [replace(lane, centre=lane.centre * [1.0, 0.0]) for lane in two_way().lanes]
    log = scene((0, 0, 10), (100, 0, 10), road=RoadMap(tuple(lanes), (), shapely.box(-200, -3, 600, 3)))
    log = moving(log, 1, x=100 - 10 * TIME, yaw=np.full(81, np.pi))
    law = law_of(changed(log, 1, y=np.full(81, 0.3)))
    assert law.adversary == ()
    assert law.conduct is Conduct.UNKNOWN  # who had to let the other pass
    assert "oncoming_lanes" not in law.unknown


def test_a_map_without_lanes_is_unknown_never_lawful():
    log, change = oncoming(3.2, RoadMap((), (), shapely.box(-200, -5, 600, 8)))
    law = law_of(changed(log, 1, **change))
    assert law.conduct is Conduct.UNKNOWN
    assert set(law.unknown) > {"oncoming_lanes", "against_direction", "red_light", "speeding", "gives_no_way"}


def test_speeding_is_more_than_the_limit_allows_and_the_log_did():
    log = scene((60, 0, 10), (0, 0, 16), road=two_way())
    fast = np.linspace(16.0, 22.0, 81)
    made = changed(log, 1, speed=fast, x=np.cumsum(fast) * DT)
    (found,) = (one for one in law_of(made).adversary if one.name == "speeding")
    assert found.unit == "m/s over the limit"
    assert found.amount == pytest.approx(fast[made.collision.step] - 15.0, abs=1e-3)
    logged = moving(log, 1, speed=np.full(81, 23.0))
    assert "speeding" not in names(law_of(crash(logged, made.tracks)).adversary)
    slow = changed(log, 1, speed=np.full(81, 17.9), x=17.9 * TIME)
    assert "speeding" not in names(law_of(slow).adversary)


def test_the_limit_is_unknown_where_a_log_names_none():
    lanes = tuple(replace(lane, speed_limit=13.9) for lane in two_way().lanes)
    log = scene((40, 0, 10), (0, 0, 30), road=replace(two_way(), lanes=lanes))
    assert "speeding" in law_of(crash(log)).unknown


def test_a_log_without_lights_may_have_left_them_out():
    log = scene((40, 0, 10), (0, 0, 30), road=two_way())
    assert "red_light" in law_of(crash(log)).unknown
    lit = replace(log, signals=(Signal("light", ((0, "G"),)),))
    assert "red_light" not in law_of(crash(lit)).unknown
    assert "red_light" not in law_of(on_the_crossing(straight("a", -108.0, -1.7, 0.0, 13.0))).unknown


def test_off_the_road():
    log = scene((20, 0, 8), (0, 0, 10), road=two_way())
    made = changed(log, 1, y=lane_change(0.5, 0.0, -1.4), x=12 * TIME)
    assert "off_road" in names(law_of(made).adversary)
    parked = moving(log, 1, y=np.full(81, -1.4))
    assert "off_road" not in names(law_of(crash(parked)).adversary)


@pytest.mark.parametrize(("letters", "expected"), [("rG", {"ego"}), ("Gr", {"adversary"}), ("yg", set())])
def test_a_red_light(letters, expected):
    made = crossroads(*letters)
    log = replace(made, signals=(Signal("light", ((0, "GG"),)),))
    law = law_of(replace(crash(log), signals=made.signals))
    # the log passed the same light at the same time, so it did the same
    assert not (names(law.adversary) | names(law.ego)) & {"red_light"}
    still = moving(made, 0, x=np.full(81, -30.0), speed=np.zeros(81))
    still = moving(still, 1, y=np.full(81, -30.0), speed=np.zeros(81))
    law = law_of(crash(still, made.tracks))
    assert {who for who in ("adversary", "ego") if "red_light" in names(getattr(law, who))} == expected


def test_a_red_light_long_before_does_not_count():
    made, end = crossroads("rG"), 80
    (passed,) = acts(made, "red_light", end, (0, 1)).values()
    assert acts(made, "red_light", end, (0, 1), since=passed.step) == {0: passed}
    assert acts(made, "red_light", end, (0, 1), since=passed.step + 1) == {}


def on_the_crossing(adversary, ego=EGO):
    """A crossing where the adversary drives as given, and in the log stands where it begins."""
    made = scenario(ego, adversary)
    log = scenario(ego, straight(adversary.id, adversary.x[0], adversary.y[0], adversary.yaw[0], 0.0))
    return crash(log, made.tracks)


def test_who_comes_from_the_minor_road_gives_way():
    ego = straight("ego", -20.0, -1.7, 0.0, 10.0)  # on the major road
    law = law_of(on_the_crossing(straight("a", 1.7, -21.0, np.pi / 2, 9.0), ego))
    assert "gives_no_way" in names(law.adversary)
    assert law.conduct is Conduct.MISTAKE
    minor = straight("ego", 1.7, -21.0, np.pi / 2, 9.0)
    law = law_of(on_the_crossing(straight("a", -20.0, -1.7, 0.0, 10.0), minor))
    assert "gives_no_way" in names(law.ego)
    assert "gives_no_way" not in names(law.adversary)


@pytest.mark.parametrize(("letters", "fails"), [("gG", True), ("GG", False), ("gr", False), ("sg", True)])
def test_a_green_light_of_its_own_or_a_red_one_of_the_other_excuses(letters, fails):
    made = on_the_crossing(straight("a", 1.7, -21.0, np.pi / 2, 9.0), straight("ego", -20.0, -1.7, 0.0, 10.0))
    lit = {"south_stop_0": 0, "west_stop_1": 1}
    links = tuple(
        replace(link, signal="light", link=lit[link.source]) if link.source in lit else link
        for link in made.road.connections
    )
    made = replace(made, road=replace(made.road, connections=links), signals=(Signal("light", ((0, letters),)),))
    assert ("gives_no_way" in names(law_of(made).adversary)) == fails


def test_across_the_middle_inside_a_junction():
    """It crosses the turning paths of others, which it may not use."""
    adversary = straight("a", 15.0, 1.7, np.pi, 10.0)
    y = 1.7 - np.minimum(1.9, 3.8 * DT * np.arange(STEPS))
    made = on_the_crossing(dataclasses.replace(adversary, y=y), straight("ego", -20.0, -1.7, 0.0, 10.0))
    assert abs(made.tracks.x[1, made.collision.step]) < 12.0
    assert "oncoming_lanes" in names(law_of(made).adversary)


def test_leaving_its_way_in_a_junction():
    ego = straight("ego", -10.0, -1.7, 0.0, 0.0)
    adversary = straight("a", 15.0, 1.7, np.pi, 12.0)
    y = 1.7 - np.minimum(3.4, 3.4 * np.arange(STEPS) / 10)  # across the middle, in 1 s
    law = law_of(on_the_crossing(dataclasses.replace(adversary, y=y), ego))
    assert "oncoming_lanes" in names(law.adversary)
    # a way that is none: straight on from the lane of the left turn, 3.5 m beside the curve
    astray = straight("a", 1.7, -16.0, np.deg2rad(115.0), 9.0)
    law = law_of(on_the_crossing(astray, straight("ego", -7.0, 2.5, 0.0, 0.0)))
    (found,) = (one for one in law.adversary if one.name == "leaves_way")
    assert found.amount > 1.6


def test_a_cut_in_without_room():
    log = scene((0, 0, 15), (18, 3.2, 8), road=two_way(2))
    law = law_of(changed(log, 1, y=lane_change(0.5, 3.2, 0.0)))
    assert names(law.adversary) == {"unsafe_cut_in"}
    assert law.conduct is Conduct.MISTAKE
    far = scene((0, 0, 15), (40, 3.2, 8), road=two_way(2))
    assert not law_of(changed(far, 1, y=lane_change(0.5, 3.2, 0.0))).adversary


def test_a_change_of_lanes_into_another_beside_it():
    log = scene((0, 0, 10), (2, 3.2, 10), road=two_way(2))
    law = law_of(changed(log, 1, y=lane_change(0.5, 3.2, 0.0)))
    assert names(law.adversary) == {"unsafe_cut_in"}
    assert law.conduct is Conduct.MISTAKE
    # the ego changes into the other's lane, which keeps it
    law = law_of(changed(log, 0, y=lane_change(0.5, 0.0, 3.2)))
    assert not law.adversary
    assert "unsafe_cut_in" in names(law.ego)


def test_over_the_edge_without_a_change_of_lanes():
    log = scene((10, 3.2, 10), (-20, 0, 10), road=two_way(2))
    made = changed(log, 1, y=np.full(81, 1.5), x=-20 + 16 * TIME)
    assert "leaves_lane" in names(law_of(made).adversary)


def test_standing_across_a_marking_is_no_change_of_lanes():
    log = scene((0, 0, 10), (30, 3.2, 10), road=two_way(2))
    x, speed = 30 + 10 * np.minimum(TIME, 2.0), np.where(TIME < 2.0, 10.0, 0.0)
    made = changed(log, 1, x=x, y=lane_change(0.5, 3.2, 1.5), speed=speed)  # its centre ends in the ego's lane
    (found,) = (one for one in law_of(made).adversary if one.name == "leaves_lane")
    assert found.time_s == pytest.approx(2.0, abs=0.11)
    moves = changed(log, 1, x=30 + 4 * TIME, y=lane_change(4.0, 3.2, 1.5), speed=4.0)
    assert "leaves_lane" not in names(law_of(moves).adversary)


def test_however_little_over_the_marking_who_touches_another_there_does_not_keep_the_rules():
    log = scene((0, 0.5, 10), (2, 3.2, 10), road=two_way(2))
    law = law_of(changed(log, 1, y=lane_change(0.5, 3.2, 2.25)))  # by 0.2 m
    assert names(law.adversary) == {"unsafe_cut_in"}


def test_tailgating():
    log = scene((12, 0, 10), (0, 0, 10), road=two_way())
    made = changed(log, 1, x=np.maximum(10 * TIME, 20 * TIME - 50.0))
    assert "tailgating" in names(law_of(made).adversary)


def braking(law_m_s2, *others, road=None, speed=20.0, log=None):
    """An ego that follows a car, which begins to brake after 1 s; in the log the car drives on, or brakes as well."""
    made = scene((0, 0, speed), (25, 0, speed), *others, road=road or straight_road())

    def braked(brake):
        v = np.maximum(speed - brake * np.maximum(TIME - 1.0, 0.0), 0.0)
        return {"x": 25 + np.cumsum(v) * DT, "speed": v}

    made = made if log is None else moving(made, 1, **braked(log))
    return names(law_of(changed(made, 1, **braked(law_m_s2))).adversary)


@pytest.mark.parametrize(
    ("brake", "others", "road", "needless"),
    [
        (5.0, [], None, True),
        (3.0, [], None, False),  # comfortably
        (5.0, [(60, 0, 15)], None, False),  # for a leader
        (5.0, [(60, 3.2, 15)], None, True),  # that is in the next lane
        (5.0, [(-15, 0, 20)], None, True),
        (5.0, [], replace(straight_road(), lanes=tuple(
            replace(lane, centre=lane.centre - [500.0, 0.0]) for lane in straight_road().lanes)), False),  # which end
        (5.0, [], replace(straight_road(), lanes=()), False),  # not known
    ],
)  # fmt: skip
def test_braking_without_a_reason(brake, others, road, needless):
    assert ("brakes_needlessly" in braking(brake, *others, road=road)) is needless


def test_who_brakes_as_in_its_log_or_for_one_that_comes_into_its_way_has_no_need_of_a_reason():
    assert "brakes_needlessly" not in braking(5.0, log=5.0)
    made = moving(scene((0, 0, 20), (25, 0, 20), (55, 3.2, 15)), 2, y=lane_change(1.0, 3.2, 0.0), yaw=-0.1)
    v = np.maximum(20 - 5.0 * np.maximum(TIME - 1.0, 0.0), 0.0)
    assert "brakes_needlessly" not in names(law_of(changed(made, 1, x=25 + np.cumsum(v) * DT, speed=v)).adversary)


def test_to_stop_gently_is_needless_too():
    assert "brakes_needlessly" in braking(3.0, speed=10.0)


def test_no_crash_no_law_and_every_measure_has_a_name():
    assert law_of(scene((0, 0, 10), (50, 0, 10))) is None
    assert MEASURES.keys() | MEASURES_ON_FOOT.keys() > GROSS_OFFENCES


@pytest.mark.slow
@settings(max_examples=25)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.sampled_from([1, -1]), st.integers(0, 2))
def test_left_hand_traffic_has_the_same_offences(turn, dx, side, which):
    log, change = oncoming(3.2)
    cut = scene((0, 0, 15), (18, 3.2, 8), road=two_way(2))
    made = [
        changed(log, 1, **change),
        changed(cut, 1, y=lane_change(0.5, 3.2, 0.0)),
        crash(crossroads("r", "G")),
    ][which]
    law, mirrored = law_of(made), law_of(transformed(made, turn, dx, 0.0, side))
    assert names(mirrored.adversary) == names(law.adversary)
    assert names(mirrored.ego) == names(law.ego)
    assert mirrored.unknown == law.unknown


def test_the_rows_of_a_network_by_hand():
    table = priorities(scenario(EGO).road)
    assert table.must_yield(":centre_1_0", ":centre_4_0")  # north straight on, to east straight on
    assert not table.must_yield(":centre_4_0", ":centre_1_0")
    assert table.must_yield(":centre_6_0", ":centre_11_0")  # the first part of a left turn, to the oncoming
    assert not table.must_yield(":centre_1_0", "no such lane")
    assert priorities(replace(scenario(EGO).road, sumo_net=b"no network")) is None
    assert priorities(two_way()) is None


def test_a_network_built_for_left_hand_traffic(tmp_path):
    import sumo

    made = {}
    for side in ("left", "right"):
        net = tmp_path / f"{side}.net.xml"
        options = [
            "--grid",
            "--grid.number",
            "2",
            "--grid.length",
            "100",
            "--no-turnarounds",
            "--grid.attach-length",
            "60",
        ]
        options += ["--lefthand"] * (side == "left")
        subprocess.run([f"{sumo.SUMO_HOME}/bin/netgenerate", *options, "-o", str(net)], check=True, capture_output=True)
        made[side] = read_road_map(net)
    for road in made.values():
        lane = next(lane for lane in road.lanes if not lane.junction and lane.length > 50)
        begin, end = lane.centre[0], lane.centre[-1]
        ahead = (end - begin) / np.hypot(*(end - begin))
        yaw = float(np.arctan2(ahead[1], ahead[0]))
        across = np.array([-ahead[1], ahead[0]])
        sides = {}
        for side in (1.0, -1.0):
            log = scene((0, 0, 5), (0, 0, 5), road=road, steps=31)
            time = DT * np.arange(31)
            ego = begin + (25 + 3 * time)[:, None] * ahead + side * 3.2 * across
            mine = begin + (10 + 8 * time)[:, None] * ahead
            out = mine + (side * 3.2 * np.clip(time / 1.5, 0, 1))[:, None] * across
            log = replace(log, tracks=replace(log.tracks, x=np.stack([ego[:, 0], mine[:, 0]]),
                          y=np.stack([ego[:, 1], mine[:, 1]]), yaw=np.full((2, 31), yaw)))  # fmt: skip
            tracks = replace(log.tracks, x=np.stack([ego[:, 0], out[:, 0]]), y=np.stack([ego[:, 1], out[:, 1]]))
            sides[side] = names(law_of(crash(log, tracks)).adversary)
        assert [("oncoming_lanes" in found) for found in sides.values()].count(True) == 1
        assert [("off_road" in found) for found in sides.values()].count(True) == 1
