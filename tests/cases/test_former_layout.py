"""Cases of the layout before: `former/` holds three as they were written, with words in the settings of the attack."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import hypothesis.strategies as st
import msgspec
import pytest
from hypothesis import given

from regents_cosim.attack_record import AttackRecord
from regents_cosim.cases.content_hash import content_hash, in_former_layout, up_to_date
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.planners.find import attacked_planners
from regents_cosim.replays.replay import replay
from regents_cosim.saving import save_unlisted
from regents_cosim.verdicts.judge import judge

FORMER = Path(__file__).parent / "former"
CASES = find_cases(FORMER)
HASHES = {entry.case: entry.hash for entry in load_manifest(FORMER).cases}
SEVERAL, HIGHWAY = "crossing-several", "merge-v1-00002.4s-e005.ego-focused-idm-e005.car002"


@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_a_former_case_keeps_its_hash_and_says_the_same_when_it_is_saved_again(folder, tmp_path):
    case = load_case(folder)
    assert content_hash(case) == HASHES[case.id]
    again = save_unlisted(case, tmp_path)
    written = json.loads((again / "scenario.json").read_text())
    assert (written["schema"], written["hash"]) == (3, HASHES[case.id])
    assert {"against", "crashed", "kinds", "dynamics"}.isdisjoint(written["attack"]["settings"])
    assert load_case(again).attack == case.attack == load_header(folder).attack


def test_words_in_the_settings_become_fields():
    several = load_case(FORMER / SEVERAL)
    assert several.attack.against == ("constant_velocity", "rss")
    assert several.attack.crashed == ("idm", "constant_velocity")
    assert several.attack.promised == ("crossing_path", "cut_in")
    assert attacked_planners(several) == ("idm", "constant_velocity", "rss")
    assert (several.dynamics, load_case(FORMER / HIGHWAY).dynamics) == ("bicycle", "highway")


@pytest.mark.slow
@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_a_former_case_is_replayed_and_judged_as_ever(folder):
    case = load_case(folder)
    judged = judge(replace(case, judgement=None, evasion=None))
    assert apart_from_the_law(judged.judgement) == apart_from_the_law(case.judgement)
    assert replay(case, "mirror").verified


def apart_from_the_law(judgement):
    """The judgement but for the rules of the law, which have editions, and for the last bits of its numbers."""
    values = json.loads(json.dumps(asdict(judgement)), parse_float=lambda number: round(float(number), 6))
    return {name: value for name, value in values.items() if name not in ("law", "edition")}


names = st.lists(st.from_regex(r"[a-z_:.]{1,8}", fullmatch=True), max_size=3).map(tuple)


@given(names, st.none() | names, st.none() | names, st.sampled_from([None, "bicycle", "highway"]))
def test_both_layouts_say_the_same(against, crashed, promised, dynamics):
    record = AttackRecord("case", "king", "idm", "no_collision", 1, settings={"starts": 2}, against=against,
                          crashed=crashed, promised=promised, dynamics=dynamics)  # fmt: skip
    former = in_former_layout(msgspec.json.decode(msgspec.json.encode(record)))
    assert up_to_date(msgspec.convert(former, AttackRecord)) == record
