"""Tags for the place: roundabout, merge, junction, straight or curve; a map without lanes gives none.

Names after OpenLABEL's scenario tags (ASAM OpenLABEL 1.0.0): JunctionRoundabout, JunctionIntersection,
HorizontalStraights, HorizontalCurves.
"""

from regents_cosim.tags.case_values import CaseValues


def roundabout(seen: CaseValues) -> bool:
    """A lane within 12 m leads around a ring of at most 250 m, back into itself."""
    return seen.surroundings == "roundabout"


def merge(seen: CaseValues) -> bool:
    """Within 12 m lanes become one, at less than 30 degrees, and none crosses them."""
    return seen.surroundings == "merge"


def junction(seen: CaseValues) -> bool:
    """Within 12 m two lanes cross at 30 degrees or more on one level, or a way leads through such a junction."""
    return seen.surroundings == "junction"


def straight(seen: CaseValues) -> bool:
    """No lanes cross, join or form a ring; the lane turns by less than 10 degrees from 50 m behind to 50 m ahead."""
    return seen.surroundings == "straight"


def curve(seen: CaseValues) -> bool:
    """No lanes cross, join or form a ring; the lane turns by 10 degrees or more from 50 m behind to 50 m ahead."""
    return seen.surroundings == "curve"
