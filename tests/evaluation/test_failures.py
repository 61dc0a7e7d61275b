from dataclasses import replace

import numpy as np
import pytest
from scenes import moved, scene

from regents_cosim.evaluation.crashes.failures import count_reasons, failing_offences, failure_reason, may_reach
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.judgement import Flaw, Judgement, Law, Offence, ReferenceDrive


def attacked(*cars, outcome="no_collision", judgement=None, **record):
    made = scene(*cars)
    names = tuple(agent.id for agent in made.agents[1:])
    attack = AttackRecord(made.id, "focused", "idm", outcome, 3, candidates=names, **record)
    return replace(made, attack=attack, log=made.tracks, judgement=judgement)


NEAR = ((0, 0, 10), (30, 3.2, 10))
LAWFUL = Law((), ())
UNLAWFUL = Law((Offence("red_light", 1.0, 0.1, 3.0, "m"), Offence("tailgating", 1.0, 0.1, 3.0, "m")), ())
AVOIDS, CRASHES = ((ReferenceDrive("careful", avoids),) for avoids in (True, False))
TELLING = Judgement((), law=LAWFUL, drivers=AVOIDS)
CARELESS = Judgement((), law=LAWFUL, drivers=CRASHES)
BREAKS_THE_LAW = Judgement((), law=UNLAWFUL, drivers=AVOIDS)


@pytest.mark.parametrize(
    ("results", "reason"),
    [
        ([attacked(*NEAR, outcome="no_candidate")], "no_candidate"),
        ([attacked(*NEAR)], "stuck"),
        ([attacked(*NEAR, spoilt=True)], "spoilt_only"),
        ([attacked(*NEAR, outcome="collision", judgement=Judgement((Flaw.OFF_ROAD,)))], "spoilt_only"),
        ([attacked(*NEAR, outcome="collision", judgement=BREAKS_THE_LAW)], "gross_offence_only"),
        ([attacked(*NEAR, outcome="collision", judgement=Judgement(()))], "not_known"),
        ([attacked(*NEAR, outcome="collision", judgement=CARELESS)], "careful_driver_crashes_too"),
        (
            [attacked(*NEAR, outcome="collision", judgement=j) for j in (BREAKS_THE_LAW, CARELESS)],
            "careful_driver_crashes_too",
        ),
        ([attacked(*NEAR, outcome="collision", judgement=j) for j in (CARELESS, TELLING)], None),
        ([attacked((0, 0, 30), (-250, 0, 0))], "out_of_reach"),
    ],
)
def test_the_reason(results, reason):
    assert failure_reason(results) == reason
    assert sum(count_reasons([results]).values()) == (reason is not None)


def test_what_law_was_broken_where_that_is_all_that_is_wrong():
    unlawful, careless = (attacked(*NEAR, outcome="collision", judgement=j) for j in (BREAKS_THE_LAW, CARELESS))
    assert failing_offences([unlawful]) == {"red_light"}
    assert failing_offences([unlawful, careless]) == set()


def test_reach_grows_with_time_and_acceleration():
    # 8 s of full acceleration from standstill, and 4.9 m between centres that touch
    most_m = 0.5 * ACCEL_LIMIT * 8.0**2 + 4.9
    assert may_reach(attacked((0, 0, 0), (most_m - 1.0, 0, 0)))
    assert not may_reach(attacked((0, 0, 0), (most_m + 1.0, 0, 0)))


def test_who_enters_late_has_less_time():
    late = attacked((0, 0, 0), (100, 0, 0))
    assert may_reach(late)
    tracks = moved(late, 1, valid=np.arange(81) >= 40)
    assert not may_reach(replace(late, tracks=tracks, log=tracks))
