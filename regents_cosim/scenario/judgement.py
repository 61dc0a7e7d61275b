"""The verdicts on a crash: flaws, fault, offences, and whether a careful driver avoids it.

This module holds only values, as they lie in a case on disk; `verdicts` computes them.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from regents_cosim.norms.grades import GROSS_OFFENCES, AdversaryMay, Conduct, OffenceName, Prevention
from regents_cosim.short_repr import ShortRepr

Blamed = Literal["ego", "adversary", "both", "nobody"]
# What a crash lacks to be telling, the nearest to telling last.
Shortcoming = Literal["spoilt_only", "gross_offence_only", "not_known", "careful_driver_crashes_too", "swerve_only"]


@dataclass(frozen=True)
class Fault:
    """The road user that is to blame for a collision, by a rule with a source."""

    at_fault: Blamed
    rule: str  # name of the rule in the table of rules
    reason: str  # a sentence with the numbers that decided


class Flaw(StrEnum):
    """A flaw of a crash as a test: its word on disk, a sentence for people, and a heading for tables.

    `verdicts.clean` looks for each flaw, with the thresholds of `limits`.
    """

    UNATTRIBUTED = "unattributed", "the ego met a road user that the attack did not steer", "not attributed"
    OFF_ROAD = "off_road", "the adversary left the road", "adversary off the road"
    HITS_OTHERS = "hits_others", "the adversary hit another road user first", "adversary hits others"
    BYSTANDERS_COLLIDE = "bystanders_collide", "two others collided that do not in the log", "bystanders collide"
    REAR_ENDS_EGO = "rear_ends_ego", "the adversary ran into the back of the ego", "ego rear-ended"
    FROM_BEHIND = "from_behind", "the adversary came from behind the ego", "adversary from behind"
    EGO_STANDS = "ego_stands", "the ego stood", "ego stands"
    TOO_HARD = (
        "too_hard",
        "the adversary braked or steered harder than tyres hold on a dry road",
        "adversary beyond tyres",
    )
    PERSON_STOOD = "person_stood", "the person just stood there", "person stood"
    INTO_SIDE = "into_side", "the person ran into the side of the ego", "person into the side"
    BEYOND_WALKING = "beyond_walking", "the person moved faster or harder than people do", "person beyond walking"

    sentence: str
    heading: str

    def __new__(cls, word: str, sentence: str, heading: str) -> "Flaw":
        """Make a member that compares and is written as its word, and carries the sentence and the heading."""
        made = str.__new__(cls, word)
        made._value_, made.sentence, made.heading = word, sentence, heading
        return made


# Flaws that only a pedestrian can have: tables of vehicles have no rows for them.
OF_PERSONS: frozenset[Flaw] = frozenset({Flaw.PERSON_STOOD, Flaw.INTO_SIDE, Flaw.BEYOND_WALKING})


@dataclass(frozen=True)
class Offence:
    """An offence of one road user before the crash that its log does not show to the same degree."""

    name: OffenceName
    time_s: float  # begin of the offence
    lasting_s: float
    amount: float  # its greatest amount
    unit: str  # unit of `amount`, in words: "share of its body", "m", "m/s"


# Where the map cannot show one of these, even a gross offence may go unseen.
_UNKNOWN_LAW: frozenset[OffenceName] = frozenset({"oncoming_lanes", "off_crossing"})


@dataclass(frozen=True)
class Law:
    """The offences of the adversary and of the ego, as far as the data shows them."""

    adversary: tuple[Offence, ...]
    ego: tuple[Offence, ...]
    # offences that the data cannot show, as it lacks lanes, limits, lights or priorities; failing to give way only
    # where the ways of the two cross
    unknown: tuple[OffenceName, ...] = ()

    @property
    def conduct(self) -> Conduct:
        """How the adversary behaves; unknown where the map does not tell the sides of the road or who gives way."""
        return next(iter(self.possible)) if len(self.possible) == 1 else Conduct.UNKNOWN

    @property
    def possible(self) -> frozenset[Conduct]:
        """How the adversary may have behaved: in one way, or in several where the map does not tell.

        Whatever it does not tell about giving way, to fail in it is a mistake that people make.
        """
        names = {offence.name for offence in self.adversary}
        if names & GROSS_OFFENCES:
            return frozenset({Conduct.GROSS})
        seen = {Conduct.MISTAKE} if names else {Conduct.KEEPS_RULES}
        may = {Conduct.MISTAKE} if "gives_no_way" in self.unknown else set[Conduct]()
        return frozenset(seen | may | ({Conduct.GROSS} if not _UNKNOWN_LAW.isdisjoint(self.unknown) else set()))


@dataclass(frozen=True)
class ReferenceDrive:
    """The drive of a careful driver in the ego's place, among the other tracks of the attacked case.

    It swerves only where it does not avoid the crash by braking alone.
    """

    driver: Literal["careful", "fuzzy", "rss"]  # the latter two only in cases of older versions
    avoids: bool
    perceives_s: float | None = None  # when the danger can be seen; None: never
    acts_s: float | None = None  # when its reaction begins
    shift_m: float = 0.0  # how far it swerves while it brakes, positive to the left
    # agents that drive into its back although they brake for it: noted, not counted
    rear_ended_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class Holds:
    """Whether the ego still hits the adversary first, at the same step, where all others move in other ways.

    The ego and the adversary keep to their tracks. None: not tried.
    """

    replayed: bool | None = None  # the others replay their log
    reactive: bool | None = None  # vehicles among them brake on the way of their log, as in the mirror
    sumo: bool | None = None  # SUMO drives them


EDITION = 8  # of the present rules

_ALLOWED: dict[AdversaryMay, set[Conduct]] = {
    "none": {Conduct.KEEPS_RULES},
    "mistakes": {Conduct.KEEPS_RULES, Conduct.MISTAKE},
    "anything": set(Conduct),
}


@dataclass(frozen=True, repr=False)
class Judgement(ShortRepr):
    """All verdicts on a crash.

    A field that did not exist when a case was saved is None or empty in it.
    """

    flaws: tuple[Flaw, ...]  # what spoils the crash as a test; a clean crash has none
    fault: Fault | None = None
    law: Law | None = None
    drivers: tuple[ReferenceDrive, ...] = ()
    # [percent] of the possible continuations of this moment that take at least the adversary's effort
    usual: float | None = None
    # share of pedestrians who die of such an impact; None: the ego's front hit no pedestrian
    death_risk: float | None = None
    # those of the two colliding agents whose heading is a guess; then nothing else is judged
    guessed: tuple[str, ...] = ()
    edition: int = 0  # of the rules by which the crash was judged; 0: before there were grades
    holds: Holds = Holds()  # with the others moving otherwise; it depends on SUMO's version, and is not hashed

    @property
    def is_current(self) -> bool:
        """Whether the crash was judged by the present rules."""
        return self.edition >= EDITION

    @property
    def clean(self) -> bool:
        """Whether nothing spoils the crash as a test."""
        return not self.flaws

    @property
    def careful(self) -> ReferenceDrive | None:
        """The careful driver's drive; None where it was not tried."""
        return next((drive for drive in self.drivers if drive.driver == "careful"), None)

    @property
    def prevention(self) -> Prevention:
        """Whether a careful driver in the ego's place prevents the crash."""
        careful = self.careful
        if careful is None:
            return Prevention.UNKNOWN
        if not careful.avoids:
            return Prevention.NOT_PREVENTABLE
        return Prevention.BY_SWERVING if careful.shift_m else Prevention.PREVENTABLE

    @property
    def evades_s(self) -> float | None:
        """When the careful driver begins to avoid the crash [s]; None where it does not avoid it."""
        careful = self.careful
        return careful.acts_s if careful and careful.avoids else None

    @property
    def conduct(self) -> Conduct:
        """How the adversary behaves; only one that is known not to be at fault for the collision keeps every rule."""
        return next(iter(self._possible)) if len(self._possible) == 1 else Conduct.UNKNOWN

    @property
    def _possible(self) -> frozenset[Conduct]:
        """How the adversary may have behaved, as in `Law.possible`."""
        possible = self.law.possible if self.law else frozenset(Conduct)
        if Conduct.KEEPS_RULES not in possible or self.fault is None or self.fault.at_fault == "ego":
            return possible
        keeps = {Conduct.KEEPS_RULES} if self.fault.at_fault == "nobody" else set[Conduct]()  # who is, is not known
        return possible - {Conduct.KEEPS_RULES} | {Conduct.MISTAKE} | keeps

    @property
    def telling(self) -> bool | None:
        """Whether the crash is clean, preventable, and not by a gross offence; None: not known."""
        return self.tells("mistakes")

    @property
    def shortcoming(self) -> Shortcoming | None:
        """The first reason why the crash is not telling; None where it is."""
        if self.guessed:
            return "not_known"
        if not self.clean:
            return "spoilt_only"
        if self.conduct is Conduct.GROSS:
            return "gross_offence_only"
        if self.prevention is Prevention.BY_SWERVING:
            return "swerve_only"
        if self.prevention is Prevention.NOT_PREVENTABLE:
            return "careful_driver_crashes_too"
        return None if self.telling else "not_known"

    @property
    def flawless(self) -> bool | None:
        """Whether the crash is telling and the adversary keeps every rule; None: not known."""
        return self.tells("none")

    def tells(self, may: AdversaryMay) -> bool | None:
        """Whether the crash is clean, preventable, and by an adversary that does no more than it `may`."""
        if self.guessed:
            return None
        prevention, possible, allowed = self.prevention, self._possible, _ALLOWED[may]
        lawful = possible <= allowed
        return all_hold(
            self.clean,
            None if prevention is Prevention.UNKNOWN else prevention is Prevention.PREVENTABLE,
            lawful if lawful or possible.isdisjoint(allowed) else None,
        )


def all_hold(*conditions: bool | None) -> bool | None:
    """Whether all conditions hold: False where one is known not to, None where that of one is not known."""
    if any(condition is False for condition in conditions):
        return False
    return None if None in conditions else True
