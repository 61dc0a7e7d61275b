"""The mirror step by step, for planners outside it: all agents move as in `rollout`, the ego as its planner decides."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.reactions.react import react
from regents_cosim.mirror.reactions.state import BackgroundInstant, Reacting, begin
from regents_cosim.mirror.rollout import EgoTrack, move_ego, poses_now
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Control, Debug, Placement, Scene, Snapshot
from regents_cosim.scenario.attack_record import Dynamics
from regents_cosim.scenario.scenario import Scenario

State = Float[np.ndarray, " 4"]  # x, y [m], yaw [rad], speed [m/s], in the device's coordinates


class ClosedLoop:
    """A closed loop in one scene: once per step, read `seen`, then call `go` with a decision."""

    def __init__(
        self, scenario: Scenario, world: World, background: Motion, reacting: Bool[Array, " agent"] | None
    ) -> None:
        """`background` [agent, time] is every agent's own track; `reacting` agents brake on theirs."""
        self._scenario, self._world, self._background, self._reacting = scenario, world, background, reacting
        self._origin = np.array([*scene_origin(scenario), 0.0, 0.0])
        self._log = np.stack(_leaves(background))  # [4, agent, time]
        if reacting is not None:
            # Flattened once: to go through a World at every step takes longer than the step.
            given = world.without_road(), background, reacting
            self._given, self._form = jax.tree.flatten(given)
        self._now = self._log[:, :, 0].copy()
        self._now[:, 0] = [float(values[0]) for values in _leaves(world.start)]
        if reacting is not None:
            poses, step = on_device(self._now, np.float32), on_device(0, np.int32)
            self._state = [*jax.tree.leaves(begin(background)), poses, step]
        self._past, self._controls = [self._now], list[tuple[float, float]]()

    @property
    def scene(self) -> Scene:
        """The scene that the planner is told."""
        return scene_of(self._scenario)

    @property
    def seen(self) -> Snapshot:
        """All agents at the present step."""
        valid = self._scenario.tracks.valid[:, len(self._controls)]
        x, y, yaw, speed = np.where(valid, self._now[:, : len(valid)] + self._origin[:, None], 0.0)
        return Snapshot(x, y, yaw, speed, valid, np.where(valid, self._scenario.heights(x, y), 0.0))

    def go(self, decision: Control | Placement) -> None:
        """Move everything one step on."""
        step, ego = len(self._controls), self._now[:, 0].copy()
        placed = None
        if isinstance(decision, Control):
            control = decision.accel, decision.curvature
        else:
            placed = self._placed(decision, ego)
            control = control_between(self._world, ego, placed)
        if self._reacting is None:
            now = self._log[:, :, step + 1].copy()
            now[:, 0] = move(self._world, ego, control) if placed is None else placed
        else:
            moves = np.array(control if placed is None else placed, np.float32)
            self._state, moved = _advance(self._form, self._given, self._state, moves)
            now = np.array(moved, float)
            if placed is not None:
                now[:, 0] = placed
        self._now = now
        self._past.append(now)
        self._controls.append(control)

    @property
    def track(self) -> EgoTrack:
        """The ego's track up to the present step."""
        states = np.array([now[:, 0] for now in self._past], np.float32)
        return EgoTrack(Motion(*jnp.asarray(states.T)), self.controls)

    @property
    def motion(self) -> Motion:
        """The motion [agent, time] of all agents up to the present step."""
        return Motion(*jnp.asarray(np.stack(self._past, axis=-1), jnp.float32))

    @property
    def controls(self) -> ControlArrays:
        """The ego's controls [step] up to the present step."""
        return ControlArrays(*jnp.asarray(np.array(self._controls, np.float32).T))

    def _placed(self, at: Placement, before: State) -> State:
        """The ego's state at a placement, with a continuous yaw."""
        state = np.array([at.x, at.y, at.yaw, at.speed]) - self._origin
        state[2] = before[2] + float(wrap(np.asarray(at.yaw - before[2])))
        return state


@lru_cache(maxsize=64)
def scene_of(scenario: Scenario) -> Scene:
    """The planner's view of `scenario`; always the same object, so that it is sent only once."""
    return Scene.of(scenario, ACCEL_LIMIT, CURVATURE_LIMIT)


