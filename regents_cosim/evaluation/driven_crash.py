"""The crash of a drive, judged as that of an attack is: could this driver have avoided it, and whose fault was it."""

from dataclasses import replace

from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.reports.verdict import Verdict
from regents_cosim.scenario import AttackRecord, Judgement, Scenario, Tracks
from regents_cosim.verdicts.in_time import avoidable_in_time
from regents_cosim.verdicts.judgement import judge


def verdict_of(case: Scenario, judgement: Judgement | None) -> Verdict | None:
    """What a judgement of the crash in `case` says, None where it has not been judged."""
    if judgement is None:
        return None
    found, fault = judgement.avoidability, judgement.fault
    return Verdict(
        at_fault=fault.at_fault if fault else None,
        rule=fault.rule if fault else None,
        avoidable=found.avoidable if found else None,
        in_time=avoidable_in_time(case, judgement) if found else None,
        clean=judgement.clean,
    )


def verdict_of_drive(case: Scenario, driver: str, tracks: Tracks) -> Verdict | None:
    """That of the crash which `driver` has in `case` by `tracks`; None where it has none."""
    contact = first_contact(case.agents, tracks)
    if contact is None:
        return None
    hit = collision_at(case.agents, tracks, contact, case.dt, case.agents[contact[0]].role == "adversary")
    attack = AttackRecord(case.id, "drive", driver, "collision", 0, hit)
    driven = replace(case, tracks=tracks, attack=attack, judgement=None, evasion=None)
    return verdict_of(driven, judge(driven).judgement)
