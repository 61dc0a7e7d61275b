"""Drives the ego again in the mirror, among each case's own background.

The other vehicles drive as in the case until the ego is elsewhere than there; then they react to it and to each other,
as in an attack. So no follower drives blindly into a planner that brakes where the case did not.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.reacting_traffic import padded_to, those_who_react
from regents_cosim.mirror.rollout import drive_among_reacting
from regents_cosim.mirror.world import World, to_roadless_world, to_tracks
from regents_cosim.planners.closed_loop import ClosedLoop, drive_on_host
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.interface import Debug, DebugSteps
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, foreign, require_finite, start
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.verify import before_crash
from regents_cosim.scenario.scenario import Scenario, Tracks, with_rows

_ROUNDED_M = 0.01  # an agent that stays this near to the case has kept to it


@dataclass(frozen=True, eq=False)
class MirrorRun:
    """The result of a drive."""

    tracks: Tracks
    reacted: tuple[int, ...] = ()  # agents, by index, that have left their tracks
    act_seconds: list[float] = field(default_factory=list)  # per decision of a planner outside the mirror
    debug: DebugSteps = ()  # what it thought, up to 2 s before its crash


class MirrorController(HostPool):
    """Lets one planner drive scenarios one after the other, callable from several threads. A context manager."""

    def __init__(self, planner: AnyPlanner, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError where the planner cannot be found."""
        super().__init__(PlannerUnderTest.of(planner), act_timeout_s)

    @in_float32
    def drive(self, scenario: Scenario) -> MirrorRun:
        """The drive through `scenario` with its ego in closed loop. Raises DriveError."""
        world = to_roadless_world(scenario).for_reactions(scenario)
        who = those_who_react(scenario)
        reacting = padded_to(world, who)
        name, planner = self.planner.name, self.planner.loop
        if planner is not None:
            memory = start(planner, CompiledScene(scenario, world), name)
            with foreign(name, scenario.id):
                motion, controls = jax.block_until_ready(_drive(planner, memory, world, reacting))
            require_finite(controls, name, scenario.id)
            return MirrorRun(*_moved(scenario, world, motion, controls, who))
        with self.lend() as process:
            loop = ClosedLoop(scenario, world, world.log, reacting)
            debug = dict[int, Debug]()
            seconds = drive_on_host(process, [loop], debug)
        tracks, reacted = _moved(scenario, world, loop.motion, loop.controls, who)
        return MirrorRun(tracks, reacted, seconds, before_crash(scenario, tracks, debug))


@compiled
def _drive(
    planner: JaxPlanner, memory: Any, world: World, reacting: Bool[Array, " padded"]
) -> tuple[Motion, ControlArrays]:
    return drive_among_reacting(planner, memory, world, world.log, reacting)[:2]


def _moved(
    scenario: Scenario, world: World, motion: Motion, ego: ControlArrays, reacting: Bool[np.ndarray, " agent"]
) -> tuple[Tracks, tuple[int, ...]]:
    """The tracks after a drive with the ego's controls, and the agents that have left their own.

    All others have the very tracks of the case.
    """
    controls = jax.tree.map(lambda all_, own: all_.at[0].set(own), world.controls, ego)
    driven = to_tracks(motion, controls, scenario)
    away = np.hypot(driven.x - scenario.tracks.x, driven.y - scenario.tracks.y)
    left = reacting & (np.where(scenario.tracks.valid, away, 0.0) > _ROUNDED_M).any(axis=1)
    moved = with_rows(scenario.tracks, driven, left | (np.arange(len(scenario.agents)) == 0))
    return moved, tuple(np.flatnonzero(left).tolist())
