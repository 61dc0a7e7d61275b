"""What spoils a crash: strictly clean, question by question, and on the device as on the host."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scenes import crash, moved, moving, scene, straight_road

from regents_cosim.evaluation.statistics import mcnemar, wilson
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.verdicts.clean import flaws, hardest

TIME = np.linspace(0, 1, 81)


def attacked(made, other=1, attributed=True, **changes):
    """`made` with the tracks of one of its cars changed by functions of the share of the horizon."""
    rows = {name: getattr(made.tracks, name)[other] + change(TIME) for name, change in changes.items()}
    return crash(made, moved(made, other, **rows), attributed)


def crashed(*cars, drift=0.0, attributed=True, **changes):
    """Cars that go straight on, the second drifting sideways by the end."""
    return attacked(scene(*cars, **changes), y=lambda t: drift * t**2, attributed=attributed)


def test_a_cut_in_is_clean():
    assert flaws(crashed((0, 0, 10), (8, 3.2, 9), drift=-3.2)) == ()


def test_a_crash_that_the_attack_did_not_cause():
    assert flaws(crashed((0, 0, 10), (8, 3.2, 9), drift=-3.2, attributed=False)) == ("unattributed",)
    assert flaws(crashed((0, 0, 10), (22, 0, 7.5))) == ("unattributed",)  # where its log has it


def test_an_adversary_that_was_off_the_road():
    assert flaws(crashed((0, 0, 10), (22, 0, 7.5), drift=-1.7)) == ("off_road",)
    assert flaws(crashed((0, 0, 10), (22, 0, 7.5), drift=-0.5)) == ()


def test_a_car_that_was_parked_beside_the_road_may_join_it_and_not_go_further_off():
    cars = (0, 0, 10), (30, -3.0, 5.0)  # its sides are 0.5 and 2.3 m off the road
    assert flaws(crashed(*cars, drift=4.5)) == ()
    away = attacked(scene(*cars), y=lambda t: np.where(t < 0.4, -2.0 * t, 9.0 * (t - 0.4) - 0.8))
    assert "off_road" in flaws(away)
    once_on = attacked(scene(*cars), y=lambda t: np.interp(t, [0.0, 0.3, 0.42, 0.7], [0.0, 4.0, 0.5, 4.0]))
    assert "off_road" in flaws(once_on)


def test_between_a_car_park_and_the_road_only_the_log_shows_where_one_can_drive():
    cars = (0, 0, 10), (30, -8.0, 5.0)
    comes = attacked(scene(*cars), y=lambda t: 11.0 * t)
    assert flaws(comes) == ("off_road",)  # over ground that neither the map nor its log shows
    assert flaws(replace(comes, log=replace(comes.tracks, x=comes.tracks.x - 0.2))) == ()


def test_an_island_between_the_corners_of_its_box():
    island = shapely.box(60, 2.6, 61.5, 3.7)
    road = straight_road()
    holed = RoadMap(road.lanes, (), road.drivable - island)
    made = scene((0, 0, 10), (24, 3.2, 8), road=holed)
    over = {"x": lambda t: -6.0 * t, "y": lambda t: -2.6 * np.clip(8.0 * (t - 0.8), 0.0, 1.0)}
    hit = attacked(made, **over)
    assert flaws(hit) == ()  # as its log does
    beside = replace(hit, log=replace(hit.log, y=hit.log.y + np.array([[0.0], [3.2]])))
    assert flaws(beside) == ("off_road",)
    assert flaws(replace(beside, road=road)) == ()


def test_an_adversary_that_hits_somebody_else_first():
    made, overlapping = (scene((0, 0, 10), (20, 0, 6.9), (third, 0, 6.9)) for third in (25, 24))
    assert flaws(attacked(made, x=lambda t: np.minimum(4.0 * t, 1.0))) == ("hits_others",)
    assert flaws(attacked(overlapping, x=lambda t: np.minimum(4.0 * t, 1.0))) == ()


def test_an_adversary_that_goes_through_a_third_party_between_two_steps():
    made = scene((0, 0, 10), (20, 6.4, 7.0), (26, 3.2, 7.0))
    jump = attacked(made, y=lambda t: np.where(t < 0.5, 0.0, -6.4), x=lambda t: np.where(t < 0.5, 5.0 * t, 4.0))
    assert "hits_others" in flaws(jump)


def test_bystanders_that_collide():
    made = scene((0, 0, 10), (8, 3.2, 9), (40, 6.4, 9), (50, 6.4, 9))
    spoilt = attacked(made, y=lambda t: -3.2 * t**2)
    spoilt = moving(spoilt, 2, x=spoilt.tracks.x[2] + np.interp(TIME, [0.0, 0.3], [0.0, 7.0]))
    assert flaws(spoilt) == ("bystanders_collide",)
    apart = tuple(replace(a, kind="pedestrian") if i in (2, 3) else a for i, a in enumerate(spoilt.agents))
    assert flaws(replace(spoilt, agents=apart)) == ()


def test_an_adversary_that_runs_into_the_back_of_the_ego():
    found = flaws(attacked(scene((20, 0, 5), (0, 0, 9)), x=lambda t: 8.0 * t))
    assert found == ("rear_ends_ego", "from_behind")


def test_an_adversary_that_comes_from_behind_into_the_side():
    """It swerves from the lane beside into the ego's rear quarter; by its heading at the contact it is no rear-end."""
    made = scene((20, 0, 5), (8, 3.2, 8))
    found = flaws(attacked(made, y=lambda t: np.interp(t, [0.25, 0.32], [0.0, -2.6])))
    assert "from_behind" in found


