"""Who waits where two ways meet: by what signs tell along each, by who turns across the other, or by the right.

Sources: Vienna Convention on Road Traffic (1968), art. 16(1)(b) (who turns lets oncoming traffic pass) and 18
(intersections); Uniform Vehicle Code (2000), 11-402 (also oncoming traffic that turns into the same road).
"""

from typing import Literal, NamedTuple

import numpy as np

from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.roadmap import Approach
from regents_cosim.norms.limits import ALONG_RAD

_AGAINST_RAD = np.pi - ALONG_RAD
TURNED_RAD = np.deg2rad(25.0)  # less is no turn
_SIDE_M = 1.0  # so far to one side of each other two pass
_RANK: dict[Approach | None, int] = {"priority": 2, None: 1, "right_first": 1, "yields": 0, "stops": 0}

Waiting = Literal["first", "second"]  # of two


class WayIn(NamedTuple):
    """How one of two ways leads to where they meet."""

    came_rad: float
    turned_rad: float  # along it, positive to the left
    begin: tuple[float, float]  # [m]
    sign: Approach | None = None


def first_if(condition: bool) -> Waiting:
    """The first of two where the condition holds, else the second."""
    return "first" if condition else "second"


def waits_by_signs(one: WayIn, two: WayIn) -> Waiting | None:
    """Who waits where the signs along both, or a turn across the other, tell; None: they do not tell."""
    ranks = _RANK[one.sign], _RANK[two.sign]
    if ranks[0] != ranks[1]:
        return first_if(ranks[0] < ranks[1])
    if one.sign == two.sign == "stops":
        return None  # the first to come goes first
    across = turns_across(one, two)
    return waits_for_right(one, two) if across is None and one.sign == two.sign == "right_first" else across


def waits_for_right(one: WayIn, two: WayIn) -> Waiting | None:
    """Of two whose ways cross, the one to whose right the other comes."""
    between = float(wrap(np.asarray(two.came_rad - one.came_rad)))
    return None if abs(between) > _AGAINST_RAD else first_if(between > 0.0)


def turns_across(one: WayIn, two: WayIn) -> Waiting | None:
    """Of two that come towards each other, the one that turns; if both do into one road, the one that turns across."""
    if abs(float(wrap(np.asarray(two.came_rad - one.came_rad)))) <= _AGAINST_RAD:
        return None
    more = abs(one.turned_rad) - abs(two.turned_rad)
    if abs(more) > TURNED_RAD:
        return first_if(more > 0.0)
    turns = sorted((one.turned_rad, two.turned_rad))
    side = _left_of(one, two)
    into_one_road = turns[0] < -TURNED_RAD and turns[1] > TURNED_RAD
    return first_if(one.turned_rad * side > 0.0) if into_one_road and abs(side) > _SIDE_M else None


def _left_of(one: WayIn, two: WayIn) -> float:
    """How far [m] to the left of the one the other begins."""
    dx, dy = (b - a for a, b in zip(one.begin, two.begin, strict=True))
    return dy * float(np.cos(one.came_rad)) - dx * float(np.sin(one.came_rad))