def drive_on_host(
    process: HostProcess, loops: Sequence[ClosedLoop], debug: dict[int, Debug] | None = None
) -> list[float]:
    """Drive all `loops` to their ends; returns the time of each decision [s]. Raises DriveError.

    What the planner thinks in the first of them is added to `debug`, by step.

    More than one loop at a time needs a planner that takes batches, and loops of equal length.
    """
    scenes = [loop.scene for loop in loops]
    process.reset(scenes)
    took = []
    for step in range(scenes[0].steps - 1):
        answers = process.act(step, [loop.seen for loop in loops], debug is not None)
        first = answers[0].decision
        if debug is not None and isinstance(first, Control) and first.debug is not None:
            debug[step] = first.debug
        for loop, answer in zip(loops, answers, strict=True):
            loop.go(answer.decision)
            took.append(answer.seconds)
    return took


def move(world: World, ego: State, control: tuple[float, float]) -> State:
    """The ego's state one step later, under acceleration [m/s^2] and curvature [1/m]."""
    return move_by(world.dynamics, world.half_length, world.dt, ego, control)


@in_float32
def move_by(
    dynamics: Dynamics, half_length: Float[Array, " agent"], dt: Array, ego: State, control: tuple[float, float]
) -> State:
    """The ego's state one step of `dt` [s] later, without a World; `half_length` [m] has the ego's first."""
    return np.array(_move(dynamics, np.asarray(ego, np.float32), np.array(control, np.float32), half_length, dt), float)


def control_between(world: World, ego: State, ahead: State) -> tuple[float, float]:
    """The control within the limits that leads from one state to the next as closely as possible."""
    found = np.asarray(_between(world.dynamics, np.stack([ego, ahead]).astype(np.float32), world.dt))
    return float(found[0]), float(found[1])


@partial(jax.jit, static_argnums=0)
def _move(
    dynamics: Dynamics, ego: Float[Array, " 4"], control: Float[Array, " 2"], half_length: Array, dt: Array
) -> Float[Array, " 4"]:
    ahead = Mobility(half_length[0], dynamics=dynamics).step(Motion(*ego), clip(ControlArrays(*control)), dt)
    return jnp.stack([ahead.x, ahead.y, ahead.yaw, ahead.speed])


@partial(jax.jit, static_argnums=0)
def _between(dynamics: Dynamics, states: Float[Array, "2 4"], dt: Array) -> Float[Array, " 2"]:
    alone = Motion(*states.T[:, None])
    found = clip(Mobility(jnp.zeros(1), dynamics=dynamics).controls_between(alone, dt))
    return jnp.stack([found.accel[0, 0], found.curvature[0, 0]])


@partial(jax.jit, static_argnums=0)
def _advance(
    form: Any, given: list[Array], state: list[Array], moves: Float[Array, " control_or_state"]
) -> tuple[list[Array], Float[Array, "4 agent"]]:
    """The state and every agent's pose at the next step.

    The ego moves from its pose by a control [2], or to its next pose [4]. `given` are the leaves of the world, the
    background and who reacts, and `form` is their tree. The state is that of `Reacting`, the poses and the step.
    """
    world, background, reacting = jax.tree.unflatten(form, given)
    *reactions, poses, step = state
    so_far, ego = Reacting(*reactions), Motion(*poses[:, 0])
    own, log = jax.tree.map(lambda values: values[:, step], (background, world.log))
    later = jax.tree.map(lambda values: values[:, step + 1], background)
    now = poses_now(background, reacting, so_far, own, ego)
    instant = BackgroundInstant(step, own, log, world.valid[:, step], world.moving[:, step])
    further = react(so_far, now, background, instant, world)
    placed = Motion(*moves) if len(moves) == len(poses) else move_ego(world, ego, clip(ControlArrays(*moves)))
    ahead = poses_now(background, reacting, further, later, placed)
    moved = jnp.stack([ahead.x, ahead.y, ahead.yaw, ahead.speed])
    return [*jax.tree.leaves(further), moved, step + 1], moved


def _leaves(motion: Motion) -> list[np.ndarray]:
    return [np.asarray(values, float) for values in (motion.x, motion.y, motion.yaw, motion.speed)]
