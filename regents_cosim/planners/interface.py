"""What a planner is: it is told the scene once, then asked at every step what to do. No JAX here.

Ten lines do:

```python
from regents_cosim import Control


class Cautious:
    def reset(self, scene):
        pass

    def act(self, observation):
        ahead = [other.seen_from(observation.ego)[0] for other in observation.others]
        return Control(accel=-4.0 if any(0.0 < gap < 15.0 for gap in ahead) else 1.0, curvature=0.0)
```

Such a planner runs in a process of its own (`host_process`), so it may be anything: torch, a C++ binding, a
client of a server. One written in JAX (`jax_planner`) runs inside the compiled loop of the attack instead.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.frames import Pose, ahead_and_left, wrap
from regents_cosim.maps.lanelets import ribbons
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.bodies import Bodies
from regents_cosim.routes.give_way import Meeting
from regents_cosim.routes.route import OnRoute, Route, route_to
from regents_cosim.scenario.scenario import MOST, MOST_EXTENT_M, Agent, Kind, Scenario, Signal
from regents_cosim.short_repr import ShortRepr

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork  # pyright: ignore[reportMissingImports]

_STANDS_M_S = 0.1  # slower, a turn tells nothing about the wheels
_PASSED_M = 1.0  # a stop line this far behind the front no longer holds
_MOST_AWAY_M = 0.5 * MOST_EXTENT_M  # from where an ego began
EXPECTED_PLACE = (
    f"expected a place within {_MOST_AWAY_M / 1e3:g} km of the start, a speed of at most {MOST['speed']:g} m/s and a "
    f"yaw of at most {MOST['yaw']:g} rad"
)

# Frame of everything here: the map's own (x east, y north, metres), box centres, yaw counter-clockwise from +x.


WHEELBASE = 0.6  # of the length: about that of passenger cars


Path = Float[np.ndarray, "_ 2"]  # [m]
MOST_PATHS, MOST_POINTS, MOST_LETTERS = 32, 64, 300  # of each kind, of a path, of a text in `Debug`


@dataclass(frozen=True, eq=False, repr=False)
class Debug(ShortRepr):
    """What a planner thought when it decided, for the film and the player of a crash.

    The first 32 candidates and predictions, 64 points of each and 300 letters are kept.
    """

    candidates: Sequence[Path] = ()  # [m] the paths that it weighed ...
    costs: Sequence[float] = ()  # ... and the cost of each, in any unit; empty: not told
    chosen: Path | None = None  # [m] the path that it takes
    predictions: Sequence[Path] = ()  # [m] where it expects others to go
    text: str = ""


DebugSteps = tuple[tuple[int, Debug], ...]  # by step, in order


@dataclass(frozen=True)
class Control:
    """The controls of the ego until the next step, within `Scene.max_accel` and `Scene.max_curvature`.

    The ego's x, y are the centre of its box. This point moves in the direction of the box, as the rear axle of a
    bicycle model does; `curvature` is that of its path. So the model has no wheelbase. A planner that steers front
    wheels by an angle d at a wheelbase L returns the curvature tan(d) / L; if L is not known, take `WHEELBASE` times
    the length.
    """

    accel: float  # [m/s^2]
    curvature: float  # [1/m] positive turns left
    debug: Debug | None = field(default=None, compare=False)


@dataclass(frozen=True, eq=False, repr=False)
class Waypoints(ShortRepr):
    """Positions where the ego should be after 1, 2, ... times `spacing_s`; our controller steers along them."""

    points: Path  # [m] x, y in the map's frame, shape [point, 2]
    spacing_s: float = 0.5  # [s]
    debug: Debug | None = None


@dataclass(frozen=True)
class Placement:
    """The ego's state at the next step, from a simulator that moves it by its own model."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad]
    speed: float  # [m/s] never negative


def can_be_at(begin: tuple[float, float], placed: Placement) -> bool:
    """Whether an ego that began at x, y [m] can be there: finite numbers, so near that its drive is a Scenario."""
    away = math.hypot(placed.x - begin[0], placed.y - begin[1])
    return away <= _MOST_AWAY_M and abs(placed.yaw) <= MOST["yaw"] and 0.0 <= placed.speed <= MOST["speed"]


@dataclass(frozen=True)
class AgentState:
    """One road user at one instant, in the map's frame: x east, y north, centre of its box."""

    id: str
    kind: Kind
    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad] counter-clockwise from +x
    speed: float  # [m/s] never negative
    length: float  # [m]
    width: float  # [m]
    z: float = 0.0  # [m] height of the road under it

    def seen_from(self, ego: "AgentState") -> tuple[float, float]:
        """How far ahead of `ego` and to its left this road user is, centre to centre: (ahead, left) [m]."""
        ahead, left = ahead_and_left(np, self.x - ego.x, self.y - ego.y, ego.yaw)
        return float(ahead), float(left)


