"""Interpolates between an attack and the log: deviations of agents, and intermediate controls."""

from dataclasses import replace
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.world import World, to_roadless_world, to_tracks
from regents_cosim.scenario import Scenario, Tracks, with_rows

Part = Literal["both", "accel", "curvature"]

CHANGED_M = 0.1  # the fit of a log is closer than this


def changed_agents(attacked: Scenario) -> tuple[str, ...]:
    """Agents other than the ego that are more than `CHANGED_M` from the log at some step."""
    now, log = attacked.tracks, attacked.recorded_tracks
    far = (np.hypot(now.x - log.x, now.y - log.y) > CHANGED_M) & now.valid & log.valid
    return tuple(
        agent.id for agent, is_far in zip(attacked.agents[1:], np.any(far[1:], axis=1).tolist(), strict=True) if is_far
    )


class AttackInterpolation:
    """Interpolates between an agent's attacked and logged controls, so that its vehicle can drive every result."""

    @in_float32
    def __init__(self, attacked: Scenario, agent: int) -> None:
        """`agent` is an index."""
        logged = attacked.recorded_tracks
        # With the ego at its place, so that both have the same origin on the device.
        among = replace(attacked, tracks=_with_row(logged, attacked.tracks, 0), log=logged)
        self._attacked, self._agent, self._logged = attacked, agent, to_roadless_world(among)
        self._world = to_roadless_world(attacked)

    @in_float32
    def at(self, share: float, part: Part) -> Scenario:
        """The case with that share of the attack left in the agent's controls, or in a `part` of them.

        Its first state is interpolated too, for a case that begins after the attack did.
        """
        shares = ControlArrays(
            *(jnp.float32(share if part in ("both", name) else 1.0) for name in ("accel", "curvature"))
        )
        motion, controls = _between(self._world, self._logged, shares)
        found = to_tracks(motion, controls, self._attacked)
        return replace(self._attacked, tracks=_with_row(self._attacked.tracks, found, self._agent))


@compiled
def _between(world: World, logged: World, shares: ControlArrays) -> tuple[Motion, ControlArrays]:
    attacked = world.mobility.controls_between(world.log, world.dt)
    controls = jax.tree.map(lambda log, own, share: log + share * (own - log), logged.controls, attacked, shares)
    most = jnp.maximum(shares.accel, shares.curvature)

    def first(log: Float[Array, " agent"], own: Float[Array, " agent"]) -> Float[Array, " agent"]:
        return log + most * (own - log)

    start = jax.tree.map(first, logged.start, world.start)
    return world.mobility.roll_out(start, controls, world.moving, world.dt), controls


def _with_row(tracks: Tracks, other: Tracks, agent: int) -> Tracks:
    """The `tracks` with one row of `other`."""
    return with_rows(tracks, other, np.arange(len(tracks.x)) == agent)
