"""Predicts the motion of all vehicles in the next seconds, which is the log that a live attack changes.

A predictor is any object with `predict(traffic, dt, steps) -> Tracks`. `CarFollowingPredictor` moves each vehicle along
its own route by car-following with its own parameters, and respects the lights.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along
from regents_cosim.live.predict.car_following import CarFollowing, stops_within
from regents_cosim.live.predict.giving_way import FAR_M, GivingWay
from regents_cosim.live.predict.leaders import Leaders, LinkLeaders
from regents_cosim.live.predict.paths import BEFORE_LINE_M, SPACING_M, Stop, path_of_drive
from regents_cosim.live.predict.traffic import RoadUser, TrafficState
from regents_cosim.scenario.scenario import Tracks

_STEPS_AT_ONCE = 2  # steps of the tracks per step of the drivers
_HARDEST_BRAKE = 8.0  # [m/s^2]
# A fast vehicle that keeps its speed although its model would accelerate is assumed to keep it. One reason is that in
# SUMO no vehicle may overtake on the right.
_FAST_M_S, _KEEPS_M_S2, _MODEL_MORE_M_S2 = 14.0, 0.6, 0.3


class Predictor(Protocol):
    """Predicts the motion of vehicles."""

    def predict(self, traffic: TrafficState, dt: float, steps: int) -> Tracks:
        """The tracks [user, time] of the traffic's users from now on, at `steps` instants `dt` [s] apart."""
        ...


class CarFollowingPredictor:
    """Moves each vehicle on its own route, by a car-following model (`car_following`) with its parameters in SUMO.

    A body on the path is a leader; red lights, and junctions where others have priority (`giving_way`), act as standing
    leaders. In the first step each keeps its recent acceleration.
    """

    def predict(self, traffic: TrafficState, dt: float, steps: int) -> Tracks:
        """The tracks [user, time] from now on, as `Predictor.predict`."""
        coarse = _STEPS_AT_ONCE * dt
        drivers = _Drivers.of(traffic, steps).as_seen(coarse)
        begun = drivers.begin()
        driven = [begun]
        while len(driven) * _STEPS_AT_ONCE < steps + _STEPS_AT_ONCE - 1:
            advanced = drivers.advance(driven[-1], (len(driven) - 1) * coarse, coarse)
            driven.append(drivers.as_known(driven[-1], advanced, len(driven) * _STEPS_AT_ONCE, coarse))
        along, speed = (np.stack(values, axis=1) for values in list(zip(*driven, strict=True))[:2])
        at, fine = np.arange(along.shape[1]) * coarse, np.arange(steps) * dt
        along, speed = (np.stack([np.interp(fine, at, row) for row in values]) for values in (along, speed))
        return drivers.tracks(along, speed, traffic)


class _Driven(NamedTuple):
    """The state of all users: distance driven [m], speed [m/s], and the stop lines that no longer apply."""

    along: Float[np.ndarray, " user"]
    speed: Float[np.ndarray, " user"]
    passes: Bool[np.ndarray, "user stop"]
    accel: Float[np.ndarray, " user"]  # [m/s^2]
    waits: Bool[np.ndarray, " user"]  # for others at a junction
    came_first: Bool[np.ndarray, " pair"]  # see `LinkLeaders`


