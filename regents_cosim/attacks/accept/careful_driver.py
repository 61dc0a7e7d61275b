"""Decide on the device whether a careful driver would have avoided a collision that the search has made.

`regents_cosim.verdicts.careful.careful_driver` decides the same for a finished case on the host, whose verdict
counts. This version works in float32; the ego's path goes straight on at its end, and after the horizon the brakes act
in full at once.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.lines import way_at
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lane_centres import LaneCentres
from regents_cosim.mirror.lookup import interpolate, look_up, rows_of
from regents_cosim.mirror.separation import Box, overlaps
from regents_cosim.mirror.world import World
from regents_cosim.norms.careful import (
    CAREFUL,
    braked_speed,
    careful_perceives,
    careful_reaction_steps,
    seen_over_steps,
)
from regents_cosim.norms.clean import follows
from regents_cosim.norms.foresight import PlaceOnPath, between_lanes, comes_over, further, place_of
from regents_cosim.planners.careful.foresight import EGO_TIMES_S, ExpectedMotion, is_risk

_BEYOND_S = np.arange(0.2, 2.01, 0.2, dtype=np.float32)  # after the horizon


class _Path(eqx.Module):
    """The ego's own drive as positions by distance driven, straight on at its end."""

    driven: Float[Array, " time"]  # [m]
    x: Float[Array, " time"]
    y: Float[Array, " time"]
    yaw: Float[Array, " time"]
    z: Float[Array, " time"] | None

    def at(self, distance: Float[Array, "*axes"]) -> tuple[Array, Array, Array, Array | None]:
        """X, y [m], yaw [rad] and height [m] at distances [m]."""
        index = jnp.clip((distance[..., None] >= self.driven).sum(axis=-1) - 1, 0, self.driven.shape[0] - 2)
        begin, end = look_up(self.driven, index), look_up(self.driven, index + 1)
        part = jnp.clip((distance - begin) / jnp.maximum(end - begin, 1e-6), 0.0, 1.0)
        x, y, yaw = (interpolate(v, index, index + 1, part) for v in (self.x, self.y, self.yaw))
        z = None if self.z is None else look_up(self.z, index)
        beyond = jnp.maximum(distance - self.driven[-1], 0.0)
        return x + beyond * jnp.cos(yaw), y + beyond * jnp.sin(yaw), yaw, z


def careful_avoids(
    world: World, motion: Motion, boxes: Box, lanes: LaneCentres, adversary: Int[Array, ""], step: Int[Array, ""]
) -> Bool[Array, ""]:
    """Whether the careful driver avoids the ego's collision with `adversary` at `step` by braking alone.

    `motion` and `boxes` [agent time] are those of all agents, with the ego in row 0.
    """
    own = jax.tree.map(lambda values: values[0], motion)
    other = rows_of(motion, adversary)
    path = _Path(way_at(own.speed, world.dt, jnp), own.x, own.y, own.yaw, None if boxes.z is None else boxes.z[0])
    acts = _acts(world, path, own, other, boxes, lanes, adversary, step)
    speed = braked_speed(jnp, own.speed, acts, world.dt)
    distance = way_at(speed, world.dt, jnp)
    beyond = distance[-1] + further(jnp, speed[-1], jnp.float32(CAREFUL.most_braking_m_s2), _BEYOND_S)
    distance = jnp.concatenate([distance, beyond])
    x, y, yaw, z = path.at(distance)
    half = world.half_length[0], world.half_width[0]
    ego = Box(x[None], y[None], jnp.cos(yaw)[None], jnp.sin(yaw)[None], *half, None if z is None else z[None])
    within = jax.tree.map(lambda values: values[:, : len(speed)] if values.ndim else values, ego)
    met = _meets(world, within, boxes, adversary) | _meets_beyond(world, ego, other, boxes, adversary, len(speed))
    return (acts < step) & ~met


def _acts(
    world: World,
    path: _Path,
    own: Motion,
    other: Motion,
    boxes: Box,
    lanes: LaneCentres,
    adversary: Int[Array, ""],
    step: Int[Array, ""],
) -> Int[Array, ""]:
    """The step at which the driver begins to brake; `step` if it does not brake before."""
    ego, course = _ego_going_on(world, path, own), _course(world, other, boxes, adversary)
    risk = is_risk(
        ego,
        course,
        _place(world, path, other, course),
        lanes.off_centre(other.x, other.y, other.yaw),
        lanes.to_yield_line(other.x, other.y, other.yaw),
        _comes_over(world, path, own, lanes),
    )
    risk &= look_up(world.valid, adversary)
    perceives = careful_perceives(jnp, risk, world.dt, step)
    return jnp.minimum(perceives + careful_reaction_steps(jnp, world.dt), step)


