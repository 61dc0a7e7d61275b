"""Cases of layouts before: `former/` holds three as they were written.

Their attacks have words in the settings, and their judgements say which of many manoeuvres avoid the crash.
"""

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from hypothesis import given

from regents_cosim.cases.content_hash import (
    FormerVerdict,
    content_hash,
    hash_as_stored,
    in_former_layout,
    up_to_date,
)
from regents_cosim.cases.files import load_case, load_header, note_holds
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.cases.suite import CasesOnDisk, hashes_of
from regents_cosim.cases.track_files import load_tracks
from regents_cosim.errors import CaseError
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, save_baseline
from regents_cosim.evaluation.suites.folders import check_suite, judge_into, merge_into
from regents_cosim.replays.replay import replay
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.judgement import Holds, Judgement
from regents_cosim.verdicts.judge import judge

FORMER = Path(__file__).parent / "former"
CASES = find_cases(FORMER)
HASHES = {entry.case: entry.hash for entry in load_manifest(FORMER).cases}
SEVERAL, HIGHWAY = "crossing-several", "merge-v1-00002.4s-e005.ego-focused-idm-e005.car002"


@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_a_former_case_says_the_same_when_it_is_saved_again(folder, tmp_path):
    case = load_case(folder)
    again = save_unlisted(case, tmp_path)
    written, read = json.loads((again / "scenario.json").read_text()), load_case(again)
    assert (written["schema"], written["hash"]) == (3, content_hash(case))
    assert {"against", "crashed", "kinds", "dynamics"}.isdisjoint(written["attack"]["settings"])
    assert {"avoidability", "unavoidable"}.isdisjoint(written["judgement"])
    assert read.attack == case.attack == load_header(folder).attack
    assert read.judgement == case.judgement
    assert np.array_equal(read.evasion.x, case.evasion.x)


def test_a_former_suite_is_whole_and_stays_so_when_it_is_merged_or_judged(tmp_path):
    suite = shutil.copytree(FORMER, tmp_path / "suite")
    driven = {case: DriveOutcome(digest, "no_collision") for case, digest in HASHES.items()}
    save_baseline(suite / "baseline.json", Baseline().accepting("idm", "mirror", driven, driven))
    assert hashes_of(CasesOnDisk(find_cases(suite))) == [HASHES[folder.name] for folder in find_cases(suite)]
    merge_into(tmp_path / "merged", [suite], seed=0)
    judge_into(tmp_path / "judged", suite)
    made, again = (load_manifest(place) for place in (suite, tmp_path / "judged"))
    assert (again.command, again.versions) == (made.command, made.versions)
    note_holds(suite / SEVERAL, Holds(replayed=True))
    assert load_case(suite / SEVERAL).judgement.holds.replayed
    for place in (suite, tmp_path / "merged", tmp_path / "judged"):
        assert [(row.problem, row.baselines) for row in check_suite(place)] == [("", 1)] * 3


def edited(folder, to, change):
    """A copy of a former case with another judgement, and the hash that it has with it."""
    case = shutil.copytree(folder, to / folder.name)
    shutil.copytree(FORMER / "maps", to / "maps")
    header = json.loads((case / "scenario.json").read_text())
    change(header["judgement"])
    judgement = msgspec.convert(header["judgement"], Judgement)
    former = msgspec.convert(header["judgement"], FormerVerdict)
    made = replace(load_case(folder), judgement=judgement, evasion=None)
    header["hash"] = hash_as_stored(made, former, load_tracks(case / "evasion.npz"))
    (case / "scenario.json").write_text(json.dumps(header))
    return case


def crashes(judgement):
    judgement["drivers"][0]["avoids"] = False


def another_is_shown(judgement):
    judgement["avoidability"]["gentlest"]["driver"] = None


@pytest.mark.parametrize("change", [crashes, another_is_shown])
def test_a_former_evasion_that_is_not_the_careful_drivers_is_left_out(change, tmp_path):
    case = load_case(edited(FORMER / SEVERAL, tmp_path, change))
    assert case.evasion is None
    assert load_case(save_unlisted(case, tmp_path / "again")).judgement == case.judgement


def test_a_changed_former_verdict_is_seen(tmp_path):
    case = edited(FORMER / SEVERAL, tmp_path, lambda judgement: None)
    assert load_case(case).evasion is not None
    file = case / "scenario.json"
    file.write_text(file.read_text().replace('"tried": 7338', '"tried": 7339'))
    with pytest.raises(CaseError, match="content hash"):
        load_case(case)


def test_words_in_the_settings_become_fields():
    several = load_case(FORMER / SEVERAL)
    assert (several.attack.planner, several.attack.against) == ("idm", ("constant_velocity", "rss"))
    assert several.attack.crashed == ("idm", "constant_velocity")
    assert several.attack.promised == ("crossing_path", "cut_in")
    assert (several.dynamics, load_case(FORMER / HIGHWAY).dynamics) == ("bicycle", "highway")


@pytest.mark.slow
@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_a_former_case_is_replayed_and_judged_as_ever(folder):
    case = load_case(folder)
    judged = judge(replace(case, judgement=None, evasion=None))
    assert apart_from_the_law(judged.judgement) == apart_from_the_law(case.judgement)
    assert replay(case, "mirror").verified


def apart_from_the_law(judgement):
    """The judgement but for the law and the careful driver's times, whose rules have editions, to six decimals."""
    values = json.loads(json.dumps(asdict(judgement)), parse_float=lambda number: round(float(number), 6))
    values["drivers"] = [drive["avoids"] for drive in values["drivers"] if drive["driver"] == "careful"]
    return {name: value for name, value in values.items() if name not in ("law", "edition")}


names = st.lists(st.from_regex(r"[a-z_:.]{1,8}", fullmatch=True), max_size=3).map(tuple)


@given(names, st.none() | names, st.none() | names, st.sampled_from([None, "bicycle", "highway"]))
def test_both_layouts_say_the_same(against, crashed, promised, dynamics):
    record = AttackRecord("case", "king", "idm", "no_collision", 1, settings={"starts": 2}, against=against,
                          crashed=crashed, promised=promised, dynamics=dynamics)  # fmt: skip
    former = in_former_layout(msgspec.json.decode(msgspec.json.encode(record)))
    assert up_to_date(msgspec.convert(former, AttackRecord)) == record
