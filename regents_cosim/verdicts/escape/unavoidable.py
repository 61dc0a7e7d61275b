"""Prove that no drive avoids a crash once the danger can be known, with reachable sets that are never too small.

From the step at which the adversary visibly departs from its log, without any time to react, the ego is a point mass
that can do whatever the tyres can: |a| <= mu g =: A, with mu = 0.9, the best of dry asphalt, which no manoeuvre and no
reference driver exceeds. After t seconds it is in

    p0 + v0 t + q,   |q| <= A t^2 / 2,  with a velocity in   v0 + sqrt(2) q / t + B(0.4142 A t)

(B(r) is a disc of radius r: |w - c q / t| <= A int |1 - c (1 - s / t)| ds / ..., which is least for c = sqrt 2). Its
heading is that of its velocity, up to the slip of a car that turns about its rear axle, so at each place it is known
within a cone, which turns by no more than the tightest curvature allows either; the area that bodies of all headings in
the cone share is certainly occupied. A place is impossible where that area touches another agent at that step, or where
a corner would be off the road and its verge. The rest at one step bounds where the ego can be later:

    q_j  in  (1 + sqrt(2) (t_j - t_i) / t_i) q_i + B(A (0.4142 t_i (t_j - t_i) + (t_j - t_i)^2 / 2))

Where nothing is left at some step, no drive avoids the crash. Places are the cells of a grid, in which every choice
errs on the side of what is possible: a cell counts as free if one point of it may be. As for the manoeuvres, contacts
count at the steps. A follower of the ego would make way if it braked, and never makes a proof, unless it is the
colliding agent.

Sources: over-approximated reachable sets to prove that no drive is safe (Althoff and Dolan 2014, "Online verification
of automated road vehicles using reachability analysis"; Söntges and Althoff 2018, "Computing the drivable area of
autonomous road vehicles in dynamic road scenes"); friction (Wong 2008, table 1.3).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.attack_record import Collision
from regents_cosim.collisions import apart_at_entry
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.geometry.frames import wrap
from regents_cosim.judgement import Avoidability
from regents_cosim.maps.levels import has_levels
from regents_cosim.norms.limits import ALONG_RAD, CURVATURE_LIMIT, OFF_ROAD_M
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.escape.manoeuvres import GRAVITY

FRICTION_AT_BEST = 0.9

_LONGEST_S = 1.2  # longest time from perception to collision: with more time there always is a drive that avoids it
_AFTER_S = 0.5  # after the collision: what is free by then stays free
_CELL = 0.04  # share of the radius of the reachable disc
_BODY_POINTS = 32  # points on the edge of the certainly occupied area
_TRIED = 24  # directions of steady acceleration
_ROUNDING_M = 0.005  # the motion of a step is an arc, not the mean of two velocities
_LOOSE_M = 0.5  # tracks that differ more from their own speeds prove nothing
_REAR_AXLE = 0.3  # share of the length, behind the middle of a car
_VERGE_M = 1.0  # beside the road: a corner may be there in an emergency, though not in a manoeuvre of the bank
_ROUND = 1.02  # the arcs of a buffer are polygons inside it
_ROAD_M = 60.0  # around the ego

_ROOT, _SPREAD = np.sqrt(2.0), np.sqrt(2.0) - 1.0


def unavoidable(attacked: Scenario, found: Avoidability) -> bool | None:
    """Whether it is proven that no drive avoids the collision once the danger can be known.

    True where that is proven, False where a manoeuvre that begins by then avoids it, None where neither is known.
    """
    since = found.perceived_step or 0
    if found.last_onset_step is not None and found.last_onset_step >= since:
        return False
    return proven_unavoidable(attacked, since) or None


def proven_unavoidable(attacked: Scenario, since: int) -> bool:
    """Whether it is proven that no drive that departs from the ego's at step `since` or later avoids the crash."""
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None or (hit.step - since) * attacked.dt > _LONGEST_S or attacked.heights.stacked:
        return False
    if hit.step <= since:
        return True
    ego, danger = _Ego.of(attacked, since, hit.step), _Danger.of(attacked, since, hit)
    if ego.off > _LOOSE_M:
        return False
    last = min(hit.step + round(_AFTER_S / attacked.dt), attacked.tracks.steps - 1)
    if _escapes(ego, danger, since, last):
        return False
    before = list[_ReachableLayer]()
    for step in range(since + 1, last + 1):
        layer = _reachable(ego, before, (step - since) * attacked.dt)
        free = ~danger.for_certain(ego, layer, step)
        if not free.any():
            return True
        if not free.all():  # otherwise the disc bounds later places as well
            before.append(_ReachableLayer(layer.time, layer.cell, layer.places[free]))
    return False


