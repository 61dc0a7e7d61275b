"""The careful driver as a planner: IDM on the route until it sees a danger, then emergency braking.

It acts on dangers that come and go by the rule of `norms.careful`, step by step. It steers like IDM, and only brakes.
Swerves belong to the verdict (`verdicts.careful.careful_driver`), which decides about the drive of a planner that
has crashed, and about the adversary alone.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.lane_centres import LaneCentres, lane_centres
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.mirror.separation import Box
from regents_cosim.norms.careful import CAREFUL, careful_reaction_steps, seen_over_steps
from regents_cosim.norms.foresight import between_lanes, comes_over, further, place_of
from regents_cosim.norms.limits import steps_of
from regents_cosim.planners.careful.foresight import EGO_TIMES_S, ExpectedMotion, is_risk
from regents_cosim.planners.idm import IDM, IdmMemory, IdmSight, place_on_route, route_poses
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner
from regents_cosim.routes.ego_route import SPACING_M

_CALM_S = 1.0  # without a danger for this long the emergency is over


class Reaction(eqx.Module):
    """The state of a driver's reaction: how long dangers have lasted, and how far it has reacted."""

    danger: Int[Array, " agent"]  # steps for which each agent has been a danger without a break
    reacts: Int[Array, ""]  # steps since it decided to brake; 0 before
    calm: Int[Array, ""]  # steps since the last danger
    braking: Float[Array, ""]  # [m/s^2] reached by now

    @classmethod
    def none(cls, agents: int) -> "Reaction":
        """The state before anything has happened."""
        return cls(jnp.zeros(agents, int), jnp.int32(0), jnp.int32(0), jnp.float32(0.0))

    def next(self, risk: Bool[Array, " agent"], dt: Float[Array, ""]) -> "Reaction":
        """The state one step later, given who is a danger; without a danger the braking no longer grows."""
        lasting, dismissed, over = (
            steps_of(jnp, seconds, dt) for seconds in (CAREFUL.evaluation_s, CAREFUL.dismissal_s, _CALM_S)
        )
        delay = careful_reaction_steps(jnp, dt) - lasting
        some = risk.any()
        danger = jnp.where(risk, self.danger + 1, 0)
        calm = jnp.where(some, 0, self.calm + 1)
        begun = (danger > lasting).any() | (self.reacts > 0)
        reacts = jnp.where(begun & (calm < jnp.where(self.reacts > delay, over, dismissed)), self.reacts + 1, 0)
        most = jnp.where(some, jnp.float32(CAREFUL.most_braking_m_s2), self.braking)
        braking = jnp.where(reacts > delay, jnp.minimum(self.braking + CAREFUL.jerk_m_s3 * dt, most), 0.0)
        return Reaction(danger, reacts, calm, braking)


class SurroundingTraffic(eqx.Module):
    """The other agents, as IDM sees them and in full."""

    idm: IdmSight
    traffic: Traffic
    along: Float[Array, "*time agent"]  # [m] of their centres on the route
    across: Float[Array, "*time agent"]  # [m] to the left of it
    turn: Float[Array, "*time agent"]  # [rad] from the route's direction to theirs
    off_m: Float[Array, "*time agent"]  # [m] to the left of the nearest centre line in their direction
    line_m: Float[Array, "*time agent"]  # [m] to a line where they have to let the ego pass; 0: none


class CarefulMemory(eqx.Module):
    """The memory of the driver."""

    idm: IdmMemory
    lanes: LaneCentres
    dt: Float[Array, ""]  # [s]
    turned: Float[Array, "back agent"]  # [rad] the others' recent headings, the oldest first
    speeds: Float[Array, "back agent"]  # [m/s]
    there: Bool[Array, "back agent"]
    own: Float[Array, " back"]  # [m/s] the ego's speeds
    reaction: Reaction
    between: Bool[Array, " point"]  # where the route, every `SPACING_M`, changes from a lane to another


