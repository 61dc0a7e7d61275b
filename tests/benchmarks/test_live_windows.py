"""Cases that go on in SUMO's live traffic, with an adversary that aims again."""

from dataclasses import replace

import pytest
from shipped_cases import crash_on

from benchmarks.live_windows import ALL, LiveWindowEnd, drive_windows, live_rows
from regents_cosim.cases.files import load_case
from regents_cosim.errors import SumoError
from regents_cosim.mirror.programs.compiled import COMPILING

ALONE = LiveWindowEnd(None)


def test_windows_in_which_the_planner_crashes_by_itself_and_those_that_failed_count_for_nothing():
    case = load_case(crash_on("crossing"))
    hit = case.collision.agent
    ends = [
        (ALONE, LiveWindowEnd(hit, 1, case)),
        (ALONE, LiveWindowEnd("another", 1, case)),
        (ALONE, ALONE),
        (LiveWindowEnd(hit), LiveWindowEnd(hit, 1, case)),
        (ALONE, SumoError("it died")),
    ]
    elsewhere = replace(case, provenance=replace(case.provenance, file="elsewhere.sumocfg"))
    *places, all_ = live_rows([case] * 4 + [elsewhere], ends)
    assert [(row.n, row.failed) for row in places] == [(3, 0), (0, 1)]
    assert (all_.place, all_.n, all_.met_unattacked, all_.failed) == (ALL, 3, 1, 1)
    assert (all_.crashes, all_.clean, all_.met_another, all_.attacked) == (1, 1, 1, 2)
    assert all_.crash_percent == pytest.approx(33.3, abs=0.1)


@pytest.mark.slow
def test_a_recorded_adversary_is_taken_up_where_the_case_has_it():
    case = load_case(crash_on("roundabout"))
    ((alone, attacked),) = drive_windows([case], "idm", recorded=True)
    assert alone.met is None
    assert attacked.attacks
    assert attacked.crash
    assert attacked.met == case.collision.agent
    assert set(attacked.told) <= {COMPILING}
