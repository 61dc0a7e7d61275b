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

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.planners.jax_planner import JaxPlanner

KEPT = 12  # drives: the first one, which is unattacked, and the last ones
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


class DrivenSteps(eqx.Module):
    """The steps of past drives, and the next step of the present one."""

    ego: Motion  # [row]
    controls: ControlArrays  # [row]
    adversary: Motion  # [row]
    there: Bool[Array, " row"]  # whether the adversary is present
    at: Float[Array, " row"]  # [s]
    known: Bool[Array, " row"]  # whether the row holds a step
    who: Int[Array, ""]  # the adversary among the others
    dt: Float[Array, ""]  # [s]
    now: Int[Array, ""]


def driven_steps(
    drives: Sequence[PastDrive], who: int, present: Bool[np.ndarray, " time"], dt: Float[Array, ""]
) -> DrivenSteps:
    """The steps of at most `KEPT` drives, with `who` the adversary's index among all agents."""
    steps = len(present) - 1
    kept = [drives[0], *drives[1:][-(KEPT - 1) :]]
    filled = [*kept, *[kept[0]] * (KEPT - len(kept))]

    def rows(*each: Any) -> Array:
        return on_device(np.concatenate([np.asarray(values)[:steps] for values in each]), np.float32)

    ego, controls, adversary = jax.tree.map(rows, *filled)
    return DrivenSteps(
        ego=ego,
        controls=controls,
        adversary=adversary,
        there=on_device(np.tile(present[:steps], KEPT), np.bool_),
        at=on_device(np.tile(np.arange(steps) * float(dt), KEPT), np.float32),
        known=on_device(np.repeat(np.arange(KEPT) < len(kept), steps), np.bool_),
        who=on_device(max(who - 1, 0), np.int32),
        dt=dt,
        now=on_device(0, np.int32),
    )


class AdversarySight(eqx.Module):
    """The adversary, [time] or at one instant."""

    motion: Motion
    there: Bool[Array, "*time"]


class EgoAsDriven(JaxPlanner):
    """The ego as it drove near the present state."""

    def look(self, memory: DrivenSteps, traffic: Traffic) -> AdversarySight:
        """The adversary alone."""
        return AdversarySight(*jax.tree.map(lambda v: look_up(v, memory.who), (traffic.motion, traffic.valid)))

    def step(self, memory: DrivenSteps, sight: AdversarySight, ego: Motion) -> tuple[ControlArrays, Any]:
        """The controls of the nearest steps, each with its way."""
        weight = 1.0 / (_difference(memory, sight, ego) + _SAME) ** 2 * memory.known
        weight /= weight.sum()
        control = ControlArrays((weight * memory.controls.accel).sum(), (weight * _curvature(memory, ego)).sum())
        return control, eqx.tree_at(lambda m: m.now, memory, memory.now + 1)


def _difference(memory: DrivenSteps, sight: AdversarySight, ego: Motion) -> Float[Array, " row"]:
    """How much the state of each row differs from the present one: a sum of squares."""
    then, other, seen = memory.ego, memory.adversary, sight.motion
    away_x, away_y = seen.x - ego.x, seen.y - ego.y
    scale = _OTHER_M + _OTHER_SHARE * jnp.hypot(away_x, away_y)
    where = ((other.x - then.x - away_x) ** 2 + (other.y - then.y - away_y) ** 2) / scale**2
    moves = (other.speed * jnp.cos(other.yaw) - seen.speed * jnp.cos(seen.yaw)) ** 2
    moves += (other.speed * jnp.sin(other.yaw) - seen.speed * jnp.sin(seen.yaw)) ** 2
    both = memory.there & sight.there
    of_other = jnp.where(both, where + moves / _SPEED_M_S**2, _ABSENT * (memory.there != sight.there))
    place = ((then.x - ego.x) ** 2 + (then.y - ego.y) ** 2) / _EGO_M**2
    time = ((memory.at - memory.now * memory.dt) / _TIME_S) ** 2
    return of_other + place + time + ((then.speed - ego.speed) / _SPEED_M_S) ** 2


def _curvature(memory: DrivenSteps, ego: Motion) -> Float[Array, " row"]:
    """The curvature of each row's way, plus that which leads back to it."""
    then, bend = memory.ego, memory.controls.curvature
    cos, sin = jnp.cos(then.yaw), jnp.sin(then.yaw)
    east, north = ego.x - then.x, ego.y - then.y
    along, left = east * cos + north * sin, north * cos - east * sin
    off = left - 0.5 * bend * along**2
    turned = ego.yaw - then.yaw - bend * along
    ahead = jnp.maximum(_LOOK_AHEAD_S * ego.speed, _LEAST_LOOK_AHEAD_M)
    return bend - 2.0 * off / ahead**2 - 2.0 * turned / ahead
