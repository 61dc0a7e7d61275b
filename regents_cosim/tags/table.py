"""The table of all tags, and the tags of a case.

Names come from the literature where it has them: ASAM OpenLABEL 1.0.0 (scenario tags: MotionCutIn, MotionCutOut,
MotionTurnLeft, JunctionRoundabout, ...), UN R157 (its traffic scenarios are cut-in, cut-out and deceleration), the
pre-crash typology of the NHTSA (DOT HS 810 767), and the tags of de Gelder and Op den Camp 2020 ("Tagging Real-World
Scenarios for the Assessment of Autonomous Vehicles", arXiv 2012.01081), which separate the activity of each road user,
its origin and the road, as this table does. How a tag is measured is our choice, and stands with it; a map without
lanes gives none for the place, its lights and its traffic. A case may have several tags.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.tags import adversary, ego
from regents_cosim.tags.ego import CaseValues, Density
from regents_cosim.tags.meeting import Meeting
from regents_cosim.tags.surroundings import Place

About = Literal["adversary", "ego", "place", "lights", "density"]


@dataclass(frozen=True)
class Tag:
    """A word for what a case shows, with its rule."""

    name: str
    about: About
    source: str
    holds: Callable[[CaseValues], bool]
    says: str  # the definition


def _of_adversary(rule: Callable[[Meeting], bool], source: str) -> Tag:
    def holds(seen: CaseValues) -> bool:
        return seen.meeting is not None and len(seen.meeting.steps) > 1 and rule(seen.meeting)

    return Tag(rule.__name__, "adversary", source, holds, rule.__doc__ or "")


def _of_place(place: Place, source: str, says: str) -> Tag:
    return Tag(place, "place", source, lambda seen: seen.surroundings == place, says)


def _of_density(density: Density, source: str, says: str) -> Tag:
    return Tag(density, "density", source, lambda seen: seen.density == density, says)


def _of(about: About, rule: Callable[[CaseValues], bool], source: str) -> Tag:
    return Tag(rule.__name__, about, source, rule, rule.__doc__ or "")


_R157 = "UN R157, Annex 3"
_NHTSA = "DOT HS 810 767"

TAGS: dict[str, Tag] = {
    tag.name: tag
    for tag in (
        _of_adversary(adversary.cut_in, f"OpenLABEL MotionCutIn; {_R157}: cut-in"),
        _of_adversary(adversary.cut_out, f"OpenLABEL MotionCutOut; {_R157}: cut-out"),
        _of_adversary(adversary.hard_brake, f"OpenLABEL MotionDecelerate; {_R157}: deceleration"),
        _of_adversary(adversary.lane_drift, f"{_NHTSA}: drifting, same direction"),
        _of_adversary(adversary.merge_squeeze, "arXiv 2012.01081: merging into the ego's lane"),
        _of_adversary(adversary.crossing_path, f"OpenLABEL MotionCross; {_NHTSA}: straight crossing paths"),
        _of_adversary(adversary.turn_across_path, f"{_NHTSA}: turn across path"),
        _of_adversary(adversary.turn_into_path, f"{_NHTSA}: turn into path"),
        _of_adversary(adversary.run_red_light, f"{_NHTSA}: running red light"),
        _of_adversary(adversary.wrong_way, "Vienna Convention on Road Traffic, art. 10"),
        _of("ego", ego.ego_goes_straight, "OpenLABEL MotionDrive"),
        _of("ego", ego.ego_turns_left, "OpenLABEL MotionTurnLeft"),
        _of("ego", ego.ego_turns_right, "OpenLABEL MotionTurnRight"),
        _of("ego", ego.ego_changes_lane, "OpenLABEL MotionLaneChangeLeft, MotionLaneChangeRight"),
        _of("ego", ego.ego_stops, "OpenLABEL MotionStop"),
        _of_place(
            "junction",
            "OpenLABEL JunctionIntersection",
            "Within 12 m two lanes cross at 30 degrees or more on one level, or a way leads through such a junction.",
        ),
        _of_place(
            "roundabout",
            "OpenLABEL JunctionRoundabout",
            "A lane within 12 m leads around a ring of at most 250 m, back into itself.",
        ),
        _of_place(
            "merge",
            "arXiv 2012.01081: entrance",
            "Within 12 m lanes become one, at less than 30 degrees, and none crosses them.",
        ),
        _of_place(
            "straight",
            "OpenLABEL HorizontalStraights",
            "No lanes cross, join or form a ring; the lane turns by less than 10 degrees from 50 m behind to 50 m "
            "ahead.",
        ),
        _of_place(
            "curve",
            "OpenLABEL HorizontalCurves",
            "No lanes cross, join or form a ring; the lane turns by 10 degrees or more from 50 m behind to 50 m ahead.",
        ),
        _of("lights", ego.traffic_light, "OpenLABEL SignsRegulatory; arXiv 2012.01081: traffic light"),
        _of_density(
            "sparse",
            "Highway Capacity Manual: level of service A",
            "There are up to 7 vehicles per kilometre of lane within 50 m of the ego: level of service A.",
        ),
        _of_density(
            "moderate",
            "Highway Capacity Manual: levels B to D",
            "There are more than 7 and fewer than 22 vehicles per kilometre of lane within 50 m of the ego: levels B "
            "to D.",
        ),
        _of_density(
            "dense",
            "Highway Capacity Manual: levels E and F",
            "There are 22 or more vehicles per kilometre of lane within 50 m of the ego: level E or F.",
        ),
    )
}

MANOEUVRES = tuple(name for name, tag in TAGS.items() if tag.about == "adversary")


def tags_of(scenario: Scenario, among: Collection[str] = TAGS) -> tuple[str, ...]:
    """The tags of a case, in the order of the table, restricted to `among`."""
    seen = CaseValues(scenario)
    return tuple(name for name, tag in TAGS.items() if name in among and tag.holds(seen))


def require_tags(names: Collection[str], among: Collection[str] = TAGS) -> None:
    """Raise RegentsError for a name that is not in `among`; the message suggests similar names."""
    for name in names:
        if name not in among:
            raise RegentsError(f"unknown tag {name!r}: {did_you_mean(name, among)}")
