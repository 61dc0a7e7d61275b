"""Windows of logs for the table of crashes, and what is counted of them."""

from dataclasses import replace

import log_files
import pytest

from benchmarks.log_benchmark import TUNED_ON, crash_rows_of, logged_windows
from regents_cosim.scenario.attack_record import AttackRecord, Collision
from regents_cosim.scenario.judgement import Flaw, Judgement, Law, Offence, ReferenceDrive

CAREFUL = (ReferenceDrive("careful", True, 1.0, 2.0),)
HIT = Collision("12", 1, 0.1, "side_swipe", 1.0, attributed=True)
MISTAKE = Offence("leaves_lane", 1.0, 1.0, 0.5, "m")


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    path = log_files.write_gpudrive(tmp_path_factory.mktemp("log"))
    ((name, windows),) = logged_windows([path], 3).items()
    assert name == "gpudrive"
    assert len({one.ego.id for one in windows}) == len(windows) >= 2
    assert windows[0].ego.id == "11"  # the log's own
    return windows[0]


def test_a_row_counts_each_window_once_by_the_crash_nearest_to_flawless(window):
    def ended(*judgements, outcome="collision"):
        record = AttackRecord(window.id, "focused", "idm", outcome, 1, HIT)
        return [replace(window, attack=record, judgement=one, log=window.tracks) for one in judgements or (None,)]

    def judged(*offences, unknown=(), flaws=()):
        return Judgement(flaws, drivers=CAREFUL, law=Law(offences, (), unknown))

    windows = [
        ended(judged(unknown=("gives_no_way", "red_light")), judged(flaws=(Flaw.OFF_ROAD,))),
        ended(judged(MISTAKE), judged()),
        ended(judged(MISTAKE), judged(MISTAKE, unknown=("gives_no_way",))),
        ended(judged(flaws=(Flaw.OFF_ROAD, Flaw.TOO_HARD))),
        ended(judged(unknown=("oncoming_lanes",))),
        ended(outcome="already_colliding"),
    ]
    of_tuned = replace(window.provenance, file=min(TUNED_ON))
    tuned = [replace(case, provenance=of_tuned) for case in windows[1]]
    row, other = crash_rows_of("made", [*windows, tuned])
    assert (row.traffic, other.traffic, other.windows, other.flawless) == ("held out", "tuned on", 1, 1)
    assert (row.windows, row.n, row.crashes, row.telling, row.flawless) == (6, 5, 5, 3, 1)
    assert (row.telling_unknown, row.law_unknown, row.spoilt) == (1, 2, 1)
    assert row.why_unknown == {"gives_no_way": 1, "red_light": 1, "oncoming_lanes": 1}
    assert row.why_spoilt == {"off_road": 1, "too_hard": 1}
    assert row.failures == {"spoilt_only": 1, "not_known": 1}
