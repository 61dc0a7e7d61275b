"""Tags for what the ego does up to the contact, or in the whole window if there is none, and for lights on its way."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.tags.meeting import EGO, Meeting, meeting_of
from regents_cosim.tags.surroundings import Place, surroundings
from regents_cosim.verdicts.law.drive import AgentDrive, agent_drive
from regents_cosim.verdicts.law.lane_pieces import neighbours

Density = Literal["sparse", "moderate", "dense"]
_AROUND_M = 50.0
# Highway Capacity Manual, basic freeway segments: level of service A up to 11 passenger cars per mile and lane, E from
# 35.
_SPARSE_PER_KM = 7.0
_DENSE_PER_KM = 22.0
_TURN_RAD = np.deg2rad(45.0)
_TURN_M = 40.0  # length of way: a radius of 50 m, beyond which a road merely bends
_STOPS_S = 1.0


@dataclass(frozen=True, eq=False)
class CaseValues:
    """A case with the values that several tags need, each computed once."""

    scenario: Scenario

    @cached_property
    def meeting(self) -> Meeting | None:
        """The meeting of the ego and its adversary; None in recorded traffic."""
        return meeting_of(self.scenario)

    @property
    def moment(self) -> int:
        """The step of the contact, or the middle of the window if there is none."""
        return self.meeting.step if self.meeting else self.scenario.tracks.steps // 2

    @cached_property
    def ego(self) -> AgentDrive:
        """The ego's drive up to the contact, or to the end if there is none."""
        return agent_drive(self.scenario, EGO, self.meeting.step if self.meeting else self.scenario.tracks.steps - 1)

    @property
    def place(self) -> Float[np.ndarray, " 2"]:
        """The ego's position at `moment` [m]."""
        tracks = self.scenario.tracks
        return np.array([tracks.x[EGO, self.moment], tracks.y[EGO, self.moment]])

    @cached_property
    def surroundings(self) -> Place | None:
        """The kind of road around the ego at `moment`, given its lane; None where no lane is near."""
        at = int(np.searchsorted(self.ego.steps, self.moment).clip(max=len(self.ego.steps) - 1))
        z = float(self.scenario.tracks.z[EGO, self.moment])
        return surroundings(self.scenario.road, self.place, z, self.ego.front_lanes[at])

    @cached_property
    def density(self) -> Density | None:
        """How dense the traffic around the ego is at `moment`; None where no lane is near."""
        scenario, at = self.scenario, shapely.Point(self.place)
        around = at.buffer(_AROUND_M)
        km = sum(lane.line.intersection(around).length for lane in scenario.road.lanes if not lane.junction) / 1e3
        if km <= 0.0:
            return None
        tracks, motor = scenario.tracks, np.array([agent.kind in VEHICLE_KINDS for agent in scenario.agents])
        apart = np.hypot(tracks.x[:, self.moment] - at.x, tracks.y[:, self.moment] - at.y)
        per_km = float((motor & tracks.valid[:, self.moment] & (apart <= _AROUND_M)).sum()) / km
        return "sparse" if per_km <= _SPARSE_PER_KM else "dense" if per_km >= _DENSE_PER_KM else "moderate"


def ego_turns_left(seen: CaseValues) -> bool:
    """The ego's heading turns left by 45 degrees or more within 40 m of its way."""
    return _sharpest(seen)[1] >= _TURN_RAD


def ego_turns_right(seen: CaseValues) -> bool:
    """The ego's heading turns right by 45 degrees or more within 40 m of its way."""
    return _sharpest(seen)[0] <= -_TURN_RAD


def ego_changes_lane(seen: CaseValues) -> bool:
    """The ego's front passes into the lane beside its own."""
    beside = neighbours(seen.scenario.road)
    return any(after.id in beside[before.id] for _, before, after in seen.ego.entered)


def ego_stops(seen: CaseValues) -> bool:
    """The ego has moved, and then stands for a second or more."""
    stands = seen.ego.speed < STANDING_M_S
    begin, end = seen.ego.longest(stands & np.logical_or.accumulate(~stands))
    return (end - begin) * seen.scenario.dt >= _STOPS_S


def ego_goes_straight(seen: CaseValues) -> bool:
    """The ego neither turns, nor changes lanes, nor stops."""
    return not any(does(seen) for does in (ego_turns_left, ego_turns_right, ego_changes_lane, ego_stops))


def traffic_light(seen: CaseValues) -> bool:
    """The ego, or the other, passes or approaches a connection that has a light."""
    signals = {signal.id for signal in seen.scenario.signals}
    drives = [seen.ego, *([seen.meeting.drive(seen.meeting.other)] if seen.meeting else [])]
    lanes = {lane.id for drive in drives for lane in drive.front_lanes if lane is not None}
    return any(link.signal in signals for name in lanes for link in seen.scenario.road.exits[name])


def _sharpest(seen: CaseValues) -> tuple[float, float]:
    """The sharpest turns of the ego's heading within 40 m, to the right (negative) and to the left [rad]."""
    way = np.cumsum(seen.ego.moved_m)
    turned = np.cumsum(wrap(np.diff(seen.ego.yaw, prepend=seen.ego.yaw[:1])))
    behind = np.searchsorted(way, way - _TURN_M)
    spans = [turned[k] - turned[first : k + 1] for k, first in enumerate(behind.tolist())]
    return min((float(s.min()) for s in spans), default=0.0), max((float(s.max()) for s in spans), default=0.0)
