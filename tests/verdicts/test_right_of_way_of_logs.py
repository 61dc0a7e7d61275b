"""Who gives way on maps without a table of priorities: lights, signs, turns; and what stays unknown."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import TIME, crash, moving
from two_car_scenes import crossroads

from regents_cosim.maps.roadmap import Lane
from regents_cosim.norms.grades import Conduct
from regents_cosim.scenario.judgement import Judgement, ReferenceDrive
from regents_cosim.verdicts.law.drive import agent_drive
from regents_cosim.verdicts.law.fault import fault
from regents_cosim.verdicts.law.offences import law_of, red_lights

CAREFUL = (ReferenceDrive("careful", True, 1.0, 2.0),)


def signed(west=None, south=None, lights=None):
    """The ego from the west meets another from the south, at 10 m/s both; signs at the ends of their lanes."""
    made = crossroads(*(lights or "rG"))
    says = {"west": west, "south": south}
    lanes = tuple(replace(lane, approach=says.get(lane.id)) for lane in made.road.lanes)
    return replace(made, road=replace(made.road, lanes=lanes), **({} if lights else {"signals": ()}))


def failing(law):
    """Who fails to give way, "unknown" where the map does not tell."""
    if "gives_no_way" in law.unknown:
        return "unknown"
    who = {name for name in ("adversary", "ego") if "gives_no_way" in {one.name for one in getattr(law, name)}}
    return next(iter(who)) if len(who) == 1 else who


@pytest.mark.parametrize(
    ("west", "south", "expected"),
    [
        (None, None, "unknown"),
        (None, "yields", "adversary"),
        ("yields", None, "ego"),
        ("priority", None, "adversary"),
        ("stops", "priority", "ego"),
        ("priority", "priority", "unknown"),
        ("right_first", "right_first", "ego"),  # the other comes from its right
        ("stops", "stops", "ego"),  # at once, and neither stops
    ],
)
def test_signs_tell_who_gives_way(west, south, expected):
    assert failing(law_of(crash(signed(west, south)))) == expected


def test_at_a_stop_on_all_sides_the_first_to_come_goes_first_and_who_does_not_stop_fails():
    made = signed("stops", "stops")
    speed = np.clip(np.abs(TIME - 2.0) * 10.0, 0.0, 10.0)  # it stops at its line
    gone = np.cumsum(speed) * 0.1
    stopped = moving(made, 1, x=np.zeros(81), y=-19.0 + gone - gone[20] + 7.0, speed=np.tile(speed, 1))
    late = moving(stopped, 0, x=-57.0 + 15.0 * TIME, speed=np.full(81, 15.0))
    assert failing(law_of(crash(late))) == "ego"


def test_lights_go_before_signs():
    assert failing(law_of(crash(signed("yields", "priority", lights="Gr")))) == "adversary"
    assert failing(law_of(crash(signed(None, "yields", lights="OO")))) == "adversary"  # they are off


def with_lane(made, x, y):
    """The scene with another lane, through these places."""
    lane = Lane("another", np.stack([x, y], axis=-1), 3.4, 14.0)
    return replace(made, road=replace(made.road, lanes=(*made.road.lanes, lane)))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("degrees", [90.0, 40.0])  # t-bone, head-on
def test_who_turns_across_oncoming_traffic_gives_way_on_any_map(side, degrees):
    made = signed()
    turn = side * np.clip((TIME - 2.5) / 1.5, 0.0, 1.0) * np.deg2rad(degrees)
    yaw = np.pi + turn
    x = 34.0 + np.cumsum(8.0 * np.cos(yaw)) * 0.1
    y = side * 3.4 + np.cumsum(8.0 * np.sin(yaw)) * 0.1
    hit = crash(moving(with_lane(made, x, y), 1, x=x, y=y, yaw=yaw, speed=np.full(81, 8.0)))
    assert hit.collision.collision_type == ("head_on" if degrees < 45.0 else "t_bone")
    assert failing(law_of(hit)) == "adversary"
    assert fault(hit).rule == "gives_way"


def test_who_goes_first_is_unknown_where_two_meet_head_on_on_a_road_drawn_as_one():
    x, y = 30.0 - 10.0 * TIME, np.zeros(81)
    hit = crash(moving(with_lane(signed(), x, y), 1, x=x, y=y, yaw=np.full(81, np.pi)))
    assert failing(law_of(hit)) == "unknown"
    assert fault(hit).at_fault == "nobody"


def test_what_is_not_known_about_giving_way_leaves_a_crash_telling_but_not_flawless():
    law = law_of(crash(signed()))
    judged = Judgement((), drivers=CAREFUL, law=law)
    assert (judged.conduct, judged.telling, judged.flawless) == (Conduct.UNKNOWN, True, None)
    assert Judgement((), drivers=CAREFUL, law=replace(law, unknown=("oncoming_lanes",))).telling is None


def test_a_red_light_counts_where_the_way_behind_it_leads_off_all_lanes():
    made = signed(lights="Gr")
    turned = TIME >= 1.75  # at the stop line, to the north-east
    yaw = np.pi / 2 - turned * 1.2
    x, y = (np.cumsum(10.0 * along(yaw)) * 0.1 for along in (np.cos, np.sin))
    drive = agent_drive(moving(made, 1, x=x - x[0], y=y - 31.0, yaw=yaw), 1, 30)
    assert not drive.entered
    assert [act.step for act in red_lights(drive)] == [drive.passed_ends[0][0]]


def on_one_road(made):
    """The scene without the lanes of the road from the south."""
    lanes = tuple(lane for lane in made.road.lanes if lane.id in ("west", "ew", "east"))
    links = tuple(link for link in made.road.connections if link.source in ("west", "ew"))
    return replace(made, road=replace(made.road, lanes=lanes, connections=links))


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["right-hand", "left-hand"])
@pytest.mark.parametrize("left", [0, 1])
def test_of_two_that_turn_into_one_road_the_one_that_turns_across_gives_way(side, left):
    """The ego comes from the west and another from the east, each on its own side, and both turn."""
    made = on_one_road(signed())
    turn = np.clip((TIME - 2.4) / 1.6, 0.0, 1.0) * np.pi / 2
    for agent in (0, 1):
        yaw = agent * np.pi + side * (turn if agent == left else -turn)
        x, y = (np.cumsum(8.0 * along(yaw)) * 0.1 for along in (np.cos, np.sin))
        begin = (-28.0, -1.7 * side) if agent == 0 else (28.0, 1.7 * side)
        made = moving(made, agent, x=begin[0] + x, y=begin[1] + y, yaw=yaw, speed=np.full(81, 8.0))
    assert failing(law_of(crash(made))) == ("adversary" if left else "ego")


@pytest.mark.parametrize(("begin_m", "expected"), [(12.0, "adversary"), (24.0, "adversary"), (0.0, "unknown")])
def test_who_comes_from_beside_all_lanes_gives_way(begin_m, expected):
    """The other crosses the ego's road, from a place `begin_m` beside it where there are no lanes."""
    made = on_one_road(signed()) if begin_m else signed()
    if begin_m:
        made = moving(made, 1, y=np.clip(-begin_m + 4.0 * TIME, None, 30.0), speed=np.full(81, 4.0))
        made = moving(made, 0, x=10.0 * (TIME - begin_m / 4.0))
    assert failing(law_of(crash(made))) == expected
    if begin_m:
        cyclist = replace(made, agents=(made.agents[0], replace(made.agents[1], kind="bicycle")))
        assert failing(law_of(crash(cyclist))) == "unknown"
