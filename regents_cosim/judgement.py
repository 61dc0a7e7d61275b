"""The verdicts on a crash: flaws, fault, offences, and the drives that would avoid it.

This module holds only values, as they lie in a case on disk; `verdicts` computes them.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from regents_cosim.norms.grades import GROSS_OFFENCES, Conduct, OffenceName, Prevention
from regents_cosim.short_repr import ShortRepr

ReferenceDriver = Literal["careful", "fuzzy", "rss"]
Side = Literal["own", "shoulder", "oncoming"]  # parts of the road; oncoming: any lane that the ego may not use


@dataclass(frozen=True)
class Manoeuvre:
    """One evasion: the ego drives as it did up to `onset_step`, then brakes or accelerates and moves aside."""

    onset_step: int
    accel: float  # [m/s^2] negative brakes
    # how long `accel` lasts before the speed is held; None: to the end, or until the ego stands
    lasting_s: float | None
    lateral_accel: float  # [m/s^2] its peak, at the speed of the onset; positive to the left
    shift: float  # [m] how far it moves aside from its recorded way, positive to the left
    # the greatest share of the tyre friction along the manoeuvre; the gentlest manoeuvre has the least
    friction_share: float
    side: Side | None = None  # where it takes the ego; None: not known
    runs_red: bool | None = None  # it passes a red light where the ego's own drive did not; None: not known
    # the reference driver that drives it, with a brake force that builds up; None: one of the bank
    driver: ReferenceDriver | None = None


@dataclass(frozen=True)
class Avoidability:
    """Whether the ego could have evaded an adversary that does not react, by a bank of manoeuvres within tyre friction.

    A field that did not exist when a case was saved is None in it.
    """

    avoidable: bool  # `Scenario.evasion` proves it
    tried: int  # number of manoeuvres
    evading: int  # number of manoeuvres that reach the horizon on the road without touching another agent
    last_onset_step: int | None  # the latest step at which an evading manoeuvre may begin
    gentlest: (
        Manoeuvre | None
    )  # the careful driver's where that avoids it; else what it would rather do than the others
    in_time: bool | None = None  # it reacts to what could be seen, after a reaction time; False: it needs foreknowledge
    # step from which on the danger can be seen (`verdicts.careful.perception` or `verdicts.escape.way_out`)
    perceived_step: int | None = None


Blamed = Literal["ego", "adversary", "both", "nobody"]


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
    """The drive of a reference driver in the ego's place, among the other tracks of the attacked case.

    Only the careful driver swerves, where it does not avoid the crash by braking alone.
    """

    driver: ReferenceDriver
    avoids: bool
    perceives_s: float | None = None  # when the danger can be seen; None: never
    acts_s: float | None = None  # when its reaction begins
    shift_m: float = 0.0  # how far it swerves while it brakes, positive to the left
    # agents that drive into its back because they replay their log: noted, not counted
    rear_ended_by: tuple[str, ...] = ()


# "in time": the ego avoids the crash by reacting to what could be seen. "not in time": only foreknowledge avoids it.
# "never": it is proven that nothing avoids it. "avoidable": an older case, which does not say when.
Escape = Literal["in time", "not in time", "never", "unknown", "avoidable"]


@dataclass(frozen=True)
class Holds:
    """Whether the ego still hits the adversary first, at the same step, where all others move in other ways.

    The ego and the adversary keep to their tracks. None: not tried.
    """

    replayed: bool | None = None  # the others replay their log
    reactive: bool | None = None  # vehicles among them brake on the way of their log, as in the mirror
    sumo: bool | None = None  # SUMO drives them


EDITION = 3  # of the present rules


@dataclass(frozen=True, repr=False)
class Judgement(ShortRepr):
    """All verdicts on a crash.

    A field that did not exist when a case was saved is None or empty in it.
    """

    flaws: tuple[Flaw, ...]  # what spoils the crash as a test; a clean crash has none
    avoidability: Avoidability | None = None
    fault: Fault | None = None
    law: Law | None = None
    drivers: tuple[ReferenceDrive, ...] = ()
    unavoidable: bool | None = None  # True: proven that no drive from `perceived_step` on avoids it; False: one does
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
    def escape(self) -> Escape | None:
        """Whether the ego could have avoided the crash; None where that is not judged."""
        found = self.avoidability
        if found is None:
            return "unknown" if self.guessed else None
        if found.avoidable:
            return "not in time" if found.in_time is False else "in time" if found.in_time else "avoidable"
        return "never" if self.unavoidable else "unknown"

    @property
    def preventable_by(self) -> tuple[ReferenceDriver, ...]:
        """The reference drivers that avoid the crash by braking alone."""
        return tuple(drive.driver for drive in self.drivers if drive.avoids and not drive.shift_m)

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
    def conduct(self) -> Conduct:
        """How the adversary behaves; one that is at fault for the collision does not keep every rule."""
        return next(iter(self._possible)) if len(self._possible) == 1 else Conduct.UNKNOWN

    @property
    def _possible(self) -> frozenset[Conduct]:
        """How the adversary may have behaved, as in `Law.possible`."""
        possible = self.law.possible if self.law else frozenset(Conduct)
        blamed = self.fault is not None and self.fault.at_fault in ("adversary", "both")
        return frozenset(Conduct.MISTAKE if blamed and one is Conduct.KEEPS_RULES else one for one in possible)

    @property
    def into_evasion(self) -> tuple[str, ...]:
        """Agents that replay their log into the back of the ego while it avoids the crash: noted, not counted."""
        best = self.avoidability.gentlest if self.avoidability else None
        if best is None or best.driver is None:
            return ()
        return next((drive.rear_ended_by for drive in self.drivers if drive.driver == best.driver), ())

    @property
    def telling(self) -> bool | None:
        """Whether the crash is clean, preventable, and not by a gross offence; None: not known."""
        return self._says(Conduct.KEEPS_RULES, Conduct.MISTAKE)

    @property
    def flawless(self) -> bool | None:
        """Whether the crash is telling and the adversary keeps every rule; None: not known."""
        return self._says(Conduct.KEEPS_RULES)

    def _says(self, *allowed: Conduct) -> bool | None:
        """Whether the crash is clean, preventable, and by an adversary that behaves in one of these ways."""
        if self.guessed:
            return None
        prevention, possible = self.prevention, self._possible
        lawful = possible <= set(allowed)
        return all_hold(
            self.clean,
            None if prevention is Prevention.UNKNOWN else prevention is Prevention.PREVENTABLE,
            lawful if lawful or possible.isdisjoint(allowed) else None,
        )

    @property
    def actionable(self) -> bool:
        """Whether the crash is clean and the planner could have avoided it."""
        return self.clean and self.avoidability is not None and self.avoidability.avoidable


def all_hold(*conditions: bool | None) -> bool | None:
    """Whether all conditions hold: False where one is known not to, None where that of one is not known."""
    if any(condition is False for condition in conditions):
        return False
    return None if None in conditions else True
