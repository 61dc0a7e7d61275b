"""What an ego did in a case, as far as its metrics ask.

Source of completion and infraction: the CARLA leaderboard 1.0, which KING (Hanselmann et al. 2022) uses. Its page on
evaluation, leaderboard.carla.org/evaluation_v1_0, lists the penalties: a collision with a pedestrian 0.50, with a
vehicle 0.60, a red light 0.70, off-road driving by its share. Its code, `leaderboard/utils/statistics_manager.py`,
multiplies by 1 - share, and `OutsideRouteLanesTest` of scenario_runner adds the distances off the road and in lanes of
the wrong direction.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.evaluation.drives.safety import Safety, measure_drive
from regents_cosim.geometry.boxes import Boxes
from regents_cosim.geometry.lines import steps_along
from regents_cosim.scenario.attack_record import CollisionType
from regents_cosim.scenario.collisions import collision_type_of, first_contact
from regents_cosim.scenario.scenario import Kind, Scenario, Tracks
from regents_cosim.verdicts.law.drive import AgentDrive
from regents_cosim.verdicts.law.offences import against_direction, knows_lights, red_lights
from regents_cosim.verdicts.leaving_road import corners_off_road

_RED_LIGHT = 0.7
_SAME_M = 0.05  # a vehicle this near to its log all the time replays it
_OFF_ROUTE_M = 4.0  # farther from its logged path, the ego is on another road


@dataclass(frozen=True, eq=False)
class EgoDrive:
    """An ego along `tracks`, to the end of the horizon or its first collision: what metrics are measured on."""

    scenario: Scenario
    tracks: Tracks
    contact: tuple[int, int] | None  # the agent that it meets, and the step
    way: Float[np.ndarray, "time 2"]  # its positions [m]
    off_road: Bool[np.ndarray, " time"]  # a corner is more than 0.3 m off the road
    against_direction: Bool[np.ndarray, " time"] | None  # on lanes that run only the other way; None: none are known
    red_lights: int | None  # number that it runs; None: the lights are not known
    safety: Safety  # how close others came

    @classmethod
    def of(cls, scenario: Scenario, tracks: Tracks) -> "EgoDrive":
        """The drive, and what it did."""
        contact, ego = first_contact(scenario.agents, tracks), scenario.ego
        end = tracks.steps if contact is None else contact[1] + 1
        by_law = AgentDrive(scenario, 0, tracks, end - 1)
        size = np.float64(ego.length), np.float64(ego.width)
        box = Boxes(tracks.x[0], tracks.y[0], tracks.yaw[0], *size, tracks.z[0])
        return cls(
            scenario, tracks, contact, _places(tracks)[:end],
            off_road=np.any(corners_off_road(scenario.road, box), axis=-1)[:end],
            against_direction=against_direction(by_law) if scenario.road.lanes else None,
            red_lights=len(red_lights(by_law)) if knows_lights(scenario) else None,
            safety=measure_drive(scenario.agents, tracks, scenario.dt, contact[1] if contact else None),
        )  # fmt: skip

    @property
    def completion(self) -> float:
        """The share of the recorded way."""
        return route_completion(_places(self.scenario.recorded_tracks), self.way)

    @cached_property
    def collision_type(self) -> CollisionType | None:
        """How the two meet; None without a contact."""
        return collision_type_of(self.scenario.agents, self.tracks, *self.contact) if self.contact else None

    @cached_property
    def rear_ended(self) -> bool:
        """Whether a follower that replays its log, and so cannot brake, drives into its rear."""
        if self.contact is None or self.collision_type != "rear_end_by_adversary":
            return False
        agent, step = self.contact
        until, log = np.s_[agent, : step + 1], self.scenario.tracks
        away = np.hypot(self.tracks.x[until] - log.x[until], self.tracks.y[until] - log.y[until])
        return self.scenario.agents[agent].role != "adversary" and bool((away < _SAME_M).all())

    @property
    def collides(self) -> bool:
        """Whether it has a collision that counts."""
        return self.contact is not None and not self.rear_ended

    @property
    def infraction(self) -> float:
        """The product of penalties."""
        outside = self.off_road if self.against_direction is None else self.off_road | self.against_direction
        hit = self.scenario.agents[self.contact[0]].kind if self.contact and not self.rear_ended else None
        return infraction_score(hit, share_of_way(self.way, outside), self.red_lights or 0)


def _places(tracks: Tracks) -> Float[np.ndarray, "time 2"]:
    return np.stack([tracks.x[0], tracks.y[0]], axis=-1)


def route_completion(route: Float[np.ndarray, "point 2"], driven: Float[np.ndarray, "time 2"]) -> float:
    """The share of the logged `route` [m] that the positions `driven` [m] reach; 1 for a route without length.

    Positions more than 4 m off the route do not count, and neither does the way beyond its end.
    """
    line = shapely.LineString(route)
    if line.length == 0.0:
        return 1.0
    points = shapely.points(driven)
    along, away = np.asarray(shapely.line_locate_point(line, points)), np.asarray(shapely.distance(line, points))
    reached = along[away <= _OFF_ROUTE_M]
    return float(reached.max(initial=0.0) / line.length)


def share_of_way(driven: Float[np.ndarray, "time 2"], holds: Bool[np.ndarray, " time"]) -> float:
    """The share of the driven distance [m] on which something held, at the end of each step; 0 where it stood."""
    ways = steps_along(*driven.T)
    total = ways.sum()
    return float((ways * holds[1:]).sum() / total) if total > 0.0 else 0.0


def infraction_score(hit: Kind | None, outside: float, red_lights: int = 0) -> float:
    """Product of penalties: 0.5 for hitting a pedestrian or cyclist, 0.6 for a vehicle; 0.7 for each red light run.

    The share `outside` of the distance that is not on allowed lanes (off the road, or against the direction) counts as
    1 - share, as in the leaderboard's `OutsideRouteLanesTest`.
    """
    penalty = 1.0 if hit is None else 0.5 if hit in ("pedestrian", "bicycle") else 0.6
    return penalty * _RED_LIGHT**red_lights * (1.0 - outside)