@dataclass(frozen=True, eq=False)
class _Drivers:
    """All users as arrays."""

    leaders: Leaders
    wanted: Float[np.ndarray, "user point"]  # [m/s] wanted speed at each point, low enough for the points ahead
    speed: Float[np.ndarray, " user"]
    follows: CarFollowing
    stop: Float[np.ndarray, "user stop"]  # [m] from the front's initial position: places to wait
    shut: Float[np.ndarray, "2 user stop"]  # [s] begins and ends of the times to wait there
    seen: Float[np.ndarray, "user stop"]  # [m] within this distance the place no longer applies
    ends: Float[np.ndarray, " user"]  # [m] from the front's initial position to the end of the route
    giving_way: GivingWay
    link_leaders: LinkLeaders
    accel: Float[np.ndarray, " user"]  # [m/s^2] recent; infinite where unknown
    known: Float[np.ndarray, "user time"]  # [m] distance driven at each step by users with known drives, else NaN
    most: Float[np.ndarray, " user"]  # [m/s] highest speed for reasons that no model has

    @classmethod
    def of(cls, traffic: TrafficState, steps: int) -> "_Drivers":
        """The users of some traffic; known drives are needed for `steps` steps."""
        users = [_on_its_drive(user) for user in traffic.users]
        length, width = (np.array([getattr(user.agent, name) for user in users]) for name in ("length", "width"))
        leaders = Leaders.of([user.path.points for user in users], length, width)
        most = leaders.points.shape[1]
        limit = np.stack([np.pad(u.path.limit, (0, most - len(u.path.limit)), "edge") for u in users])
        follows = CarFollowing.of([user.following for user in users])
        factor, fastest = np.array([(u.following.speed_factor, u.following.max_speed_m_s) for u in users]).T[..., None]
        wanted = _in_time(np.maximum(np.minimum(limit * factor, fastest), 0.1), follows.eases)
        stop, shut, seen = _stops([user.path.stops for user in users])
        return cls(
            leaders=leaders,
            wanted=wanted,
            speed=traffic.values("speed"),
            follows=follows,
            stop=stop,
            shut=shut,
            seen=seen,
            ends=np.array([user.path.ends_m for user in users]),
            giving_way=GivingWay.of(traffic),
            link_leaders=LinkLeaders.of(traffic, users),
            accel=np.nan_to_num(traffic.values("accel"), nan=np.inf),
            known=np.stack([_along_drive(user, steps) for user in users]),
            most=np.full(len(users), np.inf),
        )

    def as_seen(self, dt: float) -> "_Drivers":
        """Limit users to their current speed where they keep it although their models would accelerate.

        `dt` [s] is the step.
        """
        begun = self.begin()
        by_model = self.follows.accelerations(
            self.speed, *self.leaders.ahead(begun.along, self.speed), self._wanted(begun.along), dt
        )
        keeps = (
            (self.speed > _FAST_M_S) & (np.abs(self.accel) < _KEEPS_M_S2) & (by_model > self.accel + _MODEL_MORE_M_S2)
        )
        return replace(self, most=np.where(keeps, self.speed, np.inf))

    def begin(self) -> _Driven:
        """The initial state."""
        none = np.zeros(len(self.speed), bool)
        passes = np.zeros(self.stop.shape, bool)
        return _Driven(np.zeros_like(self.speed), self.speed, passes, self.accel, none, self.link_leaders.came_first)

    def advance(self, driven: _Driven, time_s: float, dt: float) -> _Driven:
        """The state one step later. A user that can no longer stop at a closed line drives on."""
        along, speed = driven.along, driven.speed
        gap, lead = self.leaders.ahead(along, speed)
        left, brakes_m = self.stop - along[:, None], stops_within(speed, self.follows.decel)
        shuts = (self.shut[0] <= time_s) & (self.shut[0] > time_s - dt)
        passes = driven.passes | (shuts & (left + BEFORE_LINE_M < brakes_m[:, None]))
        ahead = ~passes & (left > np.maximum(self.seen, -BEFORE_LINE_M))
        closed = (self.shut[0] <= time_s) & (time_s < self.shut[1]) & ahead
        lets_m = self.giving_way.waits_m(along, speed, driven.waits)
        stop = np.where(closed, left, FAR_M).min(axis=1, initial=FAR_M)
        stop = np.minimum(stop, lets_m - BEFORE_LINE_M)
        stop = np.maximum(stop, np.minimum(stop + BEFORE_LINE_M, brakes_m))
        wanted = self._wanted(along)
        accel = self.follows.accelerations(speed, gap, lead, wanted, dt)
        accel = np.minimum(accel, self.follows.stopping(speed, stop, wanted, dt))
        accel = np.minimum(accel, driven.accel + self.follows.most_jerk * dt)
        came_first = self.link_leaders.first(along, driven.came_first)
        accel = np.minimum(accel, self._behind_link_leaders(driven, came_first, wanted, dt))
        if time_s == 0.0:  # the recent accelerations, where they are known, tell more than the models
            accel = np.where(np.isfinite(self.accel), np.minimum(self.accel, self.follows.accel), accel)
        after = np.maximum(speed + np.maximum(accel, -_HARDEST_BRAKE) * dt, 0.0)
        waits = (lets_m < FAR_M) | (closed & (self.seen < 0.0)).any(axis=1)
        return _Driven(along + 0.5 * (speed + after) * dt, after, passes, (after - speed) / dt, waits, came_first)

    def _behind_link_leaders(
        self,
        driven: _Driven,
        came_first: Bool[np.ndarray, " pair"],
        wanted: Float[np.ndarray, " user"],
        dt: float,
    ) -> Float[np.ndarray, " user"]:
        """The highest accelerations [m/s^2] at junctions with a known drive; infinite for all others.

        A user brakes to stop before that drive's path, or follows it as if both were on one line, whichever is less
        braking.
        """
        leaders, speed, free = self.link_leaders, driven.speed, np.full(len(driven.speed), np.inf)
        if not leaders.users.size:
            return free
        minds, to_way, behind = leaders.ahead(driven.along, came_first)
        (inside, comes), far = leaders.users[:, minds], np.full(len(speed), FAR_M)
        stop, gap, lead = far.copy(), far.copy(), speed.copy()
        stop[comes], gap[comes], lead[comes] = to_way[minds], behind[minds], speed[inside]
        stops = self.follows.stopping(speed, stop - self.follows.min_gap, wanted, dt, early=True)
        follows = self.follows.accelerations(speed, gap, lead, wanted, dt)
        free[comes] = np.where(gap > self.follows.min_gap, np.maximum(stops, follows), stops)[comes]
        return free

    def as_known(self, before: _Driven, after: _Driven, step: int, dt: float) -> _Driven:
        """The state `after` a step, where users with known drives are at the states of their drives."""
        there = self.known[:, min(step, self.known.shape[1] - 1)]
        told = ~np.isnan(there)
        speed = np.where(told, (there - before.along) / dt, after.speed)
        return after._replace(along=np.where(told, there, after.along), speed=speed)

    def _wanted(self, along: Float[np.ndarray, " user"]) -> Float[np.ndarray, " user"]:
        return np.minimum(self.wanted[np.arange(len(along)), self.leaders.index(along)], self.most)

    def tracks(self, along: np.ndarray, speed: np.ndarray, traffic: TrafficState) -> Tracks:
        """The tracks of users, given distances driven [user time] and speeds."""
        length = self.leaders.length[:, None]
        front, rear = self.leaders.at(along), self.leaders.at(along - length)
        yaw = np.angle(front - rear)
        centre = front - 0.5 * length * np.exp(1j * yaw)
        # From the exact initial poses, since bodies are not on their paths at first.
        lasting = np.clip(1.0 - along / (length + 1.0), 0.0, 1.0)
        x = centre.real + lasting * (traffic.values("x") - centre[:, 0].real)[:, None]
        y = centre.imag + lasting * (traffic.values("y") - centre[:, 0].imag)[:, None]
        turned = np.asarray(wrap(traffic.values("yaw") - yaw[:, 0]))
        yaw = np.unwrap(yaw + lasting * turned[:, None], axis=1)
        valid = along <= self.ends[:, None]
        valid[0] = True
        z = np.repeat(traffic.values("z")[:, None], along.shape[1], axis=1)
        x, y, yaw, speed, z = (np.where(valid, values, 0.0) for values in (x, y, yaw, speed, z))
        return Tracks(x, y, yaw, speed, valid, z=z)


