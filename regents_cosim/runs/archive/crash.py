"""A crash in the map of behaviours: the values that give its cell, and its quality as a test.

All values are plain, so that a ledger or a manifest can hold them and no tracks need to be read.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from regents_cosim.attack_record import CollisionType
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Behaviour, Header
from regents_cosim.judgement import Judgement
from regents_cosim.norms.grades import Prevention
from regents_cosim.scenario import Scenario
from regents_cosim.tags.table import tags_of
from regents_cosim.verdicts.behaviour import behaviour_of
from regents_cosim.verdicts.judge import up_to_date

# from worst to best, each named by the best word that holds
Standing = Literal["crash", "clean", "preventable", "telling", "flawless"]
STANDINGS: tuple[Standing, ...] = get_args(Standing)


@dataclass(frozen=True)
class Crash:
    """The values of one crash that the map of behaviours needs."""

    case: str
    hash: str
    tags: tuple[str, ...]
    collision_type: CollisionType
    closing_m_s: float  # [m/s] relative speed at the contact
    departs_s: float | None  # [s] from when the adversary visibly leaves its log to the contact; None: never visible
    standing: Standing
    usual_percent: float | None  # how usual the adversary's motion is (docs/crashes.md); None: not known
    deviation_m: float  # [m] mean distance of the adversary from its log up to the contact

    @property
    def quality(self) -> float:
        """1 for a crash, 2 for a clean one, 3 if also preventable, 4 if telling, 5 if flawless.

        Up to 1 is added for how usual the adversary's motion is; an unknown value adds 0.
        """
        return 1.0 + STANDINGS.index(self.standing) + (self.usual_percent or 0.0) / 100.0

    @property
    def order(self) -> tuple[float, float, str]:
        """A sort key, least for the best crash of a cell: quality, then deviation, then the hash to break ties."""
        return -self.quality, self.deviation_m, self.hash


def crash_of(case: Scenario) -> Crash | None:
    """The crash of a case in memory; None if the case has no crash."""
    behaviour = behaviour_of(case)
    return None if behaviour is None else _crash(case, content_hash(case), tags_of(case), behaviour)


def crash_in(folder: Path) -> Crash | None:
    """The crash of a saved case; None if it has none. Tracks are read only for cases of older versions.

    Raises CaseError where the case cannot be read.
    """
    header = load_header(folder)
    if header.attack is None or header.attack.outcome != "collision":
        return None
    old = header.judgement is not None and not header.judgement.is_current
    if header.tags is None or header.behaviour is None or old:
        found = crash_of(up_to_date(load_case(folder)))
        return found and replace(found, hash=header.hash)
    return _crash(header, header.hash, header.tags, header.behaviour)


def _crash(case: Header | Scenario, digest: str, tags: tuple[str, ...], behaviour: Behaviour) -> Crash | None:
    hit = case.attack.collision if case.attack and case.attack.outcome == "collision" else None
    if hit is None or case.attack is None or case.attack.careful_completion is not None:
        return None
    judged = case.judgement
    return Crash(
        case=case.id,
        hash=digest,
        tags=tags,
        collision_type=hit.collision_type,
        closing_m_s=hit.relative_speed,
        departs_s=behaviour.departs_s,
        standing=_standing(judged),
        usual_percent=judged.usual if judged else None,
        deviation_m=behaviour.deviation_m,
    )


def _standing(judged: Judgement | None) -> Standing:
    if judged is None or not judged.clean:
        return "crash"
    if judged.telling:
        return "flawless" if judged.flawless else "telling"
    return "preventable" if judged.prevention is Prevention.PREVENTABLE else "clean"
