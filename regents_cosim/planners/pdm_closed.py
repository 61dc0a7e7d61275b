"""PDM-Closed: fifteen ways of driving on by IDM are simulated for 4 s and scored, and the best is driven.

The ways differ in their speed (20 to 100 % of the limit) and in their offset from the middle of the route. The others
are expected to keep their velocity. The score multiplies what must not be (a collision at fault, leaving the road) with
a mean of progress, time to collision and comfort. A collision that is expected within 2 s makes the planner brake.

Two parts of the original have no counterpart here: the mirror's ego has no actuators, so pure pursuit steers in place
of an LQR, and no way is checked for lanes in the opposite direction, which an offset of 1 m does not reach.

Source: Dauner, Hallgarten, Geiger and Chitta, Parting with Misconceptions about Learning-based Vehicle Motion Planning,
CoRL 2023, section 4 and the configuration that they published.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.geometry.frames import along_and_left
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, step
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.mirror.separation import Box, overlaps
from regents_cosim.planners.idm import IDM, IdmMemory, IdmSight, place_on_route, route_index
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner

_SPEEDS = (1.0, 0.8, 0.6, 0.4, 0.2)  # shares of the desired speed; of equal scores the first counts
_OFFSETS_M = (0.0, -1.0, 1.0)  # to the left of the route
_STEP_S, _STEPS = 0.1, 40
_EVERY = 2  # steps between two that are scored
_LEADS = (2, 4)  # scored steps that the ego's velocity is extended for its time to collision
_STANDS_M_S = 0.05  # slower, nothing is the ego's fault
_LEAST_PROGRESS_M = 0.1  # where no way gets further, all get far enough
_PROGRESS, _TIME_TO_COLLISION, _COMFORT = 5.0, 5.0, 2.0  # weights
_EMERGENCY_S, _EMERGENCY_BRAKE_M_S2 = 2.0, 4.05
# limits of comfort, as nuPlan has them
_ACCEL_M_S2 = (-4.05, 2.40)
_LATERAL_ACCEL_M_S2, _JERK_M_S3, _YAW_RATE_RAD_S = 4.89, 4.13, 0.95


class PdmMemory(eqx.Module):
    """The route, and where it can be followed at an offset."""

    idm: IdmMemory
    on_road: Bool[Array, "offset point"]  # whether both sides of the ego are on the road there


class Ways(eqx.Module):
    """The simulated ways of driving on, after each step."""

    motion: Motion  # [way, step]
    controls: ControlArrays  # [way, step]


class PdmClosed(JaxPlanner):
    """The planner PDM-Closed, which simulates and scores all ways at every step."""

    most_braking_m_s2: ClassVar[float] = _EMERGENCY_BRAKE_M_S2
    idm: IDM = IDM(time_headway=1.5, standstill_gap=1.0, max_accel=1.5, comfortable_brake=3.0, exponent=10.0)

    def init(self, scene: CompiledScene) -> PdmMemory:
        """The ego's route, and where there is room beside it."""
        memory = self.idm.init(scene)
        x, y, cos, sin = (np.asarray(v, float) for v in (memory.x, memory.y, memory.cos, memory.sin))
        half_width = float(memory.half_width)

        def room(offset: float) -> Bool[np.ndarray, " point"]:
            sides = offset + half_width * np.array([[-1.0], [1.0]])
            places = np.stack([x - sides * sin, y + sides * cos], axis=-1) + scene.origin
            return np.all(scene.scenario.road.contains(places), axis=0)

        # Where the route itself has no room by the map, the map says nothing about offsets either.
        on_road = np.stack([room(offset) | ~room(0.0) for offset in _OFFSETS_M])
        return PdmMemory(memory, jnp.asarray(on_road))

    def step(self, memory: PdmMemory, sight: Traffic, ego: Motion) -> tuple[ControlArrays, PdmMemory]:
        """The first controls of the best way, or hard braking."""
        expected = _expected(sight)
        ways = self._ways(memory.idm, expected, ego)
        hit, close = _conflicts(memory.idm, ways.motion, expected)
        on_road = _on_road(memory, ways.motion)
        allowed = ~hit.any(axis=-1) & on_road
        progress = _progress(memory.idm, ego, ways.motion, allowed)
        good = _PROGRESS * progress + _TIME_TO_COLLISION * ~close + _COMFORT * _comfortable(ways)
        best = jnp.argmax(jnp.where(allowed, good, -1.0))
        first = round(_EMERGENCY_S / (_STEP_S * _EVERY))
        accel = jnp.where(hit[best, :first].any(), -_EMERGENCY_BRAKE_M_S2, ways.controls.accel[best, 0])
        later = eqx.tree_at(lambda m: m.idm.now, memory, memory.idm.now + 1)
        return ControlArrays(accel, ways.controls.curvature[best, 0]), later

    def _ways(self, route: IdmMemory, expected: Traffic, ego: Motion) -> Ways:
        """IDM on the route at each offset and speed, offsets first."""

        def at_offset(offset: Array) -> Ways:
            beside = eqx.tree_at(
                lambda m: (m.x, m.y), route, (route.x - offset * route.sin, route.y + offset * route.cos)
            )
            ahead = jax.tree.map(lambda rows: rows[:_STEPS], self.idm.look(beside, expected))
            return jax.vmap(lambda share: self._way(beside, ahead, share, ego))(jnp.array(_SPEEDS))

        found = jax.vmap(at_offset)(jnp.array(_OFFSETS_M))
        return jax.tree.map(lambda values: values.reshape(-1, _STEPS), found)

    def _way(self, route: IdmMemory, ahead: IdmSight, share: Array, ego: Motion) -> Ways:
        slower = eqx.tree_at(lambda m: m.speed, route, share * route.speed)

        def go_on(now: Motion, row: IdmSight) -> tuple[Motion, Ways]:
            controls = clip(self.idm.step(slower, row, now)[0])  # the lights stay as they are
            after = step(now, controls, _STEP_S)
            return after, Ways(after, controls)

        return jax.lax.scan(go_on, ego, ahead)[1]