def test_a_standing_ego():
    assert "ego_stands" in flaws(crashed((40, 0, 0.1), (20, 3.2, 6), drift=-8.0))


def test_an_adversary_that_tyres_do_not_hold():
    made = scene((0, 0, 10), (22, 0, 10))
    braking = {"x": lambda t: -45.0 * t**2, "speed": lambda t: np.maximum(-90.0 / 8.0 * t, -10.0)}
    assert flaws(attacked(made, **braking)) == ()
    hard = {"x": lambda t: -45.0 * t**2, "speed": lambda t: -10.0 * np.clip(20.0 * (t - 0.1), 0.0, 1.0)}
    assert flaws(attacked(made, **hard)) == ("too_hard",)
    in_log = moved(made, 1, speed=made.tracks.speed[1] + hard["speed"](TIME))
    assert flaws(replace(attacked(made, **hard), log=in_log)) == ()


def test_the_hardest_acceleration_is_that_of_a_circle():
    """12 m/s on a circle of 24 m radius are 6 m/s^2, for any step length, with a gap, and where the yaw wraps."""
    for dt in (0.04, 0.1, 0.2):
        time = np.arange(0.0, 8.0, dt)
        one = np.ones((1, len(time)))
        made = scene((0, 0, 12), steps=len(time))
        yaw = np.mod(12.0 / 24.0 * time + np.pi, 2 * np.pi)[None] - np.pi
        valid = one.astype(bool)
        valid[0, 20:25] = False
        tracks = replace(made.tracks, yaw=yaw, speed=12.0 * one, valid=valid)
        assert hardest(tracks, 0, len(time), dt) == pytest.approx(6.0)
        assert hardest(tracks, 0, 1, dt) == 0.0


def test_no_crash_has_no_flaws():
    made = scene((0, 0, 10), (50, 0, 10))
    record = AttackRecord(made.id, "king", "idm", "no_collision", 3)
    assert flaws(replace(made, attack=record, log=made.tracks)) is None
    assert flaws(made) is None


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"), [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (90, 149, 0.5238, 0.6790)]
)
def test_wilsons_interval(successes, n, low, high):
    assert wilson(successes, n) == pytest.approx((low, high), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_mcnemar_asks_only_the_trials_that_differ():
    assert mcnemar([True] * 5 + [False] * 5, [True] * 5 + [False] * 5) == 1.0
    assert mcnemar([True] * 6 + [False] * 9, [False] * 15) == pytest.approx(2 * 0.5**6)
    first, second = [True] * 8 + [False] * 2 + [True] * 90, [False] * 8 + [True] * 2 + [True] * 90
    assert mcnemar(first, second) == mcnemar(second, first) == pytest.approx(112 / 1024)
