"""What a crash says about the planner: what spoils it, whose fault it is, which laws were kept, what would avoid it.

Values alone, of a case on disk. They are made in `verdicts`.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from regents_cosim.brief import Brief

ReferenceDriver = Literal["careful", "fuzzy", "rss"]
Side = Literal["own", "shoulder", "oncoming"]  # of the road; oncoming: any lane that the ego may not use


@dataclass(frozen=True)
class Manoeuvre:
    """One way to evade: the ego drives as it did up to `onset_step`, then brakes or accelerates and moves aside."""

    onset_step: int
    accel: float  # [m/s^2] negative brakes
    lasting_s: float | None  # of `accel`, then the speed is held; None: to the end, or until it stands
    lateral_accel: float  # [m/s^2] at its peak, at the speed of the onset; positive to the left
    shift: float  # [m] how far it moves aside from the way that it drove, positive to the left
    friction_share: float  # of what the tyres can do, the greatest along the manoeuvre; the gentlest has the least
    side: Side | None = None  # where it takes the ego; None: not known
    runs_red: bool | None = None  # it passes a red light where the ego's own drive did not; None: not known
    driver: ReferenceDriver | None = None  # whose drive it is, built up as its brakes do; None: one of the bank


@dataclass(frozen=True)
class Avoidability:
    """Whether the ego could have evaded a fixed adversary, by a bank of manoeuvres within tyre friction.

    Fields that older versions did not know are None in their cases.
    """

    avoidable: bool  # `Scenario.evasion` proves it
    tried: int  # manoeuvres
    evading: int  # of them reach the horizon without touching another, on the road
    last_onset_step: int | None  # the latest at which one of them may begin
    gentlest: (
        Manoeuvre | None
    )  # the careful driver's where that avoids it; else what it would rather do than the others
    in_time: bool | None = None  # it answers what was to be seen, after a time to react; else it takes knowledge ahead
    perceived_step: int | None = None  # from which on the danger can be seen: `verdicts.perception`, or way_out


Blamed = Literal["ego", "adversary", "both", "nobody"]


@dataclass(frozen=True)
class Fault:
    """Who is to blame for a collision, by a rule with a source."""

    at_fault: Blamed
    rule: str  # its name in the table of rules
    reason: str  # in words, with the numbers that decided


class Flaw(StrEnum):
    """What spoils a crash as a test: its word on disk, the same as a sentence, and as a heading in tables.

    `verdicts.clean` asks for each, by the numbers of `limits`.
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
        """The word, which is what it is compared and written by, with what is said of it."""
        made = str.__new__(cls, word)
        made._value_, made.sentence, made.heading = word, sentence, heading
        return made


# What only a pedestrian can do: tables of vehicles have no rows for it.
OF_PERSONS: frozenset[Flaw] = frozenset({Flaw.PERSON_STOOD, Flaw.INTO_SIDE, Flaw.BEYOND_WALKING})

OffenceName = Literal[
    "oncoming_lanes", "against_direction", "red_light", "leaves_way", "off_road", "speeding",
    "gives_no_way", "unsafe_cut_in", "leaves_lane", "tailgating",
    "off_crossing", "steps_out",
]  # fmt: skip
# What only a pedestrian can do: tables of vehicles have no rows for it.
OFFENCES_ON_FOOT: frozenset[OffenceName] = frozenset({"off_crossing", "steps_out"})
# A road user with one of these breaks the law. The others of the list are reported only.
UNLAWFUL: frozenset[OffenceName] = frozenset(
    {"oncoming_lanes", "against_direction", "red_light", "leaves_way", "off_road", "speeding", *OFFENCES_ON_FOOT}
)


@dataclass(frozen=True)
class Offence:
    """What one road user did against the law up to the crash, and had not done to the same degree in its log."""

    name: OffenceName
    time_s: float  # when it began
    lasting_s: float
    amount: float  # the worst of it
    unit: str  # of the amount, in words: "share of its body", "m", "m/s"


@dataclass(frozen=True)
class Law:
    """The offences of the adversary and of the ego, as far as the data tells."""

    adversary: tuple[Offence, ...]
    ego: tuple[Offence, ...]
    unknown: tuple[OffenceName, ...] = ()  # what cannot be told here: without lanes, limits, lights or priorities

    @property
    def lawful(self) -> bool | None:
        """Whether the adversary broke no law; None where the map cannot tell: no directions, or no crossings."""
        if any(offence.name in UNLAWFUL for offence in self.adversary):
            return False
        return True if {"oncoming_lanes", "off_crossing"}.isdisjoint(self.unknown) else None


@dataclass(frozen=True)
class ReferenceDrive:
    """What a reference driver does in the ego's place, among the tracks of the attacked case."""

    driver: ReferenceDriver
    avoids: bool
    perceives_s: float | None = None  # when the danger can be seen; None: never
    acts_s: float | None = None  # when its reaction begins
    shift_m: float = 0.0  # it swerves by so much while it brakes, positive to the left
    rear_ended_by: tuple[str, ...] = ()  # others that replay their log into its back: noted, not counted


# In time: by an answer to what was to be seen. Not in time: only with knowledge of what comes. Never: that is proven.
# Avoidable: an older case, which does not say when.
Escape = Literal["in time", "not in time", "never", "unknown", "avoidable"]


@dataclass(frozen=True, repr=False)
class Judgement(Brief):
    """The verdicts on a crash: what it says about the planner.

    Fields that older versions did not know are None or empty in their cases.
    """

    flaws: tuple[Flaw, ...]  # what spoils it as a test; clean has none
    avoidability: Avoidability | None = None
    fault: Fault | None = None
    law: Law | None = None
    drivers: tuple[ReferenceDrive, ...] = ()
    unavoidable: bool | None = None  # proven: no drive from `perceived_step` on avoids it; False: one does
    usual: float | None = None  # [percent] of continuations of the moment, that take at least the adversary's effort
    death_risk: float | None = None  # share of pedestrians who die of such an impact; None: the front hit none
    guessed: tuple[str, ...] = ()  # who of the two that meet has a guessed heading: then nothing else is judged

    @property
    def clean(self) -> bool:
        """Nothing spoils it."""
        return not self.flaws

    @property
    def escape(self) -> Escape | None:
        """Whether the ego could have avoided it; None where that is not judged."""
        found = self.avoidability
        if found is None:
            return "unknown" if self.guessed else None
        if found.avoidable:
            return "not in time" if found.in_time is False else "in time" if found.in_time else "avoidable"
        return "never" if self.unavoidable else "unknown"

    @property
    def preventable_by(self) -> tuple[ReferenceDriver, ...]:
        """The reference drivers that avoid the crash."""
        return tuple(drive.driver for drive in self.drivers if drive.avoids)

    @property
    def into_evasion(self) -> tuple[str, ...]:
        """Road users that follow their log into the back of the ego that avoids the crash: noted, not counted."""
        best = self.avoidability.gentlest if self.avoidability else None
        if best is None or best.driver is None:
            return ()
        return next((drive.rear_ended_by for drive in self.drivers if drive.driver == best.driver), ())

    @property
    def telling(self) -> bool | None:
        """Clean, by a lawful adversary, and a careful driver avoids it; None where that is not known."""
        if self.guessed:
            return None
        if not self.clean:
            return False
        if self.law is None or not any(drive.driver == "careful" for drive in self.drivers):
            return None
        return self.law.lawful and "careful" in self.preventable_by

    @property
    def actionable(self) -> bool:
        """Clean, and the planner could have avoided it."""
        return self.clean and self.avoidability is not None and self.avoidability.avoidable
