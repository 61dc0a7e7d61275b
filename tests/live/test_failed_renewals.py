"""What happens to an attack whose plan would miss: changed, then other drives of the same vehicle, then let go."""

from dataclasses import replace

import numpy as np
import pytest
from one_road import OneRoad

from regents_cosim.live.attacker import AttackCounts, Attacker
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.moments import DT_S
from regents_cosim.live.search.plan import Plan
from regents_cosim.simulators.sumo.types import VehicleType

CAR = VehicleType("car", 5.0, 1.8)
SINCE_S = np.arange(81) * DT_S


def a_plan(begun_s):
    """To go on along y = 50 at 10 m/s; it meets the ego seven seconds later."""
    flat = np.zeros(len(SINCE_S))
    return Plan("other", begun_s, 10.0 * (begun_s + SINCE_S), flat + 50.0, flat, flat + 10.0, begun_s + 7.0)


class Plans:
    """Answers as told: whether a plan can be changed, and whether another drive is found."""

    def __init__(self, renews, redraws):
        self.renews, self.redraws, self.asked = iter(renews), iter(redraws), []

    def prepare(self, frame):
        pass

    def forecast(self, frame):
        return None

    def homeward(self, frame, name):
        return None

    def renewed(self, frame, plan):
        self.asked.append(("renewed", round(frame.time_s, 2)))
        return a_plan(frame.time_s) if next(self.renews) else None

    def redrawn(self, frame, adversary):
        self.asked.append(("redrawn", round(frame.time_s, 2)))
        return a_plan(frame.time_s) if next(self.redraws) else None


def asked_in(seconds, plans, replan_s=0.5):
    """What an attacker asks for, and whether it still attacks after so many seconds."""
    attacker = Attacker(OneRoad(), plans, replan_s, AttackCounts(), lambda *_: None, first=a_plan(0.0))
    for step in range(round(seconds / DT_S)):
        x, y = np.array([0.0, 10.0 * step * DT_S]), np.array([0.0, 50.0])
        flat = np.zeros(2)
        attacker.step(Frame(step * DT_S, ("ego", "other"), x, y, flat, flat + 10.0, flat, (CAR, CAR), {}), lambda: True)
        if attacker.attack is None:
            break
    return plans.asked, attacker.attack is not None


def test_after_a_failed_renewal_the_other_drives_of_the_vehicle_are_tried_and_it_goes_on():
    asked, attacks = asked_in(1.6, Plans(renews=[True, False, True], redraws=[True]))
    assert asked == [("renewed", 0.5), ("renewed", 1.0), ("redrawn", 1.2)]
    assert attacks


def test_renewals_keep_their_times_where_no_other_drive_is_found():
    asked, attacks = asked_in(1.3, Plans(renews=[False, True], redraws=[False]))
    assert asked == [("renewed", 0.5), ("redrawn", 0.7), ("renewed", 1.0)]
    assert attacks


@pytest.mark.parametrize("replan_s", [0.5, 0.2])
def test_after_three_failures_in_a_row_with_no_other_drive_it_is_let_go(replan_s):
    asked, attacks = asked_in(3.0, Plans(renews=[False] * 3, redraws=[False] * 3), replan_s)
    assert [what for what, _ in asked] == ["renewed", "redrawn"] * 3
    assert not attacks


def test_another_drive_that_is_found_ends_the_row_of_failures():
    plans = Plans(renews=[False, False, False, True], redraws=[False, False, True])
    _, attacks = asked_in(2.5, plans)
    assert attacks


def test_a_vehicle_that_returns_is_planned_again_every_half_a_second_however_seldom_attacks_are():
    class Returns(Plans):
        def homeward(self, frame, name):
            self.asked.append(("homeward", round(frame.time_s, 2)))
            return replace(a_plan(frame.time_s), meets_s=np.inf)

    plans, flat = Returns([], []), np.zeros(2)
    attacker = Attacker(OneRoad(), plans, 5.0, AttackCounts(), lambda *_: None, first=a_plan(-8.0))
    for step in range(12):
        y = np.array([0.0, 50.0])
        frame = Frame(step * DT_S, ("ego", "other"), flat, y, flat, flat + 10.0, flat, (CAR, CAR), {})
        attacker.step(frame, lambda: True)
    assert attacker.state == "returning"
    assert plans.asked == [("homeward", 0.1), ("homeward", 0.6), ("homeward", 1.1)]
