"""The two grades of a crash: whether the ego's driver could have prevented it, and how the adversary behaves."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

OffenceName = Literal[
    "oncoming_lanes", "against_direction", "red_light", "leaves_way", "off_road", "speeding",
    "gives_no_way", "unsafe_cut_in", "leaves_lane", "tailgating", "over_limit", "brakes_needlessly",
    "off_crossing", "steps_out",
]  # fmt: skip
# Offences that only a pedestrian can commit: tables of vehicles have no rows for them.
OFFENCES_ON_FOOT: frozenset[OffenceName] = frozenset({"off_crossing", "steps_out"})
# Offences that break the law grossly. The others of the list are mistakes that people make.
GROSS_OFFENCES: frozenset[OffenceName] = frozenset(
    {"oncoming_lanes", "against_direction", "red_light", "leaves_way", "off_road", "speeding", *OFFENCES_ON_FOOT}
)


@dataclass(frozen=True)
class Mistake:
    """A mistake that drivers make."""

    words: str  # what the driver does, after its name; {other} is the one that it meets
    # [percent] of the mistakes of drivers in accidents in which people were hurt; None: counted under no such name
    share: float | None


# Shares: Statistisches Bundesamt (Destatis), Verkehrsunfaelle 2023: 342,367 mistakes of drivers in accidents with
# personal injury in Germany (Nichtbeachten der Vorfahrt, ungenuegender Abstand, nicht angepasste Geschwindigkeit, the
# last of any amount). Its other causes are not the ones measured here.
MISTAKES: dict[OffenceName, Mistake] = {
    "gives_no_way": Mistake("does not give way to {other}", 13.4),
    "unsafe_cut_in": Mistake("changes lanes too close to {other}", None),
    "leaves_lane": Mistake("drifts out of its lane", None),
    "tailgating": Mistake("follows {other} too closely", 12.9),
    "over_limit": Mistake("drives up to 20 % too fast", 11.4),
    "brakes_needlessly": Mistake("stops or brakes hard without need", None),
}


class Prevention(StrEnum):
    """Whether a careful driver in the ego's place prevents the crash."""

    PREVENTABLE = "preventable"  # by braking alone, from when he can perceive the danger
    BY_SWERVING = "by_swerving"  # only with a swerve, chosen by what he expects when he decides
    NOT_PREVENTABLE = "not_preventable"
    UNKNOWN = "unknown"


class Conduct(StrEnum):
    """How the adversary behaves before the crash."""

    KEEPS_RULES = "keeps_every_rule"
    MISTAKE = "makes_a_mistake"  # one that people make (`MISTAKES`)
    GROSS = "breaks_the_law_grossly"
    UNKNOWN = "unknown"  # the map does not tell


AdversaryMay = Literal["none", "mistakes", "anything"]  # what the adversary of a search may do against the rules