class Snapshot(NamedTuple):
    """All agents at one instant, the ego first, 0 where absent; box centres in the map's frame."""

    x: Float[np.ndarray, " agent"]  # [m]
    y: Float[np.ndarray, " agent"]  # [m]
    yaw: Float[np.ndarray, " agent"]  # [rad]
    speed: Float[np.ndarray, " agent"]  # [m/s]
    valid: Bool[np.ndarray, " agent"]
    z: Float[np.ndarray, " agent"] | float = 0.0  # [m] height of the road


class Others(Bodies):
    """The other road users as arrays in a fixed order of the scene; iteration gives those that are present."""

    def __iter__(self) -> Iterator[AgentState]:
        for index in np.flatnonzero(self.valid).tolist():
            yield self.state(index)

    def state(self, index: int) -> AgentState:
        """The state of one road user."""
        agent = self.agents[index]
        state = self.x, self.y, self.yaw, self.speed, np.asarray(self.z)
        x, y, yaw, speed, z = (float(values[index]) for values in state)
        return AgentState(agent.id, agent.kind, x, y, yaw, speed, agent.length, agent.width, z)


@dataclass(frozen=True)
class Light:
    """A traffic light at the end of a lane, for one way on from there."""

    lane: str
    to_lane: str
    x: float  # [m] stop line, in the middle of the lane
    y: float  # [m]
    shows: str  # SUMO's letter: r red, y yellow, g/G green, u red-yellow, s stop, o/O off


@dataclass(frozen=True)
class LightAhead:
    """A traffic light on the ego's route."""

    gap: float  # [m] from the ego's front to the stop line; negative beyond it
    lane: str
    to_lane: str
    shows: str  # as in `Light`


@dataclass(frozen=True)
class Leader:
    """The road user that the ego follows on its route."""

    agent: AgentState
    gap: float  # [m] along the route, from the ego's front to its rear


@dataclass(frozen=True, eq=False, repr=False)
class Scene(ShortRepr):
    """What a planner knows before the first step, in the map's frame; nothing in it tells what the others will do."""

    id: str
    dt: float  # [s] between two decisions
    steps: int  # instants of the scene, one more than the decisions
    ego: AgentState  # at the first step
    others: tuple[Agent, ...]  # all others that may appear, in the order of `Observation.others`
    target: tuple[float, float]  # [m] where the ego should arrive
    road: RoadMap
    max_accel: float  # [m/s^2] limit of a Control, in either direction
    max_curvature: float  # [1/m] limit of a Control, to either side
    _signals: tuple[Signal, ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, scenario: Scenario, max_accel: float, max_curvature: float) -> "Scene":
        """The scene of `scenario`, with the limits of the model that moves the ego."""
        tracks, ego = scenario.tracks, scenario.ego
        state = tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.z
        x, y, yaw, speed, z = (float(values[0, 0]) for values in state)
        return cls(
            id=scenario.id,
            dt=scenario.dt,
            steps=tracks.steps,
            ego=AgentState(ego.id, ego.kind, x, y, yaw, speed, ego.length, ego.width, z),
            # hides who is the adversary
            others=tuple(replace(agent, role="background") for agent in scenario.agents[1:]),
            target=scenario.target,
            road=scenario.road,
            max_accel=max_accel,
            max_curvature=max_curvature,
            _signals=scenario.signals,
        )

    @cached_property
    def route(self) -> Route:
        """The route from the ego's start to its target: lanes, centre line, limits, stop lines, right of way."""
        ego = self.ego
        route = route_to(self.road, Pose(ego.x, ego.y, ego.yaw), ego.z, ego.speed, self.target)
        return replace(route, max_curvature=self.max_curvature)

    def shapely(self) -> dict[str, BaseGeometry]:
        """The area of each lane as a polygon [m, map frame], by lane id; `road.drivable` is that of the whole road."""
        return {name: sides.area for name, sides in ribbons(self.road).items()}

    def commonroad(self) -> "LaneletNetwork":
        """The map as commonroad-io's object: lanelets without holes, speed limits, stop lines and traffic lights.

        Lanelet k is `road.lanes[k - 1]`. Raises MissingDependencyError without commonroad-io.
        """
        from regents_cosim.exports.commonroad_map import lanelet_network

        return lanelet_network(self.road, self._signals, self.steps)

    def lights(self, step: int) -> tuple[Light, ...]:
        """All traffic lights as they are at `step`."""
        letters = {signal.id: signal.letters(step) for signal in self._signals}
        return tuple(
            Light(source, target, x, y, letters[signal][link])
            for source, target, x, y, signal, link in self._stop_lines
            if signal in letters
        )

    @cached_property
    def _stop_lines(self) -> list[tuple[str, str, float, float, str, int]]:
        found = []
        for connection in self.road.connections:
            if connection.signal is not None:
                x, y = self.road.lane[connection.source].centre[-1].tolist()
                found.append((connection.source, connection.target, x, y, connection.signal, connection.link))
        return found


