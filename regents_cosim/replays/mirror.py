"""Drives the ego again in the mirror, among each case's own background."""

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool

from regents_cosim.collisions import first_contact
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.rollout import EgoTrack, FixedEgo, drive, drive_among_reacting, with_ego
from regents_cosim.mirror.world import World, scene_origin, to_roadless_world, to_tracks
from regents_cosim.planners.closed_loop import ClosedLoop, drive_on_host
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.interface import Debug, DebugSteps
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, foreign, require_finite, start
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario import Scenario, Tracks, with_rows

_KEPT_S = 2.0  # how long before a crash it is kept what the planner thought


@dataclass(frozen=True, eq=False)
class MirrorRun:
    """The result of a drive."""

    tracks: Tracks
    act_seconds: list[float] = field(default_factory=list)  # per decision of a planner outside the mirror
    debug: DebugSteps = ()  # what it thought, up to 2 s before its crash


class MirrorController:
    """Lets one planner drive scenarios one after the other, callable from several threads. A context manager.

    `planner` is its name.
    """

    def __init__(self, planner: AnyPlanner, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError where the planner cannot be found."""
        given = PlannerUnderTest.of(planner)
        self.planner, self._loop = given.name, given.loop
        self._hosts = HostPool(given, act_timeout_s)

    def __enter__(self) -> "MirrorController":
        return self

    def __exit__(self, *error: object) -> None:
        self._hosts.__exit__(*error)

    @in_float32
    def drive(self, scenario: Scenario) -> MirrorRun:
        """The drive through `scenario` with its ego in closed loop. Raises DriveError."""
        world = to_roadless_world(scenario)
        if self._loop is not None:
            memory = start(self._loop, CompiledScene(scenario, world), self.planner)
            with foreign(self.planner, scenario.id):
                track = jax.block_until_ready(_drive(self._loop, memory, world))
            require_finite(track.controls, self.planner, scenario.id)
            return MirrorRun(_with_ego(scenario, world, track))
        with self._hosts.lend() as process:
            loop = ClosedLoop(scenario, world, world.log, None)
            debug = dict[int, Debug]()
            seconds = drive_on_host(process, [loop], debug)
        tracks = _with_ego(scenario, world, loop.track)
        return MirrorRun(tracks, seconds, _before_crash(scenario, tracks, debug))


def _before_crash(scenario: Scenario, tracks: Tracks, debug: dict[int, Debug]) -> DebugSteps:
    """What was thought in the last seconds before the ego's first contact; nothing without one."""
    contact = first_contact(scenario.agents, tracks) if debug else None
    if contact is None:
        return ()
    first = contact[1] - round(_KEPT_S / scenario.dt)
    return tuple((step, one) for step, one in sorted(debug.items()) if first <= step <= contact[1])


@compiled
def _drive(planner: JaxPlanner, memory: Any, world: World) -> EgoTrack:
    motion, controls, _ = drive(planner, memory, world, world.log)
    return EgoTrack(motion, controls)


def _with_ego(scenario: Scenario, world: World, ego: EgoTrack) -> Tracks:
    controls = jax.tree.map(lambda all_, own: all_.at[0].set(own), world.controls, ego.controls)
    driven = to_tracks(with_ego(world.log, ego.motion), controls, scenario)
    return with_rows(scenario.tracks, driven, np.arange(len(scenario.agents)) == 0)


@in_float32
def among_reacting(case: Scenario, reacting: Bool[np.ndarray, " agent"]) -> Tracks:
    """The tracks of an attacked case, where the `reacting` agents brake for obstacles on the way of their log.

    The ego and all others keep to the tracks of the case; the ego is an obstacle where it has left its log.
    """
    assert case.log is not None
    tracks, is_ego = case.tracks, np.arange(len(case.agents)) == 0
    among = replace(case, tracks=with_rows(tracks, case.log, reacting | is_ego))
    world, (x, y) = to_roadless_world(among), scene_origin(among)
    mine = (tracks.x[0] - x, tracks.y[0] - y, np.unwrap(tracks.yaw[0]), tracks.speed[0])
    ego = Motion(*(on_device(values, np.float32) for values in mine))
    padded = np.pad(reacting, (0, len(world.vehicle) - len(reacting)))
    motion = _react(world.without_road(), ego, on_device(padded, np.bool_))
    return with_rows(tracks, to_tracks(motion, world.controls, among), reacting)


@compiled
def _react(world: World, ego: Motion, reacting: Bool[Array, " agent"]) -> Motion:
    track = EgoTrack(ego, jax.tree.map(lambda values: values[0], world.controls))
    return drive_among_reacting(FixedEgo(), track, world, world.log, reacting)[0]
