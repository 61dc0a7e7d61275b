"""Judges the crash of a drive like that of an attack: whether the driver could have avoided it, and who is at fault."""

from dataclasses import replace

from regents_cosim.attack_record import AttackRecord
from regents_cosim.collisions import collision_of_drive
from regents_cosim.evaluation.drives.crash_verdict import CrashVerdict
from regents_cosim.judgement import Judgement
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import ANOTHER, adversary_words, advice, verdict_words


def verdict_of(judgement: Judgement | None, who: str = ANOTHER) -> CrashVerdict | None:
    """The verdict in a judgement of a crash, in which `who` is the adversary; None where it has not been judged."""
    if judgement is None:
        return None
    fault, law = judgement.fault, judgement.law
    return CrashVerdict(
        at_fault=fault.at_fault if fault else None,
        rule=fault.rule if fault else None,
        escape=judgement.escape,
        clean=judgement.clean,
        telling=judgement.telling,
        flawless=judgement.flawless,
        words=verdict_words(judgement, who),
        advice=advice(judgement),
        offences=tuple(offence.name for offence in law.adversary) if law else None,
        ego_offences=tuple(offence.name for offence in law.ego) if law else None,
        preventable_by=judgement.preventable_by if judgement.drivers else None,
        flaws=judgement.flaws,
    )


def verdict_of_drive(case: Scenario, driver: str, tracks: Tracks) -> CrashVerdict | None:
    """The verdict on the crash of `driver` in `case`, whose drive gave `tracks`; None where it has no crash."""
    driven = judged_drive(case, driver, tracks)
    return verdict_of(driven.judgement, adversary_words(driven.agents, driven.attack)) if driven else None


def judged_drive(case: Scenario, driver: str, tracks: Tracks) -> Scenario | None:
    """The case with the drive of `driver` that gave `tracks`, and its judgement; None where it has no crash."""
    hit = collision_of_drive(case, tracks)
    if hit is None:
        return None
    attack = AttackRecord(case.id, "drive", driver, "collision", 0, hit)
    log = case.recorded_tracks
    return judge(replace(case, tracks=tracks, attack=attack, log=log, judgement=None, evasion=None))


def as_driven(replayed: Scenario, driver: str) -> Scenario:
    """An attacked case as the drive of `driver` in its tracks ended; an end other than the attack's is unjudged."""
    attack = replayed.attack
    if attack is None:
        return replayed
    hit, found = collision_of_drive(replayed, replayed.tracks), attack.collision
    if hit is not None and found is not None and (hit.agent, hit.step) == (found.agent, found.step):
        return replace(replayed, attack=replace(attack, planner=driver))
    outcome = "no_collision" if hit is None else "collision"
    ended = replace(attack, planner=driver, outcome=outcome, collision=hit, planner_error="")
    return replace(replayed, attack=ended, judgement=None, evasion=None)
