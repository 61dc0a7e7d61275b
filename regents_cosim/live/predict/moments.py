"""A moment of traffic with the prediction from it, in the forms that planners and searches take.

All moments of a run have equal shapes on the device, so that each program is compiled once.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.traffic import PredictedDrive, Shows, TrafficState
from regents_cosim.live.predict.traffic_ahead import Predictor
from regents_cosim.maps.levels import has_levels
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.mirror.actions import OF_PREDICTIONS
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lane_centres import lane_centres
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.road_field import RoadField, blur
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import World, scene_origin, to_world
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, start
from regents_cosim.scenario.scenario import Provenance, Scenario, Signal, Tracks

DT_S = 0.1  # of predictions and plans, whatever the simulation's step
MOST_AGENTS = 32
_LANE_POINTS = 2**12
_TILE_M = 80.0  # the road is known this far around the middle of a tile
_LEAVES_TILE_M = 25.0  # distance from the middle at which the ego leaves the tile
_ROUNDED = 1e-6  # of a step
_PREPARED_M = 20.0  # between two plans the next tile is prepared once the ego is this far from the middle


@dataclass(frozen=True, eq=False)
class Moment:
    """Traffic at one instant, and the scenario that is predicted from it."""

    traffic: TrafficState
    scenario: Scenario
    world: World
    _memories: dict[str, Any] = field(default_factory=dict)  # since a search and its samples begin in the same moment

    @property
    def forecast(self) -> Forecast:
        """The predicted motion."""
        ids = tuple(agent.id for agent in self.scenario.agents)
        return Forecast(self.traffic.time_s, DT_S, ids, self.scenario.tracks)

    @property
    def origin(self) -> Float[np.ndarray, " 2"]:
        """The origin of the device's coordinates [m, map frame]."""
        return scene_origin(self.scenario)

    @cached_property
    def background(self) -> Motion:
        """The predicted motion [agent time] of all agents, by the mirror's model."""
        return jax.block_until_ready(_as_predicted(self.world))

    def memory(self, planner: JaxPlanner, name: str) -> Any:
        """The initial memory of the planner called `name`. Raises DriveError."""
        if name not in self._memories:
            self._memories[name] = start(planner, CompiledScene(self.scenario, self.world, self.traffic.way), name)
        return self._memories[name]

    @cached_property
    def with_lanes(self) -> World:
        """The world with the centre lines of its lanes, as a careful driver sees it."""
        return replace(self.world, lanes=lane_centres(self.scenario, self.origin, _LANE_POINTS))


class Moments:
    """Makes moments, and caches the road around the ego."""

    def __init__(self, predictor: Predictor, horizon_s: float) -> None:
        self.predictor, self.horizon_s = predictor, horizon_s
        self.steps = round(horizon_s / DT_S) + 1
        self._tile: tuple[RoadMap, np.ndarray, RoadField] | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> "Moments":
        """An independent copy; cached roads are immutable and shared."""
        return copy.copy(self)

    def prepare(self, road: RoadMap, x: float, y: float) -> None:
        """Prepare the field of the road around an ego at x, y [m] if it is about to leave the last tile."""
        if not has_levels(road):
            self._tile_at(road, np.array([x, y]), _PREPARED_M)

    def forget(self) -> None:
        """Forget the last run, so that the next one does not depend on it."""
        self._tile = None

    def of(self, traffic: TrafficState, known: Mapping[str, PredictedDrive] | None = None) -> Moment:
        """The moment of some traffic; some vehicles have `known` drives, by id."""
        tracks = self.foreseen(traffic, self.steps, known or {})
        scenario = Scenario(
            id="live",
            dt=DT_S,
            agents=tuple(user.agent for user in traffic.users),
            tracks=tracks,
            target=(float(tracks.x[0, -1]), float(tracks.y[0, -1])),
            road=traffic.road,
            provenance=Provenance("live", "", "", traffic.time_s),
            signals=tuple(Signal(name, self._changes(shows)) for name, shows in sorted(traffic.lights.items())),
        )
        road = None if scenario.heights.stacked else self._road(scenario)
        return Moment(traffic, scenario, to_world(scenario, room=MOST_AGENTS, road=road, passes=OF_PREDICTIONS))

    def foreseen(self, traffic: TrafficState, steps: int, known: Mapping[str, PredictedDrive]) -> Tracks:
        """The predicted tracks of some traffic; vehicles with known drives follow them exactly, and others react to
        them.
        """
        return _with_drives(self.predictor.predict(traffic.driving(known), DT_S, steps), traffic, known)

    def _changes(self, shows: Shows) -> tuple[tuple[int, str], ...]:
        """The steps at which a light changes, with its letters."""
        at = {math.ceil(since_s / DT_S - _ROUNDED): letters for since_s, letters in shows}
        return tuple((step, letters) for step, letters in at.items() if step < self.steps)

    def _road(self, scenario: Scenario) -> RoadField:
        """The field around the ego; it is computed again only when the ego has left the last tile."""
        ego = np.array([scenario.tracks.x[0, 0], scenario.tracks.y[0, 0]])
        middle, field = self._tile_at(scenario.road, ego, _LEAVES_TILE_M)
        return field.seen_from(scene_origin(scenario) - middle)

    def _tile_at(
        self, road: RoadMap, ego: Float[np.ndarray, " 2"], leaves_m: float
    ) -> tuple[Float[np.ndarray, " 2"], RoadField]:
        """The middle of the last tile [m] and its field; a new tile where the ego is farther than `leaves_m` from the
        middle.
        """
        known = self._tile
        if known is None or known[0] is not road or np.abs(ego - known[1]).max() > leaves_m:
            known = self._tile = road, ego, blur(road, ego - _TILE_M, ego + _TILE_M, ego)
        return known[1], known[2]


def _with_drives(tracks: Tracks, traffic: TrafficState, known: Mapping[str, PredictedDrive]) -> Tracks:
    """Tracks of the traffic's users, with the known drives in place of predictions."""
    rows = {index: drive for name, drive in known.items() if (index := traffic.index(name)) is not None}
    if not rows:
        return tracks
    values = {name: getattr(tracks, name).copy() for name in ("x", "y", "yaw", "speed", "valid", "z")}
    for index, drive in rows.items():
        for name, row in zip(("x", "y", "yaw", "speed"), drive[:, : tracks.steps], strict=True):
            values[name][index] = row
        values["valid"][index] = True
        values["z"][index] = traffic.users[index].z
    return Tracks(**values)


@compiled
def _as_predicted(world: World) -> Motion:
    return roll_out_background(world, world.controls)
