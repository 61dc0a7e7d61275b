"""The words for a judgement: whether a crash tells something, and what the planner should have done."""

from dataclasses import replace
from pathlib import Path

import pytest

from regents_cosim.evaluation.regression.baseline import DriveOutcome
from regents_cosim.evaluation.regression.comparison import RegressionVerdict, explain
from regents_cosim.evaluation.suites.cards import CaseCard
from regents_cosim.judgement import Flaw, Judgement, Law, Offence, ReferenceDrive
from regents_cosim.verdicts.words import advice, offences_words, telling_words

RED = Offence("red_light", 2.0, 0.5, 3.25, "m")
CLOSE = Offence("tailgating", 1.0, 0.5, 0.4, "s")
BRAKES = ReferenceDrive("careful", True, 1.2, 2.35)
TELLING = Judgement((), law=Law((CLOSE,), ()), drivers=(BRAKES,))


@pytest.mark.parametrize(
    ("judgement", "said"),
    [
        (TELLING, "yes: "),
        (replace(TELLING, flaws=(Flaw.OFF_ROAD,)), "no: something spoils it"),
        (replace(TELLING, law=Law((RED, CLOSE), ())), "no: the adversary breaks the law"),
        (replace(TELLING, drivers=(replace(BRAKES, avoids=False),)), "no: a careful driver crashes too"),
        (replace(TELLING, law=None), "not known: whether the adversary keeps the law"),
        (replace(TELLING, law=Law((), (), ("oncoming_lanes",))), "not known: whether the adversary keeps the law"),
        (replace(TELLING, drivers=()), "not known: what a careful driver does"),
        (Judgement(()), "not known: whether the adversary keeps the law and what a careful driver does"),
    ],
)
def test_why_a_crash_tells_or_not(judgement, said):
    assert telling_words(judgement).startswith(said)
    assert {"y": True, "n": False}[said[0]] is judgement.telling or said.startswith("not known")
    assert (judgement.telling is None) == said.startswith("not known")


@pytest.mark.parametrize(
    ("drivers", "said"),
    [
        ((BRAKES,), "a careful driver (UN R157) brakes from 2.4 s and avoids it"),
        (
            (replace(BRAKES, avoids=False), ReferenceDrive("fuzzy", True, 1.0, 1.9)),
            "the fuzzy safety model (JRC) brakes from 1.9 s and avoids it",
        ),
        (
            (replace(BRAKES, shift_m=-0.9),),
            "a careful driver (UN R157) brakes and swerves 0.9 m to the right from 2.4 s and avoids it",
        ),
        ((ReferenceDrive("careful", True),), "a careful driver (UN R157) goes on as the planner did and avoids it"),
        ((replace(BRAKES, avoids=False),), "no reference driver avoids it (careful)"),
        ((), None),
    ],
)
def test_what_the_planner_should_have_done(drivers, said):
    assert advice(replace(TELLING, drivers=drivers)) == said


def test_what_breaks_the_law_is_said_before_what_is_reported_only():
    assert offences_words((CLOSE, RED)) == (
        "red light from 2.0 s for 0.5 s (3.25 m); tailgating from 1.0 s for 0.5 s (0.4 s, reported only)"
    )
    assert offences_words(()) == "none"


def test_a_failure_says_it_on_a_line_of_its_own():
    crash = DriveOutcome("h", "collision", "car1", 30, 3.0, "t_bone")
    said = explain(
        RegressionVerdict("c", "regression", ("it collides",), None, crash),
        Path("s/c"),
        "mine",
        "mirror",
        "",
        advice(TELLING),
    )
    assert "\n  instead    a careful driver (UN R157) brakes from 2.4 s and avoids it\n" in said
    assert "instead" not in explain(
        RegressionVerdict("c", "regression", ("it collides",), None, crash), Path("s/c"), "mine", "mirror"
    )


def test_the_properties_of_a_case():
    card = CaseCard(
        "c", "grid", "t_bone", True, True, "idm", "king", "car1", "w", "h", True, "tailgating", "careful, rss"
    )
    crash = [("case_collision_type", "t_bone"), ("case_planner", "idm"), ("case_adversary", "car1")]
    words = ("case_offences", "case_preventable_by", "case_telling")
    assert dict(card.properties) == dict([*crash, *zip(words, ("tailgating", "careful, rss", "yes"), strict=True)])
    unknown = replace(card, telling=None, offences=None, preventable_by="")
    assert dict(unknown.properties) == dict([*crash, *zip(words, ("not known", "none", "not known"), strict=True)])
    assert replace(card, clean=None).properties == crash


@pytest.mark.parametrize("lawful", [True, False, None])
@pytest.mark.parametrize("careful", [True, False, None])
@pytest.mark.parametrize("flaws", [(), (Flaw.EGO_STANDS,)])
def test_a_crash_is_telling_where_all_conditions_are_known_to_hold(flaws, careful, lawful):
    law = Law((RED,) if lawful is False else (), (), ("oncoming_lanes",) if lawful is None else ())
    drivers = () if careful is None else (ReferenceDrive("careful", careful),)
    conditions = [not flaws, careful, lawful]
    expected = False if False in conditions else None if None in conditions else True
    assert Judgement(flaws, law=law, drivers=drivers).telling is expected
