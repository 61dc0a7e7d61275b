"""When an attacker looks for a plan, and what it does in the steps between."""

from dataclasses import replace

import numpy as np
import pytest
from one_road import OneRoad

from regents_cosim.live.attacker import AttackCounts, Attacker
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.search.plan import Plan
from regents_cosim.simulators.sumo.types import VehicleType

CAR = VehicleType("car", 5.0, 1.8)
FLAT = np.zeros(81)
PLAN = Plan("other", 0.2, FLAT, FLAT + 50.0, FLAT, FLAT + 10.0, meets_s=7.0)


class Looks:
    """Finds nothing at looks, and `sampled` in the step after the look at `of_s`."""

    def __init__(self, sampled=None, of_s=0.2):
        self.looked_s, self.at_once, self.between, self._sampled, self._of_s = [], [], 0, sampled, of_s

    def prepare(self, frame):
        self.between += 1

    def forecast(self, frame):
        return None

    def fresh(self, frame, barred, at_once):
        self.barred = set(barred)
        self.looked_s.append(round(frame.time_s, 2))
        self.at_once.append(at_once)

    def sampled(self):
        return (self._sampled, None) if self._sampled is not None and self.looked_s[-1] == self._of_s else None

    def renewed(self, frame, plan):
        return plan


def watched(plans, step_s=0.1, replan_s=0.5, until_s=0.85, wanted=lambda: True, seen=("ego", "other")):
    attacker, flat = Attacker(OneRoad(step_s), plans, replan_s, AttackCounts(), lambda *_: None), np.zeros(len(seen))
    for step in range(round(until_s / step_s) + 1):
        y = np.arange(len(seen)) * 50.0
        frame = Frame(step_s * step, seen, flat, y, flat, flat + 10.0, flat, (CAR,) * len(seen), {})
        attacker.step(frame, wanted)
    return attacker


def test_a_look_comes_every_fifth_of_a_second():
    plans = Looks()
    watched(plans)
    assert plans.looked_s == [0.0, 0.2, 0.4, 0.6, 0.8]
    assert plans.between == 4
    assert not any(plans.at_once)


@pytest.mark.parametrize(("step_s", "replan_s"), [(0.2, 0.5), (0.5, 0.5), (0.1, 0.1)])
def test_where_every_step_has_a_look_it_does_all_at_once(step_s, replan_s):
    plans = Looks()
    watched(plans, step_s, replan_s)
    assert plans.between == 0
    assert all(plans.at_once)


def test_what_samples_find_between_two_looks_begins_then():
    attacker = watched(Looks(PLAN), until_s=0.3)
    assert attacker.state == "attacking"
    assert attacker.attack.begun_s == pytest.approx(0.3)


@pytest.mark.parametrize("how", [{"wanted": lambda: False}, {"seen": ("ego", "third")}])
def test_it_does_not_begin_where_it_is_not_wanted_any_more_or_its_vehicle_is_gone(how):
    plans = Looks(PLAN)
    plans.looked_s.append(0.2)
    assert watched(plans, until_s=0.35, **how).state == "watching"


def test_a_vehicle_that_goes_out_of_sight_late_in_its_attack_is_left_alone_for_a_while():
    plans, flat = Looks(), np.zeros(2)
    first = replace(PLAN, begun_s=0.0, meets_s=20.0)
    attacker = Attacker(OneRoad(), plans, 0.5, AttackCounts(), lambda *_: None, first)
    for step in range(120):
        seen = ("ego", "other" if step < 110 else "third")
        y = np.array([0.0, 50.0])
        attacker.step(Frame(0.1 * step, seen, flat, y, flat, flat + 10.0, flat, (CAR, CAR), {}), lambda: True)
    assert plans.looked_s
    assert plans.barred == {"other"}


def test_a_vehicle_whose_route_cannot_be_changed_is_given_back():
    class Fails(OneRoad):
        def follow_route_of(self, plan):
            raise ValueError("no route")

    attacker, flat = Attacker(Fails(), Looks(), 0.5, counts := AttackCounts(), lambda *_: None, PLAN), np.zeros(2)
    frame = Frame(0.2, ("ego", "other"), flat, np.array([0.0, 50.0]), flat, flat + 10.0, flat, (CAR, CAR), {})
    with pytest.raises(ValueError, match="no route"):
        attacker.step(frame, lambda: True)
    attacker.let_go()
    assert counts.given_back == 1
