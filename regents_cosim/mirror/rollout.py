"""The closed loop: background agents in closed form, the ego step by step under its planner.

Background agents follow open-loop controls, so their motion does not depend on the ego. Everything that a planner
derives from them alone is computed for all steps at once (`look`); only the ego's own step runs in a loop. Gradients do
not pass through the ego: its actions are constants of the attack, as in the code of both papers, so any planner can be
attacked.
"""

import traceback
from collections.abc import Callable
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.mirror.programs.compiled import mapped_with
from regents_cosim.mirror.reactions.react import react
from regents_cosim.mirror.reactions.state import BackgroundInstant, Reacting, begin, place
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.system.foreign_code import foreign_code, said_by

_R = TypeVar("_R")


class Traffic(eqx.Module):
    """Other road users in scene coordinates, [agent, time] or [agent] at one instant."""

    motion: Motion
    valid: Bool[Array, "*axes"]
    half_length: Float[Array, "*sizes"]  # [m]
    half_width: Float[Array, "*sizes"]  # [m]
    z: Float[Array, "*axes"] | None = None  # [m] height of the road under them, in scenes with roads above each other


@runtime_checkable
class LoopPlanner(Protocol):
    """A planner that runs inside the compiled loop; memory and sight are pytrees of its own."""

    most_braking_m_s2: ClassVar[float]  # the loop lets it brake no harder

    def look(self, memory: Any, traffic: Traffic) -> Any:
        """The planner's view of the others: leaves [time, ...], row k from step k of `traffic` alone."""
        ...

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """The control for one step and the next memory, from row k of `look` and the ego's state."""
        ...

    def keep(self, last: Any) -> Any:
        """The part of the memory at the end of a drive that can spare work in the next drive through the same scene."""
        ...

    def recall(self, memory: Any, kept: Any) -> Any:
        """The memory to begin the next drive with, from the initial memory and what `keep` returned."""
        ...


class RaisedInLoopError(DriveError):
    """A planner raised an error while it was traced; the caller adds its name and the case (`foreign`)."""


def ask(question: Callable[..., _R], *given: Any) -> _R:
    """Call a planner while a program is traced. Raises RaisedInLoopError for any error of the planner."""
    with foreign_code(_raised_in_loop):
        return question(*given)


def _raised_in_loop(error: BaseException) -> RaisedInLoopError:
    return RaisedInLoopError(f"the planner failed: {said_by(error)}", "".join(traceback.format_exception(error)))


def roll_out_background(world: World, controls: ControlArrays) -> Motion:
    """Motion [agent, time] of all agents under open-loop `controls` [agent, step]; row 0 is not the ego's."""
    return as_scripted(world, world.mobility.roll_out(world.start, controls, world.moving, world.dt))


def as_scripted(world: World, motion: Motion) -> Motion:
    """`motion` with the agents that no controls can move replaced by their log."""
    if world.scripted is None:
        return motion
    scripted = world.scripted[:, None]
    return jax.tree.map(lambda logged, rolled: jnp.where(scripted, logged, rolled), world.log, motion)


class EgoTrack(eqx.Module):
    """The ego's motion, as found by a closed loop outside the compiled one."""

    motion: Motion  # [time]
    controls: ControlArrays  # [step] controls that made the motion, or come closest to it


