"""The history of a collision, as the rules of fault need it: speeds, gaps, lane changes and offences."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import headings_near
from regents_cosim.maps.levels import height_on
from regents_cosim.norms.grades import OffenceName
from regents_cosim.norms.limits import ALONG_RAD, STANDING_M_S
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.law.drive import OffendingAct, gaps, together_since
from regents_cosim.verdicts.law.offences import acts

EGO = 0
_MERGED_S = 2.0  # an agent that came into the lane within this time has cut in
_LATE_S = 1.0  # an offence that ended longer before the crash did not lead to it
_TURN_S = 3.0
_LANE_REACH_M = 5.0


@dataclass(frozen=True, eq=False)
class CrashHistory:
    """The collision of a scenario, and the motion that led to it."""

    scenario: Scenario
    hit: Collision

    @cached_property
    def other(self) -> int:
        """Index of the road user that collides with the ego."""
        return self.scenario.index(self.hit.agent)

    @cached_property
    def first(self) -> int:
        """The step from which on both are present."""
        return together_since(self.scenario.tracks, (EGO, self.other), self.hit.step)

    @cached_property
    def before(self) -> int:
        """The last step without contact; that of the contact where one of them was absent before."""
        return max(self.hit.step - 1, self.first)

    def name(self, agent: int) -> str:
        """The name of an agent in sentences."""
        return "the ego" if agent == EGO else "the adversary"

    def speed(self, agent: int, step: int) -> float:
        """The speed of an agent at a step [m/s]."""
        return float(self.scenario.tracks.speed[agent, step])

    def turn(self, step: int) -> float:
        """The angle between both headings at a step [rad]."""
        yaw = self.scenario.tracks.yaw
        return abs(float(wrap(yaw[self.other, step] - yaw[EGO, step])))

    def gaps(self, follower: int, leader: int, step: int) -> tuple[float, float]:
        """Gaps [m] bumper to bumper along the follower's heading, and side to side; negative where they overlap."""
        return gaps(self.scenario, follower, leader, step)

    def acts(self, name: OffenceName, within_s: float = np.inf) -> dict[int, OffendingAct]:
        """The acts of one kind against the law in the last seconds, by agent."""
        since = max(self.hit.step - within_s / self.scenario.dt, 0)
        return acts(self.scenario, name, self.hit.step, (EGO, self.other), int(since))

    def late_acts(self, name: OffenceName) -> dict[int, OffendingAct]:
        """The acts of one kind within the last second, by agent, of agents that moved in that second."""
        late = slice(max(self.before - round(_LATE_S / self.scenario.dt), 0), self.before + 1)
        speed = self.scenario.tracks.speed[:, late]
        return {a: act for a, act in self.acts(name, _LATE_S).items() if speed[a].max() > STANDING_M_S}

    def turned(self, agent: int) -> float:
        """The change of an agent's heading over the last seconds [rad], positive to the left."""
        first = max(self.before - round(_TURN_S / self.scenario.dt), 0)
        steps = np.arange(first, self.before + 1)[self.scenario.tracks.valid[agent, first : self.before + 1]]
        yaw = np.unwrap(self.scenario.tracks.yaw[agent, steps])
        return float(yaw[-1] - yaw[0])

    @cached_property
    def lately(self) -> int:
        """The step 2 s before the last one without contact, or the one from which on both are present."""
        return max(self.before - round(_MERGED_S / self.scenario.dt), self.first)

    def cut_in(self, follower: int, leader: int) -> int | None:
        """The step within the last 2 s at which two agents side by side came into one lane; None if it was earlier."""
        apart = [k for k in range(self.lately, self.before + 1) if self.gaps(follower, leader, k)[1] > 0.0]
        return min(apart[-1] + 1, self.before) if apart else None

    def drifted(self, agent: int) -> float:
        """How far [m] an agent moved across its road in the last 2 s."""
        steps = np.arange(self.lately, self.before)
        road = self._road_headings(agent, steps)
        lately, tracks = np.s_[agent, self.lately : self.before + 1], self.scenario.tracks
        _, left = ahead_and_left(np, np.diff(tracks.x[lately]), np.diff(tracks.y[lately]), road)
        return abs(float(np.sum(left)))

    def _road_headings(self, agent: int, steps: Int[np.ndarray, " step"]) -> Float[np.ndarray, " step"]:
        """The heading [rad] of the nearest lane that runs in the agent's direction, or its own where there is none."""
        road, tracks = self.scenario.road, self.scenario.tracks
        x, y, z, yaw = (values[agent, steps] for values in (tracks.x, tracks.y, tracks.z, tracks.yaw))
        places = np.asarray(shapely.points(x, y))
        step, lane = road.centre_lines.query(places, predicate="dwithin", distance=_LANE_REACH_M)
        on = np.stack([x, y], axis=-1)[step]
        height = np.array([float(height_on(road.lanes[i], at)) for i, at in zip(lane, on, strict=True)])
        line, place = road.centre_lines.geometries[lane], places[step]
        heading = headings_near(line, place)
        along = same_level(height, z[step]) & (np.abs(wrap(heading - yaw[step])) < ALONG_RAD)
        nearest_last = np.argsort(shapely.distance(line, place), kind="stable")[::-1]  # the last value written stays
        chosen = nearest_last[along[nearest_last]]
        yaw[step[chosen]] = heading[chosen]
        return yaw
