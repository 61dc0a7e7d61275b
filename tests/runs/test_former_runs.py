"""Folders that older versions made with `attack --archive` are suites; their runs are merged, and not continued."""

import json

import pytest
from made_crashes import MadeCrashes, window

from regents_cosim.attacks.methods.presets import preset
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.folders import attack_into, grow_suite
from regents_cosim.runs.merging import merge_shards
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.status import runs_in
from regents_cosim.runs.traffic import SavedCases
from regents_cosim.saving import SuiteWriter

RUN = MadeCrashes(preset("king"), PlannerUnderTest.of("constant_velocity"), verify=False, pictures=False)
MAP = {"archive": ["manoeuvre", "closing_speed"], "rollouts": 0}
_OF_CRASH = {
    "tags": ["hard_brake"], "collision_type": "rear_end_by_ego", "closing_m_s": 7.0, "departs_s": 2.5,
    "standing": "telling", "usual_percent": 50.0, "deviation_m": 1.0,
}  # fmt: skip


@pytest.fixture
def windows(tmp_path):
    for number in range(4):
        SuiteWriter(tmp_path / "windows", 0).add(window(number))
    return SavedCases(tmp_path / "windows")


def archived(windows, folder, shard=WHOLE):
    """A folder with the ledger of an older version, in which the crashes of a window stood apart from its cases."""
    attack_into(folder, RUN, windows, shard=shard)
    ledger = folder / ".run" / "ledger.jsonl"
    begun, plan, *done = map(json.loads, ledger.read_text().splitlines())
    begun["identity"]["settings"] |= MAP
    for one in done:
        one["crashes"] = [{"case": case, "hash": digest, **_OF_CRASH} for case, digest in one.pop("cases", [])]
    ledger.write_text("".join(json.dumps(line) + "\n" for line in (begun, plan, *done)))
    return folder


def test_the_suite_loads_and_grows_but_its_run_is_not_continued(windows, tmp_path):
    suite = archived(windows, tmp_path / "suite")
    before = {case.id for case in load_suite(suite)}
    with pytest.raises(CaseError, match=r"begun with archive .*choose another folder"):
        attack_into(suite, RUN, windows)
    assert [(one.state, one.done) for one in runs_in(suite)] == [("finished", 4)]
    assert grow_suite(suite, RUN, windows).windows == 4
    assert before <= {case.id for case in load_suite(suite)}


def test_its_shards_are_merged(windows, tmp_path):
    shards = [archived(windows, tmp_path / str(number), Shard(number, 2)) for number in (1, 2)]
    cases = sorted(case.id for shard in shards for case in load_suite(shard))
    assert merge_shards(tmp_path / "merged", shards) == len(cases)
    assert [case.id for case in load_suite(tmp_path / "merged")] == cases
    with pytest.raises(CaseError, match="begun with archive"):
        attack_into(tmp_path / "merged", RUN, windows)
