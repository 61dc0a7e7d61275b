"""Tags for the place, its lights and its traffic; a map without lanes gives none.

Places have the names of OpenLABEL's scenario tags (ASAM OpenLABEL 1.0.0): JunctionRoundabout, JunctionIntersection,
HorizontalStraights, HorizontalCurves.
"""

from typing import Literal

import numpy as np
import shapely

from regents_cosim.scenario import VEHICLE_KINDS
from regents_cosim.tags.case_values import CaseValues

_AROUND_M = 50.0
# Highway Capacity Manual, basic freeway segments: level of service A up to 11 passenger cars per mile and lane, E from
# 35.
_SPARSE_PER_KM = 7.0
_DENSE_PER_KM = 22.0


def traffic_light(seen: CaseValues) -> bool:
    """The ego, or the other, passes or approaches a connection that has a light."""
    signals = {signal.id for signal in seen.scenario.signals}
    drives = [seen.ego, *([seen.meeting.drive(seen.meeting.other)] if seen.meeting else [])]
    lanes = {lane.id for drive in drives for lane in drive.front_lanes if lane is not None}
    return any(link.signal in signals for name in lanes for link in seen.scenario.road.exits[name])


def sparse(seen: CaseValues) -> bool:
    """There are up to 7 vehicles per kilometre of lane within 50 m of the ego: level of service A."""
    return _density(seen) == "sparse"


def moderate(seen: CaseValues) -> bool:
    """There are more than 7 and fewer than 22 vehicles per kilometre of lane within 50 m of the ego: levels B to D."""
    return _density(seen) == "moderate"


def dense(seen: CaseValues) -> bool:
    """There are 22 or more vehicles per kilometre of lane within 50 m of the ego: level E or F."""
    return _density(seen) == "dense"


def _density(seen: CaseValues) -> Literal["sparse", "moderate", "dense"] | None:
    tracks, road = seen.scenario.tracks, seen.scenario.road
    around = shapely.Point(*seen.place).buffer(_AROUND_M)
    lines = [lane.line for lane in road.lanes if not lane.junction]
    km = sum(line.intersection(around).length for line in lines) / 1e3
    if km <= 0.0:
        return None
    apart = np.hypot(*(v[:, seen.moment] - at for v, at in zip((tracks.x, tracks.y), seen.place, strict=True)))
    motor = np.array([agent.kind in VEHICLE_KINDS for agent in seen.scenario.agents])
    per_km = float((motor & tracks.valid[:, seen.moment] & (apart <= _AROUND_M)).sum()) / km
    return "sparse" if per_km <= _SPARSE_PER_KM else "dense" if per_km >= _DENSE_PER_KM else "moderate"


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