def _since(world: World, steps: int) -> tuple[Int[Array, " time"], Float[Array, " time"]]:
    """For every step the step some tenths of a second before, and the time in between [s]."""
    now = jnp.arange(steps)
    since = jnp.maximum(now - seen_over_steps(jnp, world.dt), 0)
    return since, (now - since) * world.dt


def _braking(speed: Float[Array, " time"], since: Int[Array, " time"], passed: Float[Array, " time"]) -> Array:
    return jnp.maximum(look_up(speed, since) - speed, 0.0) / jnp.maximum(passed, 1e-3)


def _ego_going_on(world: World, path: _Path, own: Motion) -> Box:
    """The predicted ego [time ahead] along its path, from every step on."""
    since, passed = _since(world, own.x.shape[0])
    braking = _braking(own.speed, since, passed)
    way = further(jnp, own.speed[:, None], braking[:, None], EGO_TIMES_S)
    x, y, yaw, z = path.at(path.driven[:, None] + way)
    return Box(x, y, jnp.cos(yaw), jnp.sin(yaw), world.half_length[0], world.half_width[0], z)


def _comes_over(world: World, path: _Path, own: Motion, lanes: LaneCentres) -> Bool[Array, " time"]:
    """Whether the ego is about to leave the middle of its lane for another, at every step."""
    since, passed = _since(world, own.x.shape[0])
    way = further(jnp, own.speed, _braking(own.speed, since, passed), EGO_TIMES_S[-1])
    between = between_lanes(jnp.abs(lanes.off_centre(own.x, own.y, own.yaw)))
    return comes_over(between, path.driven, path.driven, path.driven + way)


def _course(world: World, other: Motion, boxes: Box, adversary: Int[Array, ""]) -> ExpectedMotion:
    valid = look_up(world.valid, adversary)
    since, passed = _since(world, other.x.shape[0])
    known = look_up(valid, since)
    before = look_up(other.yaw, since), look_up(other.speed, since)
    sizes = look_up(world.half_length, adversary)[None], look_up(world.half_width, adversary)[None]
    found = ExpectedMotion.since(before, other, known, jnp.maximum(passed, 1e-3), sizes)
    return found if boxes.z is None else replace(found, z=look_up(boxes.z, adversary))


def _place(world: World, path: _Path, other: Motion, course: ExpectedMotion) -> PlaceOnPath:
    """The adversary's place relative to the ego's path, at every step."""
    dx, dy = other.x[:, None] - path.x, other.y[:, None] - path.y
    nearest = jnp.argmin(dx**2 + dy**2, axis=-1)
    x, y, yaw, driven = (look_up(values, nearest) for values in (path.x, path.y, path.yaw, path.driven))
    dx, dy = other.x - x, other.y - y
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    ahead_m = driven + dx * cos + dy * sin - path.driven
    half = course.half_length, course.half_width
    ego_half = world.half_length[0], world.half_width[0]
    return place_of(jnp, ahead_m, dy * cos - dx * sin, other.yaw - yaw, *half, ego_half)


def _meets(world: World, ego: Box, boxes: Box, adversary: Int[Array, ""]) -> Bool[Array, ""]:
    """Whether it overlaps another agent; those that first touch it from behind do not count, but the adversary does."""
    touches = world.valid & world.apart[0][:, None] & overlaps(ego, boxes)
    first = touches & jnp.equal(jnp.cumsum(touches, axis=1), 1)
    ahead = (boxes.x - ego.x) * ego.cos + (boxes.y - ego.y) * ego.sin
    behind = first & follows(ego.cos * boxes.cos + ego.sin * boxes.sin, ahead)
    harmless = behind.any(axis=1) & (jnp.arange(touches.shape[0]) != adversary)
    return (touches.any(axis=1) & ~harmless).any()


def _meets_beyond(
    world: World, ego: Box, other: Motion, boxes: Box, adversary: Int[Array, ""], steps: int
) -> Bool[Array, ""]:
    """Whether it meets the adversary after the horizon, where the adversary goes straight on."""
    later = jax.tree.map(lambda values: values[0, steps:] if values.ndim else values, ego)
    cos, sin, way = jnp.cos(other.yaw[-1]), jnp.sin(other.yaw[-1]), other.speed[-1] * _BEYOND_S
    half = look_up(world.half_length, adversary), look_up(world.half_width, adversary)
    z = None if boxes.z is None else look_up(boxes.z, adversary)[-1]
    theirs = Box(other.x[-1] + way * cos, other.y[-1] + way * sin, cos, sin, *half, z)
    return look_up(world.valid, adversary)[-1] & overlaps(later, theirs).any()