@dataclass(frozen=True, eq=False, repr=False)
class Observation(ShortRepr):
    """What a planner sees at one step, in the map's frame."""

    scene: Scene
    step: int  # from 0
    ego: AgentState  # now
    others: Others  # now; iteration gives an `AgentState` for each road user that is present
    before: AgentState | None = None  # the ego one step ago; None at the first step

    @property
    def time_s(self) -> float:
        """Time since the start of the scene [s]."""
        return self.step * self.scene.dt

    @property
    def target(self) -> tuple[float, float]:
        """Where the ego should arrive: x, y [m, map frame]."""
        return self.scene.target

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """The traffic lights of the map as they are now."""
        return self.scene.lights(self.step)

    @cached_property
    def acceleration(self) -> float:
        """The ego's acceleration over the last step [m/s^2]; 0 at the first step."""
        return 0.0 if self.before is None else (self.ego.speed - self.before.speed) / self.scene.dt

    @cached_property
    def yaw_rate(self) -> float:
        """The ego's turn over the last step [rad/s], positive to the left; 0 at the first step."""
        if self.before is None:
            return 0.0
        return float(wrap(np.asarray(self.ego.yaw - self.before.yaw))) / self.scene.dt

    @cached_property
    def steering(self) -> float:
        """The angle of front wheels [rad] that gives this turn at this speed, with a wheelbase as in `Control`."""
        speed = self.ego.speed if self.before is None else 0.5 * (self.ego.speed + self.before.speed)
        curvature = self.yaw_rate / speed if speed > _STANDS_M_S else 0.0
        return float(np.arctan(WHEELBASE * self.ego.length * curvature))

    @cached_property
    def on_route(self) -> OnRoute:
        """The ego's place on `scene.route`."""
        return self.scene.route.project(self.ego.x, self.ego.y)

    @cached_property
    def leader(self) -> Leader | None:
        """The next road user ahead that reaches into the ego's way along its route, 0.3 m on either side included."""
        ego, front = self.ego, float(self.on_route.along) + 0.5 * self.ego.length
        found = self.scene.route.next_ahead(front, ego.width, self.others)
        return None if found is None else Leader(self.others.state(found[0]), found[1])

    @cached_property
    def lights_ahead(self) -> tuple[LightAhead, ...]:
        """The traffic lights on the ego's route as they are now, the next first, up to 1 m behind its front."""
        front = float(self.on_route.along) + 0.5 * self.ego.length
        lights = [(light, light.shows(self.scene._signals, self.step)) for light in self.scene.route.lights]
        return tuple(
            LightAhead(light.distance_m - front, light.lane, light.to_lane, shows)
            for light, shows in lights
            if shows and light.distance_m - front >= -_PASSED_M
        )

    @cached_property
    def meetings_ahead(self) -> tuple[Meeting, ...]:
        """Where others cross or join the ego's route ahead, with the right of way under the lights as they are now."""
        rear = float(self.on_route.along) - 0.5 * self.ego.length
        ahead = (one for one in self.scene.route.meetings if one.end_m > rear)
        return tuple(one.under(self.scene._signals, self.step) for one in ahead)

    def lanes_within(self, radius_m: float) -> list[Lane]:
        """Lanes of the map within `radius_m` [m] of the ego, the nearest first."""
        road, here = self.scene.road, shapely.Point(self.ego.x, self.ego.y)
        found = road.centre_lines.query(here, predicate="dwithin", distance=radius_m)
        away = shapely.distance(road.centre_lines.geometries[found], here)
        return [road.lanes[index] for index in found[np.argsort(away, kind="stable")].tolist()]


Decision = Control | Waypoints | Placement


@runtime_checkable
class Planner(Protocol):
    """A planner outside JAX. `reset` is called before every drive, even in the same scene.

    A planner that also has `act_batch(observations) -> decisions` and `reset_batch(scenes)` drives many scenes at once.
    If it raises or returns a value that is not finite, the drive of that case fails, and all others go on.
    """

    def reset(self, scene: Scene) -> None:
        """Prepare for a drive from the first step on."""
        ...

    def act(self, observation: Observation) -> Control | Waypoints | Placement:
        """Decide what the ego does until the next step; `Placement` is for the drivers of simulators."""
        ...


@runtime_checkable
class BatchPlanner(Planner, Protocol):
    """A planner that drives many scenes at once, with decisions in the order of the observations."""

    def reset_batch(self, scenes: Sequence[Scene]) -> None:
        """Prepare for drives from the first step on, one in each scene."""
        ...

    def act_batch(self, observations: Sequence[Observation]) -> Sequence[Control | Waypoints | Placement]:
        """Decide what each ego does until the next step; observation i belongs to scene i."""
        ...
