"""A stand-in for a planner that is dear to ask: the ego as it drove in the planner's own last drives near a state.

It stands in to rank samples, so that the planner drives only the best of them. Its control is a mean over the steps of
past drives, weighted by how near they are: in time, in the ego's place and speed, and in where the adversary is and how
it moves. A step of a past drive whose state comes up again gets the control that it had. Curvatures are corrected for
the distance and the angle to the way of that step, or else small errors would add up.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.frames import along_and_left
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.lookup import rows_of
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.planners.jax_planner import JaxPlanner

KEPT = 12  # drives: the first one, which is unattacked, and the last ones
_STEPS = 32  # of each drive, around the present one
_TIME_S = 1.0  # differences that count as much as each other
_EGO_M = 2.0
_SPEED_M_S = 1.0
_OTHER_M, _OTHER_SHARE = 1.0, 0.1  # of where the adversary is from the ego, and more with its distance
_ABSENT = 25.0  # where the adversary is there in one of the two states alone
_SAME = 1e-3  # states as near as this are the same
_LOOK_AHEAD_S, _LEAST_LOOK_AHEAD_M = 0.8, 4.0  # within which the ego returns to its way


class PastDrive(NamedTuple):
    """A drive of the planner: the ego, and the road user that was the adversary."""

    ego: Motion  # [time]
    controls: ControlArrays  # [step]
    adversary: Motion  # [time]


class _Rows(NamedTuple):
    """Steps of past drives as arrays of one shape: the ego, where and how the adversary moves, and the control."""

    at: Float[Array, " row"]  # [s]
    x: Float[Array, " row"]  # [m] the ego
    y: Float[Array, " row"]  # [m]
    yaw: Float[Array, " row"]  # [rad]
    cos: Float[Array, " row"]
    sin: Float[Array, " row"]
    speed: Float[Array, " row"]  # [m/s]
    accel: Float[Array, " row"]  # [m/s^2]
    curvature: Float[Array, " row"]  # [1/m]
    away_x: Float[Array, " row"]  # [m] from the ego to the adversary
    away_y: Float[Array, " row"]  # [m]
    east: Float[Array, " row"]  # [m/s] velocity of the adversary
    north: Float[Array, " row"]  # [m/s]
    there: Float[Array, " row"]  # 1 where the adversary is present, else 0
    known: Float[Array, " row"]  # 1 where the row holds a step, else 0


class DrivenSteps(eqx.Module):
    """The steps of past drives, and the next step of the present one."""

    rows: Float[Array, "field row"]  # `_Rows`, ordered by step
    who: Int[Array, ""]  # the adversary among the others
    dt: Float[Array, ""]  # [s]
    now: Int[Array, ""]

    @property
    def lately(self) -> _Rows:
        """The rows of the steps around the next one."""
        size = _STEPS * KEPT
        first = jnp.clip((self.now - _STEPS // 2) * KEPT, 0, max(self.rows.shape[1] - size, 0))
        return _Rows(*jax.lax.dynamic_slice_in_dim(self.rows, first, min(size, self.rows.shape[1]), axis=1))


def driven_steps(
    drives: Sequence[PastDrive], who: int, present: Bool[np.ndarray, " time"], dt: Float[Array, ""]
) -> DrivenSteps:
    """The steps of at most `KEPT` drives, with `who` the adversary's index among all agents."""
    steps = len(present) - 1
    kept = [drives[0], *drives[1:][-(KEPT - 1) :]]
    filled = [*kept, *[kept[0]] * (KEPT - len(kept))]
    at, there = np.arange(steps) * float(dt), present[:steps]
    fields = np.stack([np.stack(_fields(one, at, there)) for one in filled], axis=-1)  # [field step drive]
    known = np.broadcast_to(np.arange(KEPT) < len(kept), fields.shape[1:])[None]
    return DrivenSteps(
        rows=on_device(np.concatenate([fields, known]).reshape(len(fields) + 1, -1), np.float32),
        who=on_device(max(who - 1, 0), np.int32),
        dt=dt,
        now=on_device(0, np.int32),
    )


def _fields(
    drive: PastDrive, at: Float[np.ndarray, " step"], there: Bool[np.ndarray, " step"]
) -> list[Float[np.ndarray, " step"]]:
    """The fields of `_Rows` without the last."""
    ego, controls, adversary = jax.tree.map(lambda values: np.asarray(values)[: len(at)], drive)
    away = adversary.x - ego.x, adversary.y - ego.y
    velocity = adversary.speed * np.cos(adversary.yaw), adversary.speed * np.sin(adversary.yaw)
    state = ego.x, ego.y, ego.yaw, np.cos(ego.yaw), np.sin(ego.yaw), ego.speed
    return [at, *state, controls.accel, controls.curvature, *away, *velocity, there.astype(float)]


class AdversarySight(eqx.Module):
    """The adversary, [time] or at one instant."""

    motion: Motion
    there: Bool[Array, "*time"]


class EgoAsDriven(JaxPlanner):
    """The ego as it drove near the present state."""

    def look(self, memory: DrivenSteps, traffic: Traffic) -> AdversarySight:
        """The adversary alone."""
        return AdversarySight(*rows_of((traffic.motion, traffic.valid), memory.who))

    def step(self, memory: DrivenSteps, sight: AdversarySight, ego: Motion) -> tuple[ControlArrays, Any]:
        """The controls of the nearest steps, each with its way."""
        rows = memory.lately
        weight = rows.known / (_difference(rows, memory.now * memory.dt, sight, ego) + _SAME) ** 2
        accel, curvature, total = jnp.stack([rows.accel, _curvature(rows, ego), jnp.ones_like(weight)]) @ weight
        control = ControlArrays(accel / total, curvature / total)
        return control, eqx.tree_at(lambda m: m.now, memory, memory.now + 1)


def _difference(then: _Rows, now: Float[Array, ""], sight: AdversarySight, ego: Motion) -> Float[Array, " row"]:
    """How much the state of each row differs from the one `now` [s]: a sum of squares."""
    seen, there = sight.motion, sight.there
    away_x, away_y = seen.x - ego.x, seen.y - ego.y
    scale = _OTHER_M + _OTHER_SHARE * jnp.hypot(away_x, away_y)
    where = ((then.away_x - away_x) ** 2 + (then.away_y - away_y) ** 2) / scale**2
    moves = (then.east - seen.speed * jnp.cos(seen.yaw)) ** 2 + (then.north - seen.speed * jnp.sin(seen.yaw)) ** 2
    same = where + moves / _SPEED_M_S**2
    of_other = jnp.where(there, jnp.where(then.there > 0.0, same, _ABSENT), _ABSENT * then.there)
    place = ((then.x - ego.x) ** 2 + (then.y - ego.y) ** 2) / _EGO_M**2
    return of_other + place + ((then.at - now) / _TIME_S) ** 2 + ((then.speed - ego.speed) / _SPEED_M_S) ** 2


def _curvature(then: _Rows, ego: Motion) -> Float[Array, " row"]:
    """The curvature of each row's way, plus that which leads back to it."""
    along, left = along_and_left(ego.x - then.x, ego.y - then.y, then.cos, then.sin)
    off = left - 0.5 * then.curvature * along**2
    turned = ego.yaw - then.yaw - then.curvature * along
    ahead = jnp.maximum(_LOOK_AHEAD_S * ego.speed, _LEAST_LOOK_AHEAD_M)
    return then.curvature - 2.0 * off / ahead**2 - 2.0 * turned / ahead
