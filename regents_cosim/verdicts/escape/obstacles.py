"""The obstacles of a manoeuvre of the ego: the fixed tracks of all others, and the edge of the road."""

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.attack_record import Collision
from regents_cosim.collisions import apart_at_entry
from regents_cosim.geometry.boxes import Boxes, corners, overlap
from regents_cosim.maps.levels import BAND_M, band, drivable_at, has_levels
from regents_cosim.norms.limits import OFF_ROAD_M
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.escape.manoeuvres import ManoeuvreSet

BEYOND_S = 2.0  # the colliding agent is followed for this long beyond the horizon
_MOVES_M_S = 2.0  # a slower agent is about to stop
_BEYOND_M = 100.0  # margin around the ego's track within which the road counts


class Obstacles:
    """The agents that a manoeuvre may not touch, with their positions up to a little beyond the horizon.

    Agents that already overlap the ego when they first appear are left out (`collisions`).
    """

    def __init__(
        self,
        attacked: Scenario,
        hit: Collision,
        margin_m: float,
        beyond_s: float = BEYOND_S,
        turned_rad: float = 0.0,
    ) -> None:
        """`margin_m` enlarges the ego on every side; moving agents turn by `turned_rad` at the horizon."""
        tracks = attacked.tracks
        ahead = attacked.dt * np.arange(1, round(beyond_s / attacked.dt) + 1)
        speed = tracks.speed[:, -1:]
        yaw = tracks.yaw[:, -1:] + np.where(speed > _MOVES_M_S, turned_rad, 0.0)
        self._x = np.hstack([tracks.x, tracks.x[:, -1:] + speed * np.cos(yaw) * ahead])
        self._y = np.hstack([tracks.y, tracks.y[:, -1:] + speed * np.sin(yaw) * ahead])
        self._yaw = np.hstack([tracks.yaw, yaw + 0.0 * ahead])
        self._z = np.hstack([tracks.z, tracks.z[:, -1:] + 0.0 * ahead])
        self._heights = attacked.heights
        was_hit = np.array([agent.id == hit.agent for agent in attacked.agents])
        self._valid = np.hstack([tracks.valid, np.outer(was_hit & tracks.valid[:, -1], np.ones_like(ahead, bool))])
        self._length, self._width = np.array([(agent.length, agent.width) for agent in attacked.agents]).T
        self._length[0] += 2.0 * margin_m
        self._width[0] += 2.0 * margin_m
        may_be_hit = np.flatnonzero(apart_at_entry(attacked.agents, tracks))
        # the colliding agent first, as it spoils most manoeuvres
        self._agents = sorted(may_be_hit.tolist(), key=lambda agent: not was_hit[agent])

    def untouched_by(self, manoeuvres: ManoeuvreSet, since: int = 0) -> ManoeuvreSet:
        """The manoeuvres that overlap none of the obstacles at any step from `since` on."""
        if not len(manoeuvres):
            return manoeuvres
        size = np.hypot(self._length, self._width)
        reach = 0.5 * (size[:1] + size)[:, None]
        near = self._valid[:, manoeuvres.onset :].copy()
        near[:, : max(since - manoeuvres.onset, 0)] = False
        for mine, all_ in ((manoeuvres.x[:, : near.shape[1]], self._x), (manoeuvres.y[:, : near.shape[1]], self._y)):
            theirs = all_[:, manoeuvres.onset :]
            near &= (mine.min(axis=0) - reach <= theirs) & (theirs <= mine.max(axis=0) + reach)
        comes_near = near.any(axis=1)
        for agent in self._agents:
            if comes_near[agent]:
                steps = np.flatnonzero(near[agent])
                manoeuvres = manoeuvres.take(~self._touched(manoeuvres, agent, steps, float(reach[agent, 0])))
        return manoeuvres

    def _touched(
        self, manoeuvres: ManoeuvreSet, agent: int, steps: np.ndarray, reach: float
    ) -> Bool[np.ndarray, " manoeuvre"]:
        """Which manoeuvres overlap `agent` at one of `steps` after the onset; none does beyond `reach` [m]."""
        x, y, yaw, z = (values[agent, manoeuvres.onset + steps] for values in (self._x, self._y, self._yaw, self._z))
        row, step = np.nonzero((manoeuvres.x[:, steps] - x) ** 2 + (manoeuvres.y[:, steps] - y) ** 2 <= reach**2)
        at = row, steps[step]
        own_z = self._heights.of(0, manoeuvres.x[at], manoeuvres.y[at])
        mine = Boxes(manoeuvres.x[at], manoeuvres.y[at], manoeuvres.yaw[at], self._length[0], self._width[0], own_z)
        theirs = Boxes(x[step], y[step], yaw[step], self._length[agent], self._width[agent], z[step])
        touched = np.zeros(len(manoeuvres), bool)
        touched[row[overlap(mine, theirs)]] = True
        return touched


class DrivableRoad:
    """The road on which the ego may drive, with the tolerance of `clean`."""

    def __init__(self, attacked: Scenario) -> None:
        own = attacked.tracks
        bounds = [edge(values[0]) for edge in (np.min, np.max) for values in (own.x, own.y)]
        around = np.add(bounds, [-_BEYOND_M, -_BEYOND_M, _BEYOND_M, _BEYOND_M])
        self._steps = own.steps
        self._near = around.tolist()
        self._road, self._heights, self._ego = attacked.road, attacked.heights, attacked.ego
        self._allowed: dict[int, BaseGeometry] = {}  # by level

    def keeping_to_it(self, manoeuvres: ManoeuvreSet) -> ManoeuvreSet:
        """The manoeuvres that, up to the horizon, take no corner off the road that was on it at the onset."""
        for stride in (5, 1):  # few steps reveal most of those that leave it
            steps = np.s_[:, : self._steps - manoeuvres.onset : stride]
            places = corners(
                Boxes(
                    manoeuvres.x[steps], manoeuvres.y[steps], manoeuvres.yaw[steps], self._ego.length, self._ego.width
                )
            )
            on = self._contains(places, self._heights.of(0, manoeuvres.x[steps], manoeuvres.y[steps]))
            manoeuvres = manoeuvres.take(np.all(on | ~on[:, :1], axis=(1, 2)))
        return manoeuvres

    def _contains(
        self, places: Float[np.ndarray, "*axes corner 2"], z: Float[np.ndarray, "*axes"]
    ) -> Bool[np.ndarray, "*axes corner"]:
        """Whether points at heights `z` [m] are on the road of their level."""
        if not has_levels(self._road):
            return shapely.contains_xy(self._area(0), places[..., 0], places[..., 1])
        on = np.zeros(places.shape[:-1], bool)
        for level in np.unique(band(z)).tolist():
            here = band(z) == level
            on[here] = shapely.contains_xy(self._area(level), places[here][..., 0], places[here][..., 1])
        return on

    def _area(self, level: int) -> BaseGeometry:
        if level not in self._allowed:
            road = shapely.clip_by_rect(drivable_at(self._road, level * BAND_M), *self._near)
            self._allowed[level] = road.buffer(OFF_ROAD_M)
            shapely.prepare(self._allowed[level])
        return self._allowed[level]
