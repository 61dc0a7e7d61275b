"""What all vehicles will do within the next seconds: the log that a live attack departs from.

A predictor is anything with `predict(traffic, dt, steps) -> Tracks`. `Mirror` lets each go on along its own
route by car-following with its own parameters, and minds the lights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.frames import wrap
from regents_cosim.live.paths import BEHIND_M, SPACING_M, Stop
from regents_cosim.live.traffic import TrafficState
from regents_cosim.scenario import Tracks

_CELL_M = 2.0  # of the grid that knows which point of a path is near
_STEPS_AT_ONCE = 2  # of the tracks, for each step of the drivers
_BESIDE_M = 0.1  # that a leader may be beside the body
_HARDEST_BRAKE = 8.0  # [m/s^2]
_LEAST_GAP_M = 0.1
_FAR_M = 1e4

Drive = Float[np.ndarray, "4 time"]  # x, y [m], yaw [rad], speed [m/s]


class Predictor(Protocol):
    """Says where each vehicle will be."""

    def predict(self, traffic: TrafficState, dt: float, steps: int) -> Tracks:
        """The tracks [user, time] of the traffic's users from now on, `steps` instants `dt` [s] apart."""
        ...


class Mirror:
    """Each vehicle on its own route, by Krauss' model or the Intelligent Driver Model, with its parameters in SUMO.

    Sources: Krauss 1998, with the dawdling that is to be expected; Treiber, Hennecke and Helbing 2000. A body on the
    path is a leader; closed lights, and junctions that others have to be let through first, are standing leaders.
    """

    def predict(self, traffic: TrafficState, dt: float, steps: int) -> Tracks:
        """The tracks [user, time] from now on."""
        drivers = _Drivers.of(traffic)
        coarse = _STEPS_AT_ONCE * dt
        begun = drivers.begin()
        driven = [begun]
        while len(driven) * _STEPS_AT_ONCE < steps + _STEPS_AT_ONCE - 1:
            driven.append(drivers.advance(driven[-1], (len(driven) - 1) * coarse, coarse))
        along, speed = (np.stack(values, axis=1) for values in list(zip(*driven, strict=True))[:2])
        at, fine = np.arange(along.shape[1]) * coarse, np.arange(steps) * dt
        along, speed = (np.stack([np.interp(fine, at, row) for row in values]) for values in (along, speed))
        return drivers.tracks(along, speed, traffic)


class _Driven(NamedTuple):
    """How far all are after some time [m], how fast [m/s], and which lines they no longer stop at."""

    along: Float[np.ndarray, " user"]
    speed: Float[np.ndarray, " user"]
    passes: Bool[np.ndarray, "user stop"]


