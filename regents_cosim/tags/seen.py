"""What tags are asked of: a case, with what several of them look at."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from regents_cosim.scenario import Scenario
from regents_cosim.tags.meeting import EGO, Meeting, meeting_of
from regents_cosim.tags.surroundings import Place, surroundings
from regents_cosim.verdicts.drive import AgentDrive, driven


@dataclass(frozen=True, eq=False)
class Seen:
    """A case."""

    scenario: Scenario

    @cached_property
    def meeting(self) -> Meeting | None:
        """Of the ego and its adversary; None in traffic as it was recorded."""
        return meeting_of(self.scenario)

    @property
    def moment(self) -> int:
        """The step that it is about: of the contact, else the middle of the window."""
        return self.meeting.step if self.meeting else self.scenario.tracks.steps // 2

    @cached_property
    def ego(self) -> AgentDrive:
        """What the ego does up to the contact, else to the end."""
        return driven(self.scenario, EGO, self.meeting.step if self.meeting else self.scenario.tracks.steps - 1)

    @property
    def place(self) -> Float[np.ndarray, " 2"]:
        """Where the ego is at the moment [m]."""
        tracks = self.scenario.tracks
        return np.array([tracks.x[EGO, self.moment], tracks.y[EGO, self.moment]])

    @cached_property
    def surroundings(self) -> Place | None:
        """What the road is like there, seen from the lane that the ego is in; None where no lanes are near."""
        at = int(np.searchsorted(self.ego.steps, self.moment).clip(max=len(self.ego.steps) - 1))
        z = float(self.scenario.tracks.z[EGO, self.moment])
        return surroundings(self.scenario.road, self.place, z, self.ego.front_lanes[at])
