from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import TIME, crash, moving, scene, straight_road
from two_car_scenes import crossroads, lane_change, transformed

from regents_cosim.norms.limits import safe_distance
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.scenario import Signal
from regents_cosim.verdicts.law.fault import RULES, RULES_ON_FOOT, fault


def blamed(made):
    found = fault(crash(made))
    return found.at_fault, found.rule


def braking(x0, speed, begin, brake):
    """Positions and speeds of a car that brakes to a stop."""
    v = np.maximum(speed - brake * np.maximum(TIME - begin, 0.0), 0.0)
    return {"x": x0 + np.concatenate([[0.0], np.cumsum(0.05 * (v[1:] + v[:-1]))]), "speed": v}


def test_the_safe_distance_by_hand():
    # 10 m/s behind 10 m/s: 5 m in half a second, 0.25 m of accelerating, 11^2 / 8 of braking, less 10^2 / 16
    assert safe_distance(10.0, 10.0) == pytest.approx(5.0 + 0.25 + 121.0 / 8.0 - 100.0 / 16.0)
    assert safe_distance(0.0, 30.0) == 0.0


@given(st.floats(0.0, 30.0), st.floats(0.0, 30.0))
def test_the_safe_distance_is_just_enough(follower, leader):
    gained = follower + 0.5 * 2.0
    stops = follower * 0.5 + 0.5 * 2.0 * 0.5**2 + gained**2 / (2 * 4.0)
    assert safe_distance(follower, leader) + leader**2 / (2 * 8.0) >= stops - 1e-9  # the leader stops no sooner


def test_the_adversary_runs_into_the_ego():
    assert blamed(scene((20, 0, 5), (0, 0, 10))) == ("adversary", "rear_end")


def test_the_ego_runs_into_a_leader_that_brakes():
    leader = moving(scene((0, 0, 10), (30, 0, 10)), 1, **braking(30, 10, 1.0, 5.0))
    assert blamed(leader) == ("ego", "rear_end")


def test_the_ego_hits_a_standing_car():
    found = fault(crash(scene((0, 0, 10), (45, 0, 0))))
    assert (found.at_fault, found.rule) == ("ego", "rear_end")
    assert "stood" in found.reason


def test_a_cut_in_is_reckless_below_the_safe_distance():
    def cut_in(ahead, speed):
        made = scene((0, 0, 15), (ahead, 3.2, speed))
        return moving(made, 1, y=lane_change(1.0, 3.2, 0.0))

    found = fault(crash(cut_in(15.0, 10.0)))
    assert (found.at_fault, found.rule) == ("adversary", "cut_in")
    assert "gap of" in found.reason
    assert "15.0 m/s" in found.reason


def test_an_old_cut_in_is_no_excuse():
    made = moving(scene((0, 0, 15), (40.0, 3.2, 9)), 1, y=lane_change(0.5, 3.2, 0.0))
    assert blamed(made) == ("ego", "rear_end")


def test_a_cut_in_with_room_leaves_the_duty_to_the_follower():
    # 1 m/s slower, at 18 m: safe are 14.4 m; then it brakes hard
    made = moving(scene((0, 0, 10), (22, 3.2, 10)), 1, **braking(22, 10, 1.4, 8.0))
    made = moving(made, 1, y=lane_change(0.8, 3.2, 0.0))
    assert blamed(made) == ("ego", "rear_end")


def test_the_ego_that_cuts_in_is_to_blame():
    made = moving(scene((15, 3.2, 10), (0, 0, 15)), 0, y=lane_change(1.0, 3.2, 0.0))
    assert blamed(made) == ("ego", "cut_in")


@pytest.mark.parametrize(("mover", "at_fault"), [(0, "ego"), (1, "adversary")])
def test_whoever_changes_lanes_into_the_other_is_to_blame(mover, at_fault):
    made = scene((0, 0, 10), (1, 3.2, 10))
    target = made.tracks.y[1 - mover, 0]
    assert blamed(moving(made, mover, y=lane_change(1.0, made.tracks.y[mover, 0], target, 3.0))) == (
        at_fault,
        "side_swipe",
    )