def _escapes(ego: "_Ego", danger: "_Danger", since: int, last: int) -> bool:
    """Whether a constant acceleration of the point mass is safe and keeps to the road, so that no proof is possible."""
    way = np.exp(2j * np.pi * np.arange(_TRIED) / _TRIED)
    accel = ego.accel * np.concatenate([[0.0], *(share * way for share in (1.0, 0.8, 0.5))])
    free = np.ones(len(accel), bool)
    for step in range(since + 1, last + 1):
        time = (step - since) * danger.attacked.dt
        moved = 0.5 * accel * time**2
        layer = _ReachableLayer(time, 0.0, np.stack([moved.real, moved.imag], axis=-1))
        free &= ~danger.touched(ego, layer, step)
        free[free] &= ~danger.beside_road(ego, layer.take(free))
        if not free.any():
            return False
    return True


@dataclass(frozen=True, eq=False)
class _Ego:
    """The bounds of the ego's motion."""

    place: Float[np.ndarray, " 2"]  # [m] at the start
    yaw: float
    velocity: Float[np.ndarray, " 2"]  # [m/s]
    accel: float  # [m/s^2] greatest
    curvature: float  # [1/m] greatest
    size: Float[np.ndarray, " 2"]  # [m] length and width of its body
    off: float  # [m] deviation of its track from its speeds

    @classmethod
    def of(cls, attacked: Scenario, since: int, until: int) -> "_Ego":
        """The bounds after step `since`; the ego's own drive up to `until` counts as possible whatever it does."""
        own, dt = attacked.tracks, attacked.dt
        x, y, yaw, speed = (values[0, since : until + 1] for values in (own.x, own.y, own.yaw, own.speed))
        place = np.stack([x, y], axis=-1)
        velocity = speed[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        moved = 0.5 * (velocity[1:] + velocity[:-1]) * dt
        off = np.hypot(*(place - place[0] - np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])).T)
        used = np.hypot(*np.diff(velocity, axis=0).T).max(initial=0.0) / dt
        travelled = 0.5 * (speed[1:] + speed[:-1]) * dt
        turns = np.abs(wrap(np.diff(yaw))).sum() > CURVATURE_LIMIT * travelled.sum() + 1e-6
        return cls(
            place=place[0],
            yaw=float(yaw[0]),
            velocity=velocity[0],
            accel=max(FRICTION_AT_BEST * GRAVITY, float(used)),
            curvature=np.inf if turns else CURVATURE_LIMIT,
            size=np.array([attacked.ego.length, attacked.ego.width]),
            off=float(off.max()) + _ROUNDING_M,
        )

    def centre(self, layer: "_ReachableLayer") -> Float[np.ndarray, "cell 2"]:
        """The places of a layer on the map [m]."""
        return self.place + self.velocity * layer.time + layer.places

    def turned(self, layer: "_ReachableLayer") -> tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"]]:
        """Heading at each place [rad], and its greatest error."""
        time = layer.time
        velocity = self.velocity + _ROOT / time * layer.places
        spread = _SPREAD * self.accel * time + _ROOT / time * layer.slack
        speed = np.hypot(*velocity.T)
        cone = np.where(speed > spread, np.arcsin(np.minimum(spread / np.maximum(speed, 1e-9), 1.0)), np.pi)
        tightest = np.minimum(self.curvature, self.accel / np.maximum(speed - spread, 1e-3) ** 2)
        cone += np.arcsin(np.minimum(_REAR_AXLE * self.size[0] * tightest, 1.0))
        cone = np.minimum(cone, np.pi)
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        start = float(np.hypot(*self.velocity))
        widest = min(self.curvature * (start * time + 0.5 * self.accel * time**2), np.pi)
        narrow = widest < cone + np.abs(wrap(heading - self.yaw))  # then only the other bound is the better one
        narrow &= widest < cone
        return np.where(narrow, self.yaw, heading), np.where(narrow, widest, cone)


