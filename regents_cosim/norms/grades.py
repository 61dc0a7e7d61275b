"""The two grades of a crash: whether the ego's driver could have prevented it, and how the adversary behaves."""

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


# Mistakes that drivers make: what the driver does, after its name; {other} is the one that it meets.
MISTAKES: dict[OffenceName, str] = {
    "gives_no_way": "does not give way to {other}",
    "unsafe_cut_in": "changes lanes too close to {other}",
    "leaves_lane": "drifts out of its lane",
    "tailgating": "follows {other} too closely",
    "over_limit": "drives up to 20 % too fast",
    "brakes_needlessly": "stops or brakes hard without need",
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
