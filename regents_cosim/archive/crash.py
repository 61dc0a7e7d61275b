"""A crash as the map of behaviours sees it: where it belongs, and how good a test it is.

Plain values, so that a ledger or a manifest holds them and no tracks are read.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from regents_cosim.archive.measured import behaviour_of
from regents_cosim.attack_record import CollisionKind
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Behaviour, Header
from regents_cosim.judgement import Judgement
from regents_cosim.scenario import Scenario
from regents_cosim.tags.table import tags_of

Standing = Literal["crash", "clean", "actionable", "telling"]  # from the least to the best, each named by its best
STANDINGS: tuple[Standing, ...] = get_args(Standing)


@dataclass(frozen=True)
class Crash:
    """One crash."""

    case: str
    hash: str
    tags: tuple[str, ...]
    kind: CollisionKind
    closing_m_s: float  # relative speed at the contact
    departs_s: float | None  # from when the adversary can be seen to leave its log to the contact; None: it cannot
    standing: Standing
    usual_percent: float | None  # how usual the adversary's motion is (docs/crashes.md); None: not known
    deviation_m: float  # of the adversary from its log, on average up to the contact

    @property
    def quality(self) -> float:
        """1 for a crash, 2 for a clean one, 3 where the planner could have avoided it, 4 for a telling one.

        And up to 1 for how usual the adversary's motion is: the gentler, the more. What is not known counts 0.
        """
        return 1.0 + STANDINGS.index(self.standing) + (self.usual_percent or 0.0) / 100.0

    @property
    def order(self) -> tuple[float, float, str]:
        """The least is the best of a cell: by quality, then by the least deviation, then by the hash, a lot drawn."""
        return -self.quality, self.deviation_m, self.hash


def crash_of(case: Scenario) -> Crash | None:
    """The crash of a case in memory; None where there is none."""
    behaviour = behaviour_of(case)
    return None if behaviour is None else _crash(case, content_hash(case), tags_of(case), behaviour)


def crash_in(folder: Path) -> Crash | None:
    """The crash of a saved case; None where there is none. Only older cases are read with their tracks.

    Raises CaseError.
    """
    header = load_header(folder)
    if header.attack is None or header.attack.outcome != "collision":
        return None
    if header.tags is None or header.behaviour is None:
        return crash_of(load_case(folder))
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
        kind=hit.kind,
        closing_m_s=hit.relative_speed,
        departs_s=behaviour.departs_s,
        standing=_standing(judged),
        usual_percent=judged.usual if judged else None,
        deviation_m=behaviour.deviation_m,
    )


def _standing(judged: Judgement | None) -> Standing:
    if judged is None or not judged.clean:
        return "crash"
    return "telling" if judged.telling else "actionable" if judged.actionable else "clean"