class CarefulDriver(JaxPlanner):
    """The competent and careful human driver of UN Regulation 157 (`norms.careful`)."""

    idm: IDM = IDM()

    def init(self, scene: CompiledScene) -> CarefulMemory:
        """The route, the lanes around, and an uneventful past."""
        back = int(seen_over_steps(np, scene.scenario.dt))
        agents = scene.world.valid.shape[0] - 1
        past = jnp.zeros((back, agents), jnp.float32)
        own = jnp.full(back, scene.world.start.speed[0])
        route, lanes = self.idm.init(scene), lane_centres(scene.scenario, scene.origin)
        between = between_lanes(jnp.abs(lanes.off_centre(route.x, route.y, jnp.arctan2(route.sin, route.cos))))
        return CarefulMemory(route, lanes, scene.world.dt, past, past, past > 0.0, own, Reaction.none(agents), between)

    def look(self, memory: CarefulMemory, traffic: Traffic) -> SurroundingTraffic:
        """Every agent's place along the route and in the lanes."""
        motion = traffic.motion
        along, across, yaw = place_on_route(memory.idm, motion.x, motion.y)
        place = motion.x, motion.y, motion.yaw
        off_m, line_m = memory.lanes.off_centre(*place), memory.lanes.to_yield_line(*place)
        places = (values.T for values in (along, across, motion.yaw - yaw, off_m, line_m))
        return SurroundingTraffic(self.idm.look(memory.idm, traffic), super().look(memory, traffic), *places)

    def step(
        self, memory: CarefulMemory, sight: SurroundingTraffic, ego: Motion
    ) -> tuple[ControlArrays, CarefulMemory]:
        """IDM's controls, or emergency braking once the driver has reacted."""
        nominal, idm = self.idm.step(memory.idm, sight.idm, ego)
        risk = sight.traffic.valid & _risks(memory, sight, ego)
        reaction = memory.reaction.next(risk, memory.dt)
        accel = jnp.where(reaction.braking > 0.0, jnp.minimum(nominal.accel, -reaction.braking), nominal.accel)
        past = {
            "turned": _pushed(memory.turned, sight.traffic.motion.yaw),
            "speeds": _pushed(memory.speeds, sight.traffic.motion.speed),
            "there": _pushed(memory.there, sight.traffic.valid),
            "own": _pushed(memory.own, ego.speed),
        }
        return ControlArrays(accel, nominal.curvature), CarefulMemory(
            idm, memory.lanes, memory.dt, **past, reaction=reaction, between=memory.between
        )


def _risks(memory: CarefulMemory, seen: SurroundingTraffic, ego: Motion) -> Bool[Array, " agent"]:
    """Which agents the driver expects to meet."""
    along, across, _ = place_on_route(memory.idm, ego.x, ego.y)
    before, sizes = (memory.turned[0], memory.speeds[0]), (seen.traffic.half_length, seen.traffic.half_width)
    passed_s = memory.turned.shape[0] * memory.dt
    courses = ExpectedMotion.since(before, seen.traffic.motion, memory.there[0], passed_s, sizes)
    place = place_of(
        jnp, seen.along - along, seen.across - across, seen.turn,
        courses.half_length, courses.half_width, (memory.idm.half_length, memory.idm.half_width),
    )  # fmt: skip
    at = jnp.arange(memory.between.shape[0]) * SPACING_M
    reach = along + further(jnp, ego.speed, jnp.float32(0.0), EGO_TIMES_S[-1])
    over = comes_over(memory.between, at, along, reach)
    return is_risk(_going_on(memory, ego, along, across), courses, place, seen.off_m, seen.line_m, over)


def _going_on(memory: CarefulMemory, ego: Motion, along: Array, across: Array) -> Box:
    """The predicted ego along its route with its present offset; once it brakes, as if it released the brakes."""
    lost = jnp.maximum(memory.own[0] - ego.speed, 0.0) / (memory.own.shape[0] * memory.dt)
    braking = jnp.where(memory.reaction.braking > 0.0, 0.0, lost)
    x, y, cos, sin = route_poses(memory.idm, along + further(jnp, ego.speed, braking, EGO_TIMES_S))
    idm = memory.idm
    return Box(x - across * sin, y + across * cos, cos, sin, idm.half_length, idm.half_width)


def _pushed(past: Array, now: Array) -> Array:
    return jnp.concatenate([past[1:], now[None].astype(past.dtype)])