@dataclass(frozen=True, eq=False)
class _ReachableLayer:
    """The places where the ego may be after `time`: cell centres relative to its place at unchanged velocity."""

    time: float  # [s]
    cell: float  # [m]
    places: Float[np.ndarray, "cell 2"]  # [m]

    def take(self, chosen: np.ndarray) -> "_ReachableLayer":
        """Some of the places, by mask or index."""
        return _ReachableLayer(self.time, self.cell, self.places[chosen])

    @property
    def slack(self) -> float:
        """The greatest distance of a point of a cell from its centre [m]."""
        return self.cell / _ROOT


def _reachable(ego: _Ego, before: list[_ReachableLayer], time: float) -> _ReachableLayer:
    """The cells that can be reached from those that were free before."""
    from scipy.spatial import KDTree  # half a second, and few crashes ask for this

    radius = 0.5 * ego.accel * time**2
    cell = _CELL * radius
    line = cell * np.arange(-np.ceil(1.0 / _CELL), np.ceil(1.0 / _CELL) + 1)
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    layer = _ReachableLayer(time, cell, places)
    places = places[np.hypot(*places.T) <= radius + layer.slack]
    for earlier in before:
        gone = time - earlier.time
        grown = 1.0 + _ROOT * gone / earlier.time
        reach = ego.accel * (_SPREAD * earlier.time * gone + 0.5 * gone**2)
        away, _ = KDTree(grown * earlier.places).query(places, distance_upper_bound=2.0 * radius + 1.0)
        places = places[away <= reach + layer.slack + grown * earlier.slack]
    return _ReachableLayer(time, cell, places)


@dataclass(frozen=True, eq=False)
class _Danger:
    """What the ego must not touch: the others, and the area beside the road."""

    attacked: Scenario
    since: int
    agents: Bool[np.ndarray, " agent"]
    road: shapely.Geometry | None
    on_road: Bool[np.ndarray, " corner"]  # corners that must stay on the road

    @classmethod
    def of(cls, attacked: Scenario, since: int, hit: Collision) -> "_Danger":
        """The danger as for the manoeuvres, without agents that overlap the ego at first and corners off the road."""
        own, until = attacked.tracks, hit.step
        agents = apart_at_entry(attacked.agents, own) & ~_follows(attacked, since, hit)
        if has_levels(attacked.road):
            return cls(attacked, since, agents, None, np.zeros(4, bool))
        x, y, yaw = (values[0, since : until + 1] for values in (own.x, own.y, own.yaw))
        bounds = x.min() - _ROAD_M, y.min() - _ROAD_M, x.max() + _ROAD_M, y.max() + _ROAD_M
        road = shapely.clip_by_rect(attacked.road.drivable, *bounds)
        places = corners(Boxes(x, y, yaw, attacked.ego.length, attacked.ego.width))
        off = shapely.distance(road, shapely.points(places)) > 0.9 * OFF_ROAD_M
        return cls(attacked, since, agents, road, np.asarray(~off.any(axis=0)))

    def for_certain(self, ego: _Ego, layer: _ReachableLayer, step: int) -> Bool[np.ndarray, " cell"]:
        """In which cells the ego certainly touches another agent or leaves the road."""
        found = self.touched(ego, layer, step)
        found[~found] = self.beside_road(ego, layer.take(~found))
        return found

    def touched(self, ego: _Ego, layer: _ReachableLayer, step: int) -> Bool[np.ndarray, " cell"]:
        """In which cells the ego certainly touches another agent."""
        touched = np.zeros(len(layer.places), bool)
        half = 0.5 * ego.size - ego.off - layer.slack
        if half.min() <= 0.0:
            return touched
        heading, cone = ego.turned(layer)
        centre = ego.centre(layer)
        radius = float(np.hypot(*half))
        middle, around = centre.mean(axis=0), float(np.hypot(*np.ptp(centre, axis=0)))
        for x, y, yaw, length, width in self._others(step, middle, around + radius):
            away = np.hypot(*(centre - [x, y]).T)
            near = np.flatnonzero(~touched & (away <= radius + 0.5 * np.hypot(length, width)))
            points = centre[near, None] + _core(half, heading[near], cone[near])
            dx, dy = points[..., 0] - x, points[..., 1] - y
            ahead, left = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
            touched[near] = np.any((np.abs(ahead) <= 0.5 * length) & (np.abs(left) <= 0.5 * width), axis=1)
        return touched

    def _others(self, step: int, middle: np.ndarray, reach: float) -> Iterator[tuple[float, ...]]:
        tracks = self.attacked.tracks
        for agent in np.flatnonzero(self.agents & tracks.valid[:, step]):
            x, y, yaw = (float(values[agent, step]) for values in (tracks.x, tracks.y, tracks.yaw))
            size = self.attacked.agents[agent].length, self.attacked.agents[agent].width
            if np.hypot(*(middle - [x, y])) <= reach + 0.5 * np.hypot(*size):
                yield x, y, yaw, *size

    def beside_road(self, ego: _Ego, layer: _ReachableLayer) -> Bool[np.ndarray, " cell"]:
        """In which cells a corner is certainly off the road."""
        if self.road is None or not self.on_road.any() or not len(layer.places):
            return np.zeros(len(layer.places), bool)
        heading, cone = ego.turned(layer)
        swing = np.hypot(*ego.size) * np.sin(0.5 * cone)  # how far a corner may be off its place
        widest = float(np.quantile(swing, 0.9))  # larger values are not worth the time
        loose = _VERGE_M + widest + layer.slack + ego.off
        area = shapely.buffer(self.road, _ROUND * loose)
        shapely.prepare(area)
        centre = ego.centre(layer)
        places = corners(Boxes(centre[:, 0], centre[:, 1], heading, *ego.size))[:, self.on_road]
        off = ~shapely.contains_xy(area, places[..., 0], places[..., 1]).all(axis=1)
        return off & (swing <= widest)


