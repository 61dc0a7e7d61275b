"""Requested kinds of crash: how they are typed and counted, and when there are enough."""

import json
from collections import Counter

import numpy as np
import pytest
from scenes import DT, TIME, crash, moved, scene
from short_searches import SHORT
from test_attack_run import begun, ends, tree

from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.errors import RegentsError
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import SCHEMA, DoneUnit, LedgerRecord, RunBegun, RunPlan, WorkUnit
from regents_cosim.runs.requests import parse_manoeuvres


def test_what_is_typed():
    assert parse_manoeuvres([], 8) is None
    assert dict(parse_manoeuvres(["cut_in=10", "hard_brake"], 8).counts) == {"cut_in": 10, "hard_brake": 8}
    rounds = list(parse_manoeuvres(["cut_in=10"], 8).windows())
    assert rounds[:3] == [40, 160, 640]
    assert rounds[-1] <= 1_000_000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["cutin"], "unknown tag 'cutin': did you mean cut_in"),
        (["junction"], "unknown tag 'junction'"),  # no crash is of that kind
        (["cut_in=0"], "expected a number from 1"),
        (["cut_in=x"], "expected a number from 1"),
        (["cut_in", "cut_in=3"], "given twice"),
    ],
)
def test_what_is_refused(words, said):
    with pytest.raises(RegentsError, match=said):
        parse_manoeuvres(words, 8)


def test_who_keeps_to_the_law_breaks_none():
    wanted = parse_manoeuvres(["wrong_way", "cut_in"], 1)
    with pytest.raises(RegentsError, match="--manoeuvre wrong_way: .* expected `adversary_may` anything"):
        wanted.require_possible(METHODS["focused"])
    wanted.require_possible(METHODS["focused"].but(adversary_may="anything"))
    parse_manoeuvres(["cut_in"], 1).require_possible(METHODS["focused"])
    assert not wanted.lawful


def hard_brake(name="brake"):
    """A crash into a car that brakes."""
    made = scene((0.0, 0.0, 10.0), (12.0, 0.0, 10.0), name=name)
    speed = np.maximum(10.0 - 6.0 * TIME, 0.0)
    x = 12.0 + np.append(0.0, (0.5 * DT * (speed[1:] + speed[:-1])).cumsum())
    return crash(made, moved(made, 1, x=x, speed=speed))


def test_only_what_is_asked_for_is_taken_and_no_more_than_that():
    wanted, found = parse_manoeuvres(["hard_brake=2", "cut_in"], 1), Counter()
    assert [wanted.takes(hard_brake(), found) for _ in range(3)] == [True, True, False]
    assert not wanted.takes(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0)), found)
    assert not wanted.is_met(found)
    assert wanted.said(found, done({}, {}), ended=True).startswith(
        "2 of 2 hard_brake, 0 of 1 cut_in in 2 windows: the traffic holds no more"
    )
    found["cut_in"] += 1
    assert wanted.is_met(found)
    assert wanted.said(found, done({}, {}), ended=True) == "2 of 2 hard_brake, 1 of 1 cut_in in 2 windows"


def done(*said):
    """A finished run with the notes on its windows."""
    units = [WorkUnit(str(number), "key") for number in range(len(said))]
    begun = RunBegun(SCHEMA, identity("attack", {}, {}), (1, 1), 1)
    plan = RunPlan("key", tuple(units))
    return LedgerRecord(
        begun, plan, {unit.name: DoneUnit(unit, said=one) for unit, one in zip(units, said, strict=True)}
    )


def test_why_there_are_too_few_is_told_by_the_drives_that_were_looked_at():
    wanted = parse_manoeuvres(["merge_squeeze=3", "cut_in=2", "hard_brake"], 1)
    found, record = Counter(cut_in=1, hard_brake=1), done({"promised": ["cut_in"]}, {"promised": []}, {})
    assert wanted.said(found, record, ended=False).endswith(
        "in 3 windows so far; no drive to the ego on a lawful path leads to merge_squeeze in any of 2 windows; "
        "drives to the ego on lawful paths lead to cut_in in 1 of 2 windows"
    )
    assert "merge_squeeze in any of 2 windows: this traffic cannot serve it;" in wanted.said(found, record, ended=True)


def test_what_a_drive_leads_to_may_be_another_kind_than_it_is():
    cases = find_cases(shipped("scenarios") / "standard")
    cut_in = next(load_case(one) for one in cases if load_header(one).tags[:1] == ("cut_in",))
    wanted = parse_manoeuvres(["lane_drift"], 1)
    assert (wanted.of_drive(cut_in), wanted.of_crash(cut_in)) == ({"lane_drift"}, frozenset())
    wanted = parse_manoeuvres(["cut_in", "crossing_path"], 1)
    assert wanted.of_drive(cut_in) == wanted.of_crash(cut_in) == {"cut_in"}
    assert wanted.of_drive(hard_brake()) == wanted.of_crash(hard_brake()) == set()


@pytest.mark.slow
def test_the_command_records_until_it_has_enough(tmp_path):
    short = (f"--{name}={value}" for name, value in SHORT.items())
    words = ("attack", "-c", "shipped:crossing", "--manoeuvre", "crossing_path=2", *short, "--no-verify", "-o")
    assert ends(*words, "suite", cwd=tmp_path)
    (tmp_path / "suite").rename(tmp_path / "first")
    ledger = tmp_path / "suite" / ".run" / "ledger.jsonl"
    assert not ends(*words, "suite", cwd=tmp_path, killed=begun(ledger, 3, 0.0))
    assert ends(*words, "suite", cwd=tmp_path)
    assert tree(tmp_path / "suite") == tree(tmp_path / "first")
    tags = [json.loads(path.read_text())["tags"] for path in (tmp_path / "suite").glob("*/scenario.json")]
    assert len(tags) == 2
    assert all("crossing_path" in its for its in tags)