class FixedEgo(eqx.Module):
    """A stand-in for a planner: the ego follows the `EgoTrack` given as its memory, whatever the others do."""

    most_braking_m_s2: ClassVar[float] = ACCEL_LIMIT

    def look(self, memory: EgoTrack, traffic: Traffic) -> Any:
        """Return nothing, as the motion is fixed."""
        return ()

    def step(self, memory: EgoTrack, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """Never called, as the motion is fixed."""
        raise NotImplementedError

    def keep(self, last: EgoTrack | None) -> None:
        """Keep nothing."""

    def recall(self, memory: EgoTrack, kept: None) -> EgoTrack:
        """Return the track."""
        return memory


def drive(planner: LoopPlanner, memory: Any, world: World, background: Motion) -> tuple[Motion, ControlArrays, Any]:
    """The ego's motion [time] and controls [step] when `planner` drives among `background` [agent, time].

    The third value is the planner's memory at the end.
    """
    if isinstance(planner, FixedEgo):
        return memory.motion, memory.controls, memory
    sight = ask(planner.look, memory, others(world, background, world.valid))

    def advance(carry: tuple[Motion, Any], sight_now: Any) -> tuple[tuple[Motion, Any], tuple[Motion, ControlArrays]]:
        ego, recalled = carry
        control, recalled = _step(planner, recalled, sight_now, ego)
        return (move_ego(world, ego, control), recalled), (ego, control)

    decisions = jax.tree.map(lambda values: values[:-1], sight)
    (last, memory), (motion, controls) = jax.lax.scan(advance, (ego_start(world), memory), decisions)
    return jax.tree.map(lambda values, end: jnp.append(values, end), motion, last), controls, memory


def drive_among_reacting(
    planner: LoopPlanner, memory: Any, world: World, background: Motion, reacting: Bool[Array, " agent"]
) -> tuple[Motion, ControlArrays, Any]:
    """The motion [agent, time] of all agents when the `reacting` ones react to others.

    The other agents follow `background` [agent, time]. Returns also the ego's controls [step] and the planner's memory
    at the end. It is slower than `drive`, as all agents move, and the planner looks, step by step.
    """

    def advance(
        carry: tuple[Motion, Any, Reacting], inputs: tuple[BackgroundInstant, Any]
    ) -> tuple[Any, tuple[Motion, ControlArrays]]:
        ego, recalled, state = carry
        instant, held = inputs
        now = poses_now(background, reacting, state, instant.own, ego)
        further = react(state, now, background, instant, world)
        if held is not None:
            control, ahead = held
        else:
            seen = jax.tree.map(lambda values: values[:, None], now)
            control, recalled = decide(planner, recalled, others(world, seen, instant.present[:, None]), ego)
            ahead = move_ego(world, ego, control)
        return (ahead, recalled, further), (now, control)

    own, log, present = jax.tree.map(lambda values: values.T[:-1], (background, world.log, world.valid))
    held = None
    if isinstance(planner, FixedEgo):
        held = memory.controls, jax.tree.map(lambda values: values[1:], memory.motion)
    ego, state = mapped_with(background.x[0, 0], (ego_start(world), begin(background)))
    start = ego, None if held else memory, state
    (ego, memory, state), (motion, controls) = jax.lax.scan(
        advance, start, (BackgroundInstant(jnp.arange(len(present)), own, log, present, world.moving.T), held)
    )
    last = poses_now(background, reacting, state, jax.tree.map(lambda values: values[:, -1], background), ego)
    motion = jax.tree.map(lambda values, end: jnp.concatenate([values.T, end[:, None]], axis=1), motion, last)
    return motion, controls, memory


def poses_now(
    background: Motion, reacting: Bool[Array, " agent"], state: Reacting, own_now: Motion, ego: Motion
) -> Motion:
    """The poses [agent] of all agents: the `reacting` ones as their `state` says, the others at `own_now`."""
    as_far = place(background, state)
    return with_ego(jax.tree.map(lambda a, b: jnp.where(reacting, a, b), as_far, own_now), ego)


def decide(planner: LoopPlanner, memory: Any, traffic: Traffic, ego: Motion) -> tuple[ControlArrays, Any]:
    """The planner's control, within its limits, and its next memory, from one instant of `traffic` [agent, 1]."""
    sight = jax.tree.map(lambda values: values[0], ask(planner.look, memory, traffic))
    return _step(planner, memory, sight, ego)


def _step(planner: LoopPlanner, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
    """The planner's control, within its limits, and its next memory. Raises TypeError for another kind of answer."""
    answer: Any = ask(planner.step, memory, sight, ego)
    parts = answer if isinstance(answer, tuple | list) else (answer,)
    if len(parts) != 2 or not isinstance(parts[0], ControlArrays):
        kinds = ", ".join(type(part).__name__ for part in parts)
        raise TypeError(f"`step` returns {kinds}, expected ControlArrays(accel, curvature) and the memory")
    return _limited(planner, parts[0]), parts[1]


def _limited(planner: LoopPlanner, control: ControlArrays) -> ControlArrays:
    """A planner's control within its limits; a value that is not finite stays, for the host to see (`jax_planner`)."""
    within = clip(control, planner.most_braking_m_s2)
    return jax.tree.map(lambda said, cut: jnp.where(jnp.isfinite(said), cut, said), control, within)


def move_ego(world: World, ego: Motion, control: ControlArrays) -> Motion:
    """The ego's state one step later."""
    return Mobility(world.half_length[0], dynamics=world.dynamics).step(ego, control, world.dt)


def others(world: World, motion: Motion, valid: Bool[Array, "agent time"]) -> Traffic:
    """All agents except the ego, as a planner sees them."""
    height = world.height(motion)
    motion = jax.tree.map(lambda values: values[1:], motion)
    z = None if height is None else height[1:]
    return Traffic(motion, valid[1:], world.half_length[1:], world.half_width[1:], z)


def with_ego(background: Motion, ego: Motion) -> Motion:
    """The motion of all agents, over time or at one instant, with row 0 replaced by `ego`."""
    return jax.tree.map(lambda values, mine: jnp.concatenate([mine[None], values[1:]]), background, ego)


def ego_start(world: World) -> Motion:
    """The ego's state at the first step."""
    return jax.tree.map(lambda values: values[0], world.start)