def _on_its_drive(user: RoadUser) -> RoadUser:
    """The user on the path of its known drive, if there is one."""
    if user.drive is None:
        return user
    x, y, yaw, _ = user.drive
    path = path_of_drive(np.stack([x, y], axis=1), yaw, user.agent.length)
    return replace(user, path=replace(path, crossings=user.path.crossings))


def _along_drive(user: RoadUser, steps: int) -> Float[np.ndarray, " time"]:
    """The distance of its front at each step [m]; NaN where its drive is not known."""
    if user.drive is None:
        return np.full(steps, np.nan)
    x, y, yaw, _ = user.drive[:, :steps]
    half = 0.5 * user.agent.length
    along = distances_along(x + half * np.cos(yaw), y + half * np.sin(yaw))
    return np.pad(along, (0, steps - len(along)), "edge")


def _in_time(allowed: Float[np.ndarray, "user point"], decel: Float[np.ndarray, " user"]) -> np.ndarray:
    """Speeds that are low enough everywhere for the limits further on."""
    gained = 2.0 * decel[:, None] * SPACING_M * np.arange(allowed.shape[1])
    square = allowed**2 + gained
    return np.sqrt(np.minimum.accumulate(square[:, ::-1], axis=1)[:, ::-1] - gained)


def _stops(
    of_users: Sequence[Sequence[Stop]],
) -> tuple[Float[np.ndarray, "user stop"], Float[np.ndarray, "2 user stop"], Float[np.ndarray, "user stop"]]:
    """Places where users have to wait [m], begins and ends of these times [s], and distances from which they do not
    [m].

    Users with fewer places get some that never apply.
    """
    rows = [[(stop.at_m, *stop.shut_s, stop.seen_m) for stop in stops] for stops in of_users]
    room = max((len(row) for row in rows), default=0)
    filled = [row + [(FAR_M, np.inf, np.inf, 0.0)] * (room - len(row)) for row in rows]
    at, since, until, seen = np.array(filled).reshape(len(rows), room, 4).transpose(2, 0, 1)
    return at, np.stack([since, until]), seen