def _expected(traffic: Traffic) -> Traffic:
    """The others [agent, time] now and at each later step, at constant velocity."""
    passed_s = _STEP_S * jnp.arange(_STEPS + _EVERY * max(_LEADS) + 1)
    x, y, yaw, speed, valid, z = jax.tree.map(
        lambda values: jnp.broadcast_to(values[:, None], (len(values), len(passed_s))),
        (*jax.tree.leaves(traffic.motion), traffic.valid, traffic.z),
    )
    way = speed * passed_s
    moved = Motion(x + way * jnp.cos(yaw), y + way * jnp.sin(yaw), yaw, speed)
    return Traffic(moved, valid, traffic.half_length, traffic.half_width, z)


def _conflicts(
    route: IdmMemory, motion: Motion, expected: Traffic
) -> tuple[Bool[Array, "way scored"], Bool[Array, " way"]]:
    """Whether the ego collides by its own fault at each scored step, and whether it ever comes close to that."""
    scored = jax.tree.map(lambda values: values[:, _EVERY - 1 :: _EVERY], motion)
    count = scored.x.shape[1]

    def meets(lead: int) -> Bool[Array, "way scored"]:
        on = scored.speed * lead * _EVERY * _STEP_S
        own = Box(
            (scored.x + on * jnp.cos(scored.yaw))[..., None], (scored.y + on * jnp.sin(scored.yaw))[..., None],
            jnp.cos(scored.yaw)[..., None], jnp.sin(scored.yaw)[..., None], route.half_length, route.half_width,
        )  # fmt: skip
        begin = _EVERY * (1 + lead)
        other = jax.tree.map(lambda values: values[:, begin::_EVERY][:, :count].T, expected.motion)
        box = Box(other.x, other.y, jnp.cos(other.yaw), jnp.sin(other.yaw), expected.half_length, expected.half_width)
        ahead = along_and_left(box.x - own.x, box.y - own.y, own.cos, own.sin)[0] > -route.half_length
        return (overlaps(own, box) & ahead & expected.valid[:, 0]).any(axis=-1) & (scored.speed > _STANDS_M_S)

    close = jnp.stack([meets(lead) for lead in _LEADS]).any(axis=(0, 2))
    return meets(0), close


def _on_road(memory: PdmMemory, motion: Motion) -> Bool[Array, " way"]:
    """Whether each way stays on the road."""
    index = route_index(memory.idm, motion.x, motion.y)
    offset = jnp.repeat(jnp.arange(len(_OFFSETS_M)), len(_SPEEDS))[:, None]
    return look_up(memory.on_road.ravel(), offset * memory.on_road.shape[1] + index).all(axis=-1)


def _progress(route: IdmMemory, ego: Motion, motion: Motion, allowed: Bool[Array, " way"]) -> Float[Array, " way"]:
    """The way along the route as a share of the furthest that is allowed, at most 1."""
    begin, _, _ = place_on_route(route, ego.x, ego.y)
    end, _, _ = place_on_route(route, motion.x[:, -1], motion.y[:, -1])
    most = jnp.where(allowed, end - begin, 0.0).max()
    share = jnp.clip((end - begin) / jnp.maximum(most, _LEAST_PROGRESS_M), 0.0, 1.0)
    return jnp.where(most > _LEAST_PROGRESS_M, share, 1.0)


def _comfortable(ways: Ways) -> Bool[Array, " way"]:
    """Whether a way keeps within all limits of comfort."""
    accel, turn = ways.controls.accel, ways.controls.curvature * ways.motion.speed
    within = (accel >= _ACCEL_M_S2[0]) & (accel <= _ACCEL_M_S2[1]) & (jnp.abs(turn) <= _YAW_RATE_RAD_S)
    within &= jnp.abs(turn * ways.motion.speed) <= _LATERAL_ACCEL_M_S2
    jerk = jnp.diff(accel, axis=-1) / _STEP_S
    return within.all(axis=-1) & (jnp.abs(jerk) <= _JERK_M_S3).all(axis=-1)
