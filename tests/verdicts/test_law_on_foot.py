"""The law for pedestrians on a street with one crossing: where they may cross, on which light, and how carefully."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scenes import TIME, crash, moved, scene
from walkers import moved_through, walked, zebra

from regents_cosim.evaluation.crashes.scores import told_offences
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.grades import OFFENCES_ON_FOOT, Conduct
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import Signal
from regents_cosim.verdicts.careful.lane_keeping import from_lane_centre
from regents_cosim.verdicts.law.fault import fault
from regents_cosim.verdicts.law.offences import law_of

GREEN, RED = (Signal("J", ((0, letters),)) for letters in ("rG", "Gr"))
FAR = 4.8 + 0.7  # beside the street, across the lane that leads back
NEAR = -1.6 - 0.7


def crossing(at_m, begins_s, speed=1.4, from_y=FAR, log_y=None, **changes):
    """An ego at 10 m/s, and a person that crosses at a place; in the log the person stands, or goes through `log_y`."""
    made = scene((at_m - 40.0, 0, 10), (80, 3.2, 0), **{"road": zebra(), **changes})
    made = walked(made, 1, 0 * TIME + at_m, from_y + 0 * TIME if log_y is None else log_y)
    y = from_y - np.sign(from_y) * speed * np.maximum(TIME - begins_s, 0.0)
    return crash(made, moved_through(made, 1, 0 * TIME + at_m, y))


def names(offences):
    return {offence.name for offence in offences}


def test_over_the_crossing_in_time_is_lawful():
    law = law_of(crossing(40.0, 0.3))
    assert law.conduct is Conduct.KEEPS_RULES
    assert law.adversary == ()
    assert OFFENCES_ON_FOOT.isdisjoint(law.unknown)
    assert names(law.ego) == {"gives_no_way"}


def test_beside_a_crossing_nearby_is_not():
    law = law_of(crossing(30.0, 0.3))
    assert names(law.adversary) == {"off_crossing"}
    assert law.conduct is Conduct.GROSS


def test_far_from_any_crossing_one_may_cross():
    assert law_of(crossing(110.0, 0.3)).conduct is Conduct.KEEPS_RULES
    assert names(law_of(crossing(80.0, 0.3)).adversary) == {"off_crossing"}


def test_what_its_log_did_is_no_offence():
    across = FAR - 1.4 * np.maximum(TIME - 4.0, 0.0)  # behind the ego
    assert law_of(crossing(30.0, 0.3, log_y=across)).conduct is Conduct.KEEPS_RULES


def test_who_walks_as_in_its_log_does_nothing_against_the_law():
    """The log crosses off the crossing and too near; the attack repeats it, or changes it only after stepping out."""
    walk = NEAR + 1.4 * np.maximum(TIME - 2.6, 0.0)
    hit = crossing(30.0, 2.6, from_y=NEAR, log_y=walk)
    slower = moved(hit, 1, y=np.where(TIME > 3.6, walk[36] + 0.7 * (TIME - 3.6), walk))
    for made in (hit, crash(hit.before_attack(), slower)):
        assert law_of(made).adversary == ()


def test_beside_all_lanes_of_a_hilly_map_no_lane_is_near():
    lane = Lane("up", np.array([[0.0, 0.0], [100.0, 0.0]]), 3.2, 15.0, height=np.array([0.0, 5.0]))
    road = RoadMap((lane,), (), shapely.box(0.0, -2.0, 100.0, 2.0))
    beside = from_lane_centre(road, np.array([50.0]), np.array([30.0]), np.zeros(1), np.zeros(1))
    assert np.isinf(beside).all()


def test_tables_count_the_law_of_the_kind():
    hit = crossing(40.0, 0.3)
    on_foot = replace(hit, judgement=Judgement((), law=law_of(hit)))
    agents = tuple(replace(one, kind="car") if i else one for i, one in enumerate(hit.agents))
    driven = replace(on_foot, agents=agents)
    assert told_offences(on_foot) >= OFFENCES_ON_FOOT
    assert told_offences(driven).isdisjoint(OFFENCES_ON_FOOT)


def test_to_step_out_too_near_is_an_offence_but_on_green():
    assert names(law_of(crossing(40.0, 2.6, from_y=NEAR)).adversary) == {"steps_out"}
    lit = zebra(light=True)
    assert law_of(crossing(40.0, 2.6, from_y=NEAR, road=lit, signals=(GREEN,))).conduct is Conduct.KEEPS_RULES


def test_on_red():
    law = law_of(crossing(40.0, 0.3, road=zebra(light=True), signals=(RED,)))
    assert names(law.adversary) == {"red_light"}
    assert law.conduct is Conduct.GROSS


def test_what_a_map_does_not_tell():
    assert law_of(crossing(40.0, 0.3, road=zebra(light=True))).unknown == ("red_light",)
    bare = law_of(crossing(40.0, 0.3, road=scene((0, 0, 1)).road))
    assert bare.conduct is Conduct.UNKNOWN
    assert set(bare.unknown) >= OFFENCES_ON_FOOT
    assert bare.adversary == ()


def test_who_gives_way_is_told_by_the_network():
    assert "gives_no_way" in names(law_of(crossing(40.0, 0.3, road=zebra(person_first=False))).adversary)


@pytest.mark.parametrize(
    ("hit", "rule", "blamed"),
    [
        (crossing(40.0, 0.3), "gives_way", "ego"),
        (crossing(40.0, 0.3, road=zebra(person_first=False)), "gives_way", "adversary"),
        (crossing(40.0, 2.6, from_y=NEAR), "steps_out", "adversary"),
        (crossing(40.0, 0.3, road=zebra(light=True), signals=(RED,)), "breaks_law", "adversary"),
        (crossing(40.0, 0.3, road=zebra(light=True), signals=(GREEN,)), "breaks_law", "ego"),
        (crossing(30.0, 0.1, speed=0.8, from_y=NEAR), "steps_out", "both"),
        (crossing(30.0, 0.3), "steps_out", "both"),  # in time, on the far side of the street
    ],
)
def test_fault_with_crossings(hit, rule, blamed):
    found = fault(hit)
    assert (found.rule, found.at_fault) == (rule, blamed), found.reason


def of_a_log(road=None, lit=False):
    """The street as the map of a log: a carriageway with a crossing, nothing beside it, no table of priorities."""
    road = road or zebra()
    crossings = tuple(replace(one, signal=None) for one in road.walkways if one.kind == "crossing")
    beside = shapely.union_all([one.area for one in road.walkways if one.kind != "crossing"])
    links = tuple(replace(link, signal="L" if lit else None, link=0) for link in road.connections)
    return RoadMap(road.lanes, links, shapely.difference(road.drivable, beside), crossings=crossings)


ELSEWHERE = Signal("far", ((0, "r"),))


def test_a_log_that_tells_its_crossings_tells_the_law_of_pedestrians():
    road = of_a_log()
    assert names(law_of(crossing(30.0, 0.3, road=road)).adversary) == {"off_crossing"}
    assert names(law_of(crossing(40.0, 2.6, from_y=NEAR, road=road)).adversary) == {"steps_out"}
    assert law_of(crossing(110.0, 0.3, road=road)).conduct is Conduct.KEEPS_RULES
    none_at_all = law_of(crossing(30.0, 0.3, road=replace(road, crossings=())))
    assert (none_at_all.conduct, none_at_all.unknown) == (Conduct.KEEPS_RULES, ("red_light",))
    untold = law_of(crossing(30.0, 0.3, road=replace(road, crossings=None)))
    assert untold.conduct is Conduct.UNKNOWN


@pytest.mark.parametrize(
    ("lit", "signals", "known"),
    [(False, (ELSEWHERE,), True), (False, (), False), (True, (replace(ELSEWHERE, id="L"),), False)],
    ids=["none here", "perhaps not recorded", "here"],
)
def test_drivers_let_pedestrians_pass_on_the_crossings_of_a_log_where_there_is_no_light(lit, signals, known):
    hit = crossing(40.0, 0.3, road=of_a_log(lit=lit), signals=signals)
    law = law_of(hit)
    assert ("gives_no_way" not in law.unknown, names(law.ego)) == (known, {"gives_no_way"} if known else set())
    assert law.conduct is (Conduct.KEEPS_RULES if known else Conduct.UNKNOWN)
    assert "red_light" in law.unknown
    if known:
        assert (fault(hit).rule, fault(hit).at_fault) == ("gives_way", "ego")
