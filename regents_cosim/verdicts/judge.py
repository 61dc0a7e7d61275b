"""Judge a crash: its flaws, whether a careful driver avoids it, whose fault it is, and which laws were broken."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from regents_cosim.checks.arguments import require_a
from regents_cosim.norms.grades import Prevention
from regents_cosim.scenario.judgement import EDITION, Flaw, Holds, Judgement, ReferenceDrive
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.system.workers import in_turn
from regents_cosim.verdicts.behaviour import death_risk_of
from regents_cosim.verdicts.careful.careful_driver import careful_verdict
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.law.fault import fault
from regents_cosim.verdicts.law.offences import law_of
from regents_cosim.verdicts.usualness import usualness


def judge(attacked: Scenario) -> Scenario:
    """Return the scenario with the judgement of its crash; unchanged if there is no crash.

    If the careful driver avoids the crash, its drive is the scenario's `evasion`. If the heading of one of the two
    colliding road users is a guess, only the flaws are judged.
    """
    found = flaws(require_a(Scenario, attacked, "judge takes one case"))
    return attacked if found is None else _judged(attacked, found, *careful_verdict(attacked))


def judged_if_preventable(attacked: Scenario) -> Scenario | None:
    """A crash with its judgement, or None as soon as it is known to be unclean or not preventable by braking."""
    if flaws(attacked):
        return None
    careful, evasion = careful_verdict(attacked)
    if careful is None or Judgement((), drivers=(careful,)).prevention is not Prevention.PREVENTABLE:
        return None
    return _judged(attacked, (), careful, evasion)


def _judged(
    attacked: Scenario, found: tuple[Flaw, ...], careful: ReferenceDrive | None, evasion: Tracks | None
) -> Scenario:
    holds = attacked.judgement.holds if attacked.judgement else Holds()
    hit = attacked.collision
    guessed = sorted(attacked.provenance.guessed & {attacked.ego.id, hit.agent}) if hit else ()
    if guessed:
        judgement = Judgement(found, guessed=tuple(guessed), edition=EDITION, holds=holds)
        return replace(attacked, judgement=judgement, evasion=None)
    judgement = Judgement(
        flaws=found,
        fault=fault(attacked),
        law=law_of(attacked),
        drivers=(careful,) if careful else (),
        usual=usualness(attacked),
        death_risk=death_risk_of(hit) if hit else None,
        edition=EDITION,
        holds=holds,
    )
    return replace(attacked, judgement=judgement, evasion=evasion)


def up_to_date(attacked: Scenario) -> Scenario:
    """The scenario with a judgement by the present rules; unchanged where it has one, or was not judged."""
    judgement = attacked.judgement
    return attacked if judgement is None or judgement.is_current else judge(attacked)


def judge_each(attacked: Iterable[Scenario]) -> Iterator[Scenario]:
    """Judge many scenarios, in order, on all cores."""
    return in_turn(judge, attacked)