def test_both_drift_into_each_other():
    made = scene((0, 0, 10), (1, 3.2, 10))
    made = moving(moving(made, 0, y=lane_change(1.0, 0.0, 1.6, 2.0)), 1, y=lane_change(1.0, 3.2, 1.6, 2.0))
    assert blamed(made) == ("both", "side_swipe")


@pytest.mark.parametrize(("edge", "rule"), [(-1.1, "off_road"), (-1.3, "rear_end")])
def test_an_adversary_off_the_road(edge, rule):
    # its right side comes to -1.5 m: 0.4 m beyond the edge, or 0.2 m
    road = replace(straight_road(), drivable=shapely.box(-200.0, edge, 600.0, 8.0))
    made = moving(scene((0, 0, 10), (45, 0, 1), road=road), 1, y=lane_change(1.0, 0.0, -0.6))
    assert blamed(made) == (("adversary" if rule == "off_road" else "ego"), rule)


def test_against_the_direction_of_the_lane():
    made = scene((0, 0, 10), (60, 0, 10))
    against = moving(made, 1, x=60 - 10 * TIME, yaw=np.full(81, np.pi))
    assert blamed(against) == ("adversary", "wrong_way")
    standing = moving(made, 1, x=np.full(81, 60.0), yaw=np.full(81, np.pi), speed=np.zeros(81))
    assert blamed(standing)[1] != "wrong_way"


@pytest.mark.parametrize(
    ("west", "south", "verdict"),
    [
        ("r", "G", ("ego", "red_light")),
        ("G", "r", ("adversary", "red_light")),
        ("r", "r", ("both", "red_light")),
        ("y", "G", ("nobody", "unclear")),
        ("G", "g", ("nobody", "unclear")),
    ],
)
def test_a_red_light(west, south, verdict):
    assert blamed(crossroads(west, south)) == verdict


def test_the_light_counts_when_the_front_passes_it():
    made = crossroads("G", "G")  # fronts pass at 1.77 s
    for step, verdict in ((17, ("ego", "red_light")), (19, ("nobody", "unclear"))):
        turning = replace(made, signals=(Signal("light", ((0, "GG"), (step, "rG"))),))
        assert blamed(turning) == verdict


@pytest.mark.parametrize(("standing", "at_fault"), [(0, "adversary"), (1, "ego")])
def test_whoever_stands_is_not_to_blame(standing, at_fault):
    still = {"x": np.full(81, 0.0), "speed": np.zeros(81)}
    if standing:
        still["y"] = np.full(81, 0.0)
    assert blamed(moving(crossroads("G", "G"), standing, **still)) == (at_fault, "standing")
    assert blamed(crossroads("G", "G")) == ("nobody", "unclear")


def test_no_crash_is_nobodys_fault():
    made = scene((0, 0, 10), (50, 0, 10))
    assert fault(made) is None
    record = AttackRecord(made.id, "king", "idm", "no_collision", 3)
    assert fault(replace(made, attack=record, log=made.tracks)) is None


@pytest.mark.parametrize("rules", [RULES, RULES_ON_FOOT], ids=["vehicles", "on foot"])
def test_every_rule_has_a_name_and_a_source(rules):
    assert len({rule.name for rule in rules}) == len(rules)
    assert all(rule.source for rule in rules)


@pytest.mark.slow
@settings(max_examples=40)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.sampled_from([1, -1]), st.integers(0, 3))
def test_neither_place_nor_direction_nor_side_matters(turn, dx, dy, side, which):
    made = [
        scene((20, 0, 5), (0, 0, 10)),
        moving(scene((0, 0, 15), (15, 3.2, 10)), 1, y=lane_change(1.0, 3.2, 0.0)),
        moving(scene((0, 0, 10), (1, 3.2, 10)), 1, y=lane_change(1.0, 3.2, 0.0, 3.0)),
        crossroads("r", "G"),
    ][which]
    assert blamed(transformed(made, turn, dx, dy, side)) == blamed(made)