@dataclass(frozen=True, eq=False)
class _Drivers:
    """All users as arrays."""

    points: Float[np.ndarray, "user point 2"]  # [m] of the paths
    ways: Float[np.ndarray, "user point 2"]  # unit vectors from each point to the next
    wanted: Float[np.ndarray, "user point"]  # [m/s] there, slow enough for what comes
    near: Int[np.ndarray, "user cell"]  # which point of a path is near a cell, -1 for none
    corner: Float[np.ndarray, " 2"]
    columns: int
    length: Float[np.ndarray, " user"]
    width: Float[np.ndarray, " user"]
    speed: Float[np.ndarray, " user"]
    accel: Float[np.ndarray, " user"]
    decel: Float[np.ndarray, " user"]
    tau: Float[np.ndarray, " user"]
    min_gap: Float[np.ndarray, " user"]
    sigma: Float[np.ndarray, " user"]
    stop: Float[np.ndarray, "user stop"]  # [m] ahead of the front at first, where it has to wait ...
    shut: Float[np.ndarray, "2 user stop"]  # ... from when until when [s]
    ends: Float[np.ndarray, " user"]  # [m] likewise, where the route ends

    @classmethod
    def of(cls, traffic: TrafficState) -> "_Drivers":
        """Those of the traffic."""
        users = traffic.users
        most = max(len(user.path.points) for user in users)
        points = np.stack([_prolonged(user.path.points, most) for user in users])
        limit = np.stack([np.pad(u.path.limit, (0, most - len(u.path.limit)), "edge") for u in users])
        follows = {name: np.array([getattr(u.following, name) for u in users]) for name in vars(users[0].following)}
        allowed = np.minimum(limit * follows["speed_factor"][:, None], follows["max_speed_m_s"][:, None])
        wanted = _in_time(np.maximum(allowed, 0.1), follows["decel"])
        near, corner, columns = _grid(points)
        decel, speed = follows["decel"], traffic.values("speed")
        stop, shut = _stops([user.path.stops for user in users])
        return cls(
            points=points,
            ways=_ways(points),
            wanted=wanted,
            near=near,
            corner=corner,
            columns=columns,
            length=np.array([user.agent.length for user in users]),
            width=np.array([user.agent.width for user in users]),
            speed=speed,
            accel=follows["accel"],
            decel=decel,
            tau=follows["tau_s"],
            min_gap=follows["min_gap_m"],
            sigma=follows["sigma"],
            stop=stop,
            shut=shut,
            ends=np.array([user.path.ends_m for user in users]),
        )

    def begin(self) -> _Driven:
        """Where they are."""
        return _Driven(np.zeros_like(self.speed), self.speed, np.zeros(self.stop.shape, bool))

    def advance(self, driven: _Driven, time_s: float, dt: float) -> _Driven:
        """The same a step later. Who can no longer stop where a line is shut drives on."""
        along, speed, _ = driven
        gap, lead = self._leaders(along, speed)
        left = self.stop - along[:, None]
        shuts = (self.shut[0] <= time_s) & (self.shut[0] > time_s - dt)
        passes = driven.passes | (shuts & (left < (speed**2 / (2.0 * self.decel))[:, None] - 1.0))
        closed = (self.shut[0] <= time_s) & (time_s < self.shut[1]) & ~passes & (left > -1.0)
        waits = np.where(closed, left, _FAR_M).min(axis=1, initial=_FAR_M) + self.min_gap
        lead = np.where(waits <= gap, 0.0, lead)
        gap = np.minimum(gap, waits)
        wanted = self.wanted[np.arange(len(along)), self._index(along)]
        accel = np.where(
            self.sigma < 0.0, self._idm(speed, gap, lead, wanted), self._krauss(speed, gap, lead, wanted, dt)
        )
        after = np.maximum(speed + np.maximum(accel, -_HARDEST_BRAKE) * dt, 0.0)
        return _Driven(along + 0.5 * (speed + after) * dt, after, passes)

    def _krauss(
        self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray, wanted: np.ndarray, dt: float
    ) -> np.ndarray:
        """Accelerations [m/s^2] to the speed from which one can still stop behind the leader."""
        brakes = self.decel * self.tau
        room = 2.0 * self.decel * np.maximum(gap - self.min_gap, 0.0) + lead**2
        safe = np.sqrt(brakes**2 + room) - brakes
        gained = self.accel * (1.0 - 0.5 * np.maximum(self.sigma, 0.0))
        return np.minimum(gained, (np.minimum(safe, wanted) - speed) / dt)

    def _idm(self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        closing = speed * (speed - lead) / (2.0 * np.sqrt(self.accel * self.decel))
        apart = self.min_gap + np.maximum(speed * self.tau + closing, 0.0)
        free = np.maximum(1.0 - (speed / wanted) ** 4, -self.decel / self.accel)
        return self.accel * (free - (apart / np.maximum(gap, _LEAST_GAP_M)) ** 2)

    def tracks(self, along: np.ndarray, speed: np.ndarray, traffic: TrafficState) -> Tracks:
        """The tracks of users that are so far along [user time], with those speeds."""
        front, rear = self._at(along), self._at(along - self.length[:, None])
        ahead = front - rear
        yaw = np.arctan2(ahead[..., 1], ahead[..., 0])
        centre = front - 0.5 * self.length[:, None, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        # From exactly where they are: a body is no chord of its path at first.
        lasting = np.clip(1.0 - along / (self.length[:, None] + 1.0), 0.0, 1.0)
        x = centre[..., 0] + lasting * (traffic.values("x") - centre[:, 0, 0])[:, None]
        y = centre[..., 1] + lasting * (traffic.values("y") - centre[:, 0, 1])[:, None]
        turned = np.asarray(wrap(traffic.values("yaw") - yaw[:, 0]))
        yaw = np.unwrap(yaw + lasting * turned[:, None], axis=1)
        valid = along <= self.ends[:, None]
        valid[0] = True
        z = np.repeat(traffic.values("z")[:, None], along.shape[1], axis=1)
        x, y, yaw, speed, z = (np.where(valid, values, 0.0) for values in (x, y, yaw, speed, z))
        return Tracks(x, y, yaw, speed, valid, z=z)

    def _leaders(self, along: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The gap to the nearest body on each path [m], and how fast that goes along it [m/s]."""
        back = np.stack([np.zeros_like(along), 0.5 * self.length, self.length], axis=1)
        body = self._at(along[:, None] - back)  # [other part 2]
        cell = np.rint((body - self.corner) / _CELL_M).astype(int)
        rows = self.near.shape[1] // self.columns
        inside = ((cell >= 0) & (cell < (self.columns, rows))).all(axis=-1)
        flat = np.where(inside, cell[..., 1] * self.columns + cell[..., 0], 0)
        index = np.where(inside, self.near[:, flat], -1)  # [user other part]
        near = user, other, part = np.nonzero(index >= 0)
        known = index[near]
        away, way = body[other, part] - self.points[user, known], self.ways[user, known]
        gap = known * SPACING_M - BEHIND_M + (away * way).sum(axis=-1) - along[user]
        across = away[:, 1] * way[:, 0] - away[:, 0] * way[:, 1]
        beside = 0.5 * (self.width[user] + self.width[other]) + _BESIDE_M
        ahead = (np.abs(across) < beside) & (gap > -0.5 * self.length[user]) & (user != other)
        gaps = np.full(index.shape, _FAR_M)
        gaps[near] = np.where(ahead, gap, _FAR_M)
        mine = np.arange(len(along))
        other, part = np.divmod(gaps.reshape(len(along), -1).argmin(axis=1), index.shape[2])
        nearest = gaps[mine, other, part]
        heading = body[:, 0] - body[:, 2]
        heading /= np.maximum(np.hypot(*heading.T), 1e-6)[:, None]
        way = self.ways[mine, np.maximum(index[mine, other, part], 0)]
        lead = speed[other] * (heading[other] * way).sum(axis=-1)
        return nearest, np.where(nearest < _FAR_M, np.maximum(lead, 0.0), speed)

    def _index(self, along: np.ndarray) -> Int[np.ndarray, " user"]:
        return np.clip((along / SPACING_M + BEHIND_M).astype(int), 0, self.points.shape[1] - 1)

    def _at(self, along: np.ndarray) -> Float[np.ndarray, "user *axes 2"]:
        """Places on the paths, so far ahead of the fronts at first [m]."""
        at = np.clip(along / SPACING_M + BEHIND_M, 0.0, self.points.shape[1] - 1.001)
        index = at.astype(int)
        part = (at - index)[..., None]
        user = np.arange(len(along)).reshape(-1, *(1,) * (along.ndim - 1))
        return self.points[user, index] * (1.0 - part) + self.points[user, index + 1] * part


def _prolonged(points: Float[np.ndarray, "point 2"], most: int) -> Float[np.ndarray, "most 2"]:
    ahead = points[-1] - points[-2]
    return np.concatenate([points, points[-1] + np.arange(1, most - len(points) + 1)[:, None] * ahead])


def _ways(points: Float[np.ndarray, "user point 2"]) -> Float[np.ndarray, "user point 2"]:
    ahead = np.diff(points, axis=1, append=points[:, -1:])
    return ahead / np.maximum(np.hypot(ahead[..., 0], ahead[..., 1]), 1e-6)[..., None]


def _in_time(allowed: Float[np.ndarray, "user point"], decel: Float[np.ndarray, " user"]) -> np.ndarray:
    """Slow enough everywhere for what is allowed further on."""
    gained = 2.0 * decel[:, None] * SPACING_M * np.arange(allowed.shape[1])
    square = allowed**2 + gained
    return np.sqrt(np.minimum.accumulate(square[:, ::-1], axis=1)[:, ::-1] - gained)


def _stops(
    of_users: Sequence[Sequence[Stop]],
) -> tuple[Float[np.ndarray, "user stop"], Float[np.ndarray, "2 user stop"]]:
    """Where users have to wait [m], and from when until when [s]; never where one has fewer than another."""
    rows = [[(stop.at_m, *span) for stop in stops for span in stop.shut_s] for stops in of_users]
    room = max((len(row) for row in rows), default=0)
    filled = [row + [(_FAR_M, np.inf, np.inf)] * (room - len(row)) for row in rows]
    at, since, until = np.array(filled).reshape(len(rows), room, 3).transpose(2, 0, 1)
    return at, np.stack([since, until])


def _grid(points: Float[np.ndarray, "user point 2"]) -> tuple[Int[np.ndarray, "user cell"], np.ndarray, int]:
    """For every user the cells around its path with a point of it, the grid's corner [m], and its columns."""
    corner = points.min(axis=(0, 1)) - 2.0 * _CELL_M
    columns, rows = np.ceil((points.max(axis=(0, 1)) - corner) / _CELL_M).astype(int) + 3
    near = np.full((len(points), rows * columns), -1, np.int32)
    cell = np.rint((points - corner) / _CELL_M).astype(int)
    user, number = np.arange(len(points))[:, None], np.arange(points.shape[1])
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            near[user, (cell[..., 1] + down) * columns + cell[..., 0] + right] = number
    return near, corner, int(columns)
