"""Drives are chosen by the kind of crash that they lead to, and searched from in that order."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import scene
from shipped_cases import shipped_window

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.attacks.starts.timed_drives import Start
from regents_cosim.attacks.starts.wanted_manoeuvres import of_wanted_manoeuvres
from regents_cosim.cases.shipped import network_config
from regents_cosim.runs.requests import parse_manoeuvres
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.record import record

BEFORE = scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0), name="before")
STEPS = BEFORE.tracks.steps


def drive(x):
    """A drive that stands still at `x`."""
    return Start(np.full(STEPS, x), np.zeros(STEPS), np.zeros(STEPS), np.zeros(STEPS), 0, (0.0, 0.0, 0.0), 0.0)


@dataclass(frozen=True)
class ByPlace:
    """Kinds of crash that depend only on where the adversary stands."""

    places: dict
    lawful = True

    def of_drive(self, case):
        return frozenset(self.places.get(float(case.tracks.x[1, 0]), ""))

    def of_crash(self, case):
        raise NotImplementedError


def chosen(places, most=3):
    drives = [drive(float(x)) for x in range(6)]
    found, kinds = of_wanted_manoeuvres(BEFORE, BEFORE.tracks, 1, drives, ByPlace(places), most)
    return [int(one.x[0]) for one in found], "".join(sorted(kinds))


def test_kinds_take_turns_in_the_order_of_promise_and_others_are_left_out():
    assert chosen({1.0: "a", 2.0: "a", 3.0: "b", 5.0: "a"}) == ([1, 3, 2], "ab")
    assert chosen({1.0: "a", 2.0: "a", 3.0: "b", 5.0: "a"}, most=9) == ([1, 3, 2, 5], "ab")
    assert chosen({4.0: "ab", 5.0: "b"}) == ([4, 5], "ab")
    assert chosen({}) == ([], "")


def test_a_drive_is_the_crash_that_it_would_make_were_the_ego_to_drive_on():
    ego, seen = replace(BEFORE.tracks, x=BEFORE.tracks.x + 3.0), []

    class Seeing(ByPlace):
        def of_drive(self, case):
            seen.append(case)
            return frozenset("a")

    of_wanted_manoeuvres(BEFORE, ego, 1, [drive(7.0)], Seeing({}), 1)
    (met,) = seen
    np.testing.assert_array_equal(met.tracks.x[0], ego.x[0])
    np.testing.assert_array_equal(met.tracks.x[1], 7.0)
    assert [agent.role for agent in met.agents][1] == "adversary"
    assert BEFORE.tracks.x[1, 0] == 30.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["crossing_path", "cut_out"])
def test_only_crashes_of_the_kind_are_found_and_where_no_drive_leads_to_one_nothing_is_searched(kind):
    wanted, few = parse_manoeuvres([kind], 1), REGENTS_FOCUSED.but(iterations=50)
    (found,) = attack_each([shipped_window("crossing-1")], few, "idm", wanted=wanted)
    promised = found[0].attack.promised
    crashes = [case for case in found if case.attack.outcome == "collision"]
    assert all(kind in wanted.of_crash(case) for case in crashes)
    assert bool(promised) == bool(crashes) == (kind == "crossing_path")
    assert promised or found[0].attack.rollouts == 1


@pytest.mark.slow
def test_a_cut_out_is_found_where_traffic_has_one_that_leaves_the_lane_late():
    source = SumoInput(network_config("exit_lane"), end_s=65.0, ego="road.onward.passenger.2")
    (window,), wanted = record(source, count=1, seed=5), parse_manoeuvres(["cut_out"], 1)
    ((crash,),) = attack_each([window], REGENTS_FOCUSED, "constant_velocity", wanted=wanted)
    assert crash.attack.outcome == "collision"
    assert wanted.of_crash(crash) == {"cut_out"}
    (seen_through,) = attack_each([window], REGENTS_FOCUSED.but(iterations=5), "idm", wanted=wanted)
    assert all(case.attack.outcome != "collision" for case in seen_through)
