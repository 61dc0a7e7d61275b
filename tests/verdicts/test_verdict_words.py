"""The words for a judgement: whether a crash tells something, and what the planner should have done."""

from dataclasses import replace
from typing import get_args

import pytest

from regents_cosim.evaluation.suites.cards import CaseCard
from regents_cosim.norms.grades import GROSS_OFFENCES, MISTAKES, Conduct, OffenceName, Prevention
from regents_cosim.scenario.judgement import Fault, Flaw, Judgement, Law, Offence, ReferenceDrive
from regents_cosim.verdicts.law.fault import RULES, RULES_ON_FOOT
from regents_cosim.verdicts.words import offences_words, telling_words, verdict_words

RED = Offence("red_light", 2.0, 0.5, 3.25, "m")
CLOSE = Offence("tailgating", 1.0, 0.5, 0.4, "s")
BRAKES = ReferenceDrive("careful", True, 1.2, 2.35)
NO_BRAKING = ReferenceDrive("careful", True)
TELLING = Judgement((), law=Law((CLOSE,), ()), drivers=(BRAKES,))


@pytest.mark.parametrize(
    ("judgement", "said"),
    [
        (
            TELLING,
            "yes, not flawless: The adversary follows the ego too closely. A careful driver brakes",
        ),
        (replace(TELLING, flaws=(Flaw.OFF_ROAD,)), "no: something spoils it"),
        (replace(TELLING, law=Law((RED, CLOSE), ())), "no: the adversary breaks the law grossly"),
        (replace(TELLING, drivers=(replace(BRAKES, shift_m=0.9),)), "no: braking alone does not prevent it"),
        (replace(TELLING, law=Law((), ())), "yes, even flawless: "),
        (
            replace(TELLING, law=Law((), (), ("gives_no_way",))),
            "yes, flawless is not known: Whether the adversary keeps the rules",
        ),
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
    ("judgement", "who", "said"),
    [
        (
            replace(TELLING, law=Law((replace(CLOSE, name="gives_no_way"),), ())),
            "The adversary",
            "The adversary does not give way to the ego. A careful driver brakes from 2.4 s and avoids it.",
        ),
        (
            replace(TELLING, law=Law((), (CLOSE,)), drivers=(replace(BRAKES, shift_m=-0.9),)),
            "The cyclist",
            "The cyclist keeps every rule; the ego follows the cyclist too closely. A careful driver brakes and "
            "swerves 0.9 m to the right from 2.4 s and avoids it; braking alone is not enough.",
        ),
        (
            replace(TELLING, law=Law((RED, CLOSE), ()), drivers=(replace(BRAKES, avoids=False),)),
            "The pedestrian",
            "The pedestrian passes a red light. A careful driver crashes too.",
        ),
        (
            replace(TELLING, law=Law((), ()), fault=Fault("ego", "rear_end", "")),
            "The adversary",
            "The adversary keeps every rule; the ego keeps too little distance to the adversary and is at fault. A "
            "careful driver brakes from 2.4 s and avoids it.",
        ),
        (
            replace(TELLING, law=Law((), ()), fault=Fault("adversary", "cut_in", "")),
            "The adversary",
            "The adversary cuts in too close to the ego and is at fault. A careful driver brakes from 2.4 s and avoids "
            "it.",
        ),
        (
            replace(TELLING, law=Law((), (CLOSE,)), fault=Fault("both", "side_swipe", ""), drivers=(NO_BRAKING,)),
            "The adversary",
            "The adversary moves sideways into the ego and is partly at fault; the ego follows the adversary too "
            "closely. A careful driver goes on as the planner did and avoids it.",
        ),
        (
            replace(TELLING, law=Law((), (), ("red_light", "leaves_way"))),
            "The adversary",
            "The adversary keeps every rule that can be told (not told: red light, leaves way). A careful driver "
            "brakes from 2.4 s and avoids it.",
        ),
        (
            replace(TELLING, law=Law((CLOSE,), (), ("oncoming_lanes",)), drivers=()),
            "The adversary",
            "The adversary follows the ego too closely; whether it breaks the law grossly is not known. Whether a "
            "careful driver avoids it is not known.",
        ),
        (
            Judgement(()),
            "The adversary",
            "Whether the adversary keeps the rules is not known. Whether a careful driver avoids it is not known.",
        ),
    ],
)
def test_both_grades_in_sentences_that_a_person_understands(judgement, who, said):
    assert verdict_words(judgement, who) == said


@pytest.mark.parametrize("at_fault", ["adversary", "both", "ego"])
@pytest.mark.parametrize("rule", sorted({rule.name for rule in (*RULES, *RULES_ON_FOOT)} - {"unclear"}))
def test_one_without_an_offence_keeps_every_rule_only_where_it_is_not_at_fault(rule, at_fault):
    crash = replace(TELLING, law=Law((), ()), fault=Fault(at_fault, rule, ""))
    words = verdict_words(crash)
    assert ("keeps every rule" in words) == (at_fault == "ego") == (crash.conduct is Conduct.KEEPS_RULES)
    assert f"and is {'partly ' * (at_fault == 'both')}at fault" in words


def test_a_rule_of_another_version_is_named():
    assert "is at fault (old rule)." in verdict_words(replace(TELLING, law=None, fault=Fault("ego", "old_rule", "")))


def test_every_offence_has_its_words():
    for name in get_args(OffenceName):
        words = verdict_words(replace(TELLING, law=Law((replace(RED, name=name),), ())))
        assert words.endswith(".")
        assert name in GROSS_OFFENCES or name in MISTAKES


GRADES = [
    (Law((), ()), Conduct.KEEPS_RULES, True, True),
    (Law((CLOSE,), ()), Conduct.MISTAKE, True, False),
    (Law((RED, CLOSE), ()), Conduct.GROSS, False, False),
    (Law((), (), ("oncoming_lanes",)), Conduct.UNKNOWN, None, None),
    (Law((CLOSE,), (), ("oncoming_lanes",)), Conduct.UNKNOWN, None, False),
    (Law((), (), ("gives_no_way",)), Conduct.UNKNOWN, True, None),
    (Law((CLOSE,), (), ("gives_no_way",)), Conduct.MISTAKE, True, False),
    (Law((), (), ("red_light", "leaves_way")), Conduct.KEEPS_RULES, True, True),
    (None, Conduct.UNKNOWN, None, None),
]


@pytest.mark.parametrize(("law", "conduct", "telling", "flawless"), GRADES)
def test_how_the_adversary_behaves_decides_whether_a_crash_is_telling_and_whether_flawless(
    law, conduct, telling, flawless
):
    found = replace(TELLING, law=law)
    assert (found.conduct, found.telling, found.flawless) == (conduct, telling, flawless)
    assert replace(found, flaws=(Flaw.OFF_ROAD,)).flawless is False
    assert replace(found, guessed=("car1",)).flawless is None


@pytest.mark.parametrize(
    ("drivers", "prevention", "telling"),
    [
        ((BRAKES,), Prevention.PREVENTABLE, True),
        ((replace(BRAKES, shift_m=0.9),), Prevention.BY_SWERVING, False),
        ((replace(BRAKES, avoids=False),), Prevention.NOT_PREVENTABLE, False),
        ((ReferenceDrive("rss", True),), Prevention.UNKNOWN, None),
    ],
)
def test_only_braking_makes_a_crash_preventable(drivers, prevention, telling):
    found = replace(TELLING, drivers=drivers)
    assert (found.prevention, found.telling) == (prevention, telling)


def test_what_breaks_the_law_grossly_is_said_before_mistakes():
    assert offences_words((CLOSE, RED)) == (
        "red light from 2.0 s for 0.5 s (3.25 m); tailgating from 1.0 s for 0.5 s (0.4 s, a mistake)"
    )
    assert offences_words(()) == "none"


def test_the_properties_of_a_case():
    found = "c", "grid", "t_bone", True, Prevention.PREVENTABLE, "idm", "king", "car1", "w", "h"
    card = CaseCard(*found, True, "tailgating", False)
    crash = [("case_collision_type", "t_bone"), ("case_planner", "idm"), ("case_adversary", "car1")]
    words = ("case_offences", "case_telling", "case_flawless")
    assert dict(card.properties) == dict([*crash, *zip(words, ("tailgating", "yes", "no"), strict=True)])
    unknown = replace(card, telling=None, flawless=None, offences=None)
    assert dict(unknown.properties) == dict([*crash, *zip(words, 3 * ["not known"], strict=True)])
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
