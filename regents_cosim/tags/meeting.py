"""The ego and one other road user up to their contact, in the frame of the ego's way."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.scenario.collisions import collision_at, first_contact
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPath, ego_path
from regents_cosim.verdicts.law.crash_history import EGO, CrashHistory
from regents_cosim.verdicts.law.drive import AgentDrive, agent_drive

CROSS_RAD = np.deg2rad(30.0)  # ways at this angle or more cross
_AROUND_RAD = np.deg2rad(270.0)
LATELY_S = 5.0  # before the contact: earlier motion did not lead to it


@dataclass(frozen=True, eq=False)
class Meeting:
    """Two road users that touch at `step`, or come nearest then if they never touch."""

    scenario: Scenario
    other: int
    step: int

    @cached_property
    def steps(self) -> Int[np.ndarray, " time"]:
        """The steps of the last seconds before the contact at which both agents are valid."""
        first = max(self.step - round(LATELY_S / self.scenario.dt), 0)
        there = self.scenario.tracks.valid[[EGO, self.other], first : self.step + 1].all(axis=0)
        return first + np.flatnonzero(there)

    @cached_property
    def path(self) -> EgoPath:
        """The ego's way, cut off before it leads around a roundabout back to the place of the contact."""
        path = ego_path(self.scenario)
        here = path.driven[self.step]
        turned = np.abs(path.yaw - np.interp(here, path.distance, path.yaw))
        around = path.distance[(path.distance > here) & (turned > _AROUND_RAD)]
        return path.up_to(around[0]) if len(around) else path

    @cached_property
    def _place(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tracks = self.scenario.tracks
        along, aside, yaw = self.path.project(tracks.x[self.other, self.steps], tracks.y[self.other, self.steps])
        return along - self.path.driven[self.steps], aside, np.asarray(wrap(tracks.yaw[self.other, self.steps] - yaw))

    @property
    def ahead_m(self) -> Float[np.ndarray, " time"]:
        """How far the other's centre is ahead of the ego's, along the ego's way [m]."""
        return self._place[0]

    @property
    def heading(self) -> Float[np.ndarray, " time"]:
        """The other's heading relative to the ego's way at its place [rad]."""
        return self._place[2]

    @cached_property
    def in_way(self) -> Bool[np.ndarray, " time"]:
        """Whether the other's body reaches into the strip that the ego's body sweeps."""
        agents = self.scenario.agents
        ego, other = agents[EGO], agents[self.other]
        wide = other.length * np.abs(np.sin(self.heading)) + other.width * np.abs(np.cos(self.heading))
        return np.abs(self._place[1]) <= 0.5 * (ego.width + wide)

    @cached_property
    def same_way(self) -> Bool[np.ndarray, " time"]:
        """Whether the two drive in the same direction, within 45 degrees."""
        return np.abs(self.heading) < ALONG_RAD

    @cached_property
    def in_front(self) -> Bool[np.ndarray, " time"]:
        """Whether the other's centre is ahead of the ego's front."""
        return self.ahead_m > 0.5 * self.scenario.agents[EGO].length

    @cached_property
    def beside(self) -> Float[np.ndarray, " time"]:
        """The share of the shorter body that is beside the other body, along the ego's way; negative where none is."""
        ego, other = (self.scenario.agents[agent] for agent in (EGO, self.other))
        long = other.length * np.abs(np.cos(self.heading)) + other.width * np.abs(np.sin(self.heading))
        return (0.5 * (ego.length + long) - np.abs(self.ahead_m)) / np.minimum(ego.length, long)

    @cached_property
    def entry(self) -> int | None:
        """The index into `steps` at which the other finally entered the ego's way; None where it was in it all along.

        For an agent that touches the ego from the side, that is the moment of contact.
        """
        if len(self.steps) < 2:
            return None
        outside = np.flatnonzero(~self.in_way[:-1])
        return int(outside[-1]) + 1 if len(outside) else None

    @cached_property
    def came_over(self) -> int | None:
        """The index into `steps` at which the other moved sideways into the ego's way; None where it did not.

        It must have moved further sideways than the ego, and both must drive the same way; an agent that comes from
        another road must have turned by then.
        """
        at = self.entry
        if at is None or self.crash.drifted(self.other) <= self.crash.drifted(EGO):
            return None
        most = ALONG_RAD if self.same_way[0] else CROSS_RAD
        return at if (np.abs(self.heading[at - 1 : at + 1]) < most).all() else None

    @cached_property
    def crash(self) -> CrashHistory:
        """The contact as the rules of fault see it, with how far the two moved sideways."""
        tracks, agents = self.scenario.tracks, self.scenario.agents
        return CrashHistory(
            self.scenario, collision_at(agents, tracks, (self.other, self.step), self.scenario.dt, attributed=True)
        )

    def drive(self, agent: int) -> AgentDrive:
        """The drive of one of the two agents up to the contact."""
        return agent_drive(self.scenario, agent, self.step)

    def yaw(self, agent: int) -> Float[np.ndarray, " time"]:
        """The heading of one of the two agents at `steps`, continuous [rad]."""
        return np.unwrap(self.scenario.tracks.yaw[agent, self.steps])


def meeting_of(scenario: Scenario) -> Meeting | None:
    """The ego's first contact, otherwise the nearest approach of its adversary; None where there is neither."""
    contact = first_contact(scenario.agents, scenario.tracks)
    if contact is not None:
        return Meeting(scenario, *contact)
    other = scenario.adversary
    if other is None:
        return None
    tracks = scenario.tracks
    apart = np.hypot(tracks.x[other] - tracks.x[EGO], tracks.y[other] - tracks.y[EGO])
    both = tracks.valid[[EGO, other]].all(axis=0)
    return Meeting(scenario, other, int(np.argmin(np.where(both, apart, np.inf)))) if both.any() else None