def _follows(attacked: Scenario, since: int, hit: Collision) -> Bool[np.ndarray, " agent"]:
    """Agents that follow the ego in its direction, except the colliding one."""
    x, y, yaw = (values[:, since] for values in (attacked.tracks.x, attacked.tracks.y, attacked.tracks.yaw))
    ahead = (x - x[0]) * np.cos(yaw[0]) + (y - y[0]) * np.sin(yaw[0])
    same = np.abs(wrap(yaw - yaw[0])) < ALONG_RAD
    return same & (ahead < 0.0) & np.array([agent.id != hit.agent for agent in attacked.agents])


def _core(
    half: Float[np.ndarray, " 2"], heading: Float[np.ndarray, " cell"], cone: Float[np.ndarray, " cell"]
) -> Float[np.ndarray, "cell point 2"]:
    """The centre and points on the edge [m] of the area that bodies of all headings within `cone` of `heading` share.

    In the direction th from the heading it is as far away as the nearest edge of any of them: min over d in the cone of
    a / |cos(th - d)| and b / |sin(th - d)|, with half the length a and half the width b.
    """
    angle = np.linspace(-np.pi, np.pi, _BODY_POINTS, endpoint=False)
    low, high = angle - cone[:, None], angle + cone[:, None]
    along = _greatest(low, high, 0.0)
    across = _greatest(low, high, 0.5 * np.pi)
    radius = np.minimum(half[0] / np.maximum(along, 1e-9), half[1] / np.maximum(across, 1e-9))
    way = heading[:, None] + angle
    edge = radius[..., None] * np.stack([np.cos(way), np.sin(way)], axis=-1)
    return np.concatenate([edge, np.zeros((len(edge), 1, 2))], axis=1)


def _greatest(low: np.ndarray, high: np.ndarray, peak: float) -> np.ndarray:
    """The greatest |cos(angle - peak)| between two angles [rad]."""
    holds = np.floor((high - peak) / np.pi) >= np.ceil((low - peak) / np.pi)
    return np.where(holds, 1.0, np.maximum(np.abs(np.cos(low - peak)), np.abs(np.cos(high - peak))))
