"""Summaries of the cases in a suite, read without their tracks and without JAX."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Header
from regents_cosim.norms.grades import Conduct, Prevention
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True)
class CaseCard:
    """A summary of one case."""

    case: str
    network: str  # or environment of highway-env, or log
    collision_type: str  # "no_collision" after an attack without one, "ordinary" for recorded traffic,
    # "harmless" for the neighbour of a crash
    clean: bool | None  # no flaw spoils it as a test; None: not judged
    prevention: Prevention | None  # whether a careful driver prevents the crash; None: not judged
    planner: str | None  # the attacked planner
    method: str | None
    adversary: str | None  # road user that the attacked planner hits
    window: str  # the recorded case that was attacked
    hash: str
    telling: bool | None = None  # `Judgement.telling`; None: unknown
    offences: str | None = None  # of the adversary, separated by commas; None: not judged
    flawless: bool | None = None  # `Judgement.flawless`; None: unknown
    conduct: Conduct | None = None  # how the adversary behaves; None: not judged by the present rules
    tags: str | None = None  # tags, likewise; None: saved by a version without tags

    def is_tagged(self, wanted: Collection[str]) -> bool:
        """Whether it has all of these tags."""
        return set(wanted).issubset((self.tags or "").split(", "))

    @property
    def properties(self) -> list[tuple[str, str]]:
        """The attacked case as properties for JUnit: the crash that was found, and its verdicts."""
        attacked = {"collision_type": self.collision_type, "planner": self.planner, "adversary": self.adversary}
        told = [(f"case_{name}", of) for name, of in attacked.items() if of is not None]
        if self.clean is None:
            return told
        said = {None: "not known", True: "yes", False: "no"}
        offences = "not known" if self.offences is None else self.offences or "none"
        grades = [("case_telling", said[self.telling]), ("case_flawless", said[self.flawless])]
        return [*told, *grades, ("case_offences", offences)]

    @property
    def adversary_in_words(self) -> str:
        """Who attacks which road user, and how that was found."""
        if self.method is None:
            return "none: recorded traffic"
        if self.collision_type == "harmless":
            return f"none: the harmless neighbour of a crash ({self.method} against {self.planner})"
        who = self.adversary or "no road user in particular"
        return f"{who} ({self.collision_type}, found by {self.method} against {self.planner})"


def card_of(folder: Path) -> CaseCard:
    """The card of the case in `folder`. Raises CaseError."""
    header = load_header(folder)
    return card(header, header.hash)


def tagged_card_of(folder: Path) -> CaseCard:
    """The card with tags, by the present rules, for which the tracks of an older case are read. Raises CaseError."""
    header = load_header(folder)
    if header.tags is not None and (header.judgement is None or header.judgement.is_current):
        return card(header, header.hash)
    from regents_cosim.tags.table import tags_of
    from regents_cosim.verdicts.judge import up_to_date

    case = load_case(folder)
    return replace(card(up_to_date(case), header.hash), tags=", ".join(tags_of(case)))


def card(case: Header | Scenario, digest: str) -> CaseCard:
    """The card of a case with that content hash."""
    attack, judgement = case.attack, case.judgement
    hit = attack.crash if attack else None
    current = judgement if judgement and judgement.is_current else None  # an older one does not tell the grades
    law = judgement.law if judgement else None
    return CaseCard(
        case=case.id,
        network=case.provenance.file.removeprefix("highway:").partition(".")[0],
        collision_type=_collision_type(attack),
        telling=current.telling if current else None,
        flawless=current.flawless if current else None,
        conduct=current.conduct if current else None,
        clean=judgement.clean if judgement else None,
        prevention=judgement.prevention if judgement else None,
        planner=attack.planner if attack else None,
        method=attack.method if attack else None,
        adversary=hit.agent if hit else None,
        window=attack.case if attack else case.id,
        hash=digest,
        offences=", ".join(offence.name for offence in law.adversary) if law else None,
        tags=", ".join(case.tags) if isinstance(case, Header) and case.tags is not None else None,
    )


def _collision_type(attack: AttackRecord | None) -> str:
    if attack is None:
        return "ordinary"
    if attack.careful_completion is not None:
        return "harmless"
    return attack.crash.collision_type if attack.crash else "no_collision"
