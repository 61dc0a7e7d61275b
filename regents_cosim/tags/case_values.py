"""A case with the values that several tags need."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.tags.meeting import EGO, Meeting, meeting_of
from regents_cosim.tags.surroundings import Place, surroundings
from regents_cosim.verdicts.law.drive import AgentDrive, agent_drive

Density = Literal["sparse", "moderate", "dense"]
_AROUND_M = 50.0
# Highway Capacity Manual, basic freeway segments: level of service A up to 11 passenger cars per mile and lane, E from
# 35.
_SPARSE_PER_KM = 7.0
_DENSE_PER_KM = 22.0


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
