"""A planner written in JAX: an `eqx.Module` that runs inside the compiled loop.

Ten lines do:

```python
import jax.numpy as jnp
from regents_cosim import ControlArrays, JaxPlanner


class Cautious(JaxPlanner):
    def step(self, memory, sight, ego):
        ahead = (sight.motion.x - ego.x) * jnp.cos(ego.yaw) + (sight.motion.y - ego.y) * jnp.sin(ego.yaw)
        near = jnp.any(sight.valid & (ahead > 0) & (ahead < 15.0))
        return ControlArrays(accel=jnp.where(near, -4.0, 1.0), curvature=jnp.float32(0.0)), memory
```
"""

import re
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.mirror.rollout import RaisedInLoopError, Traffic, decide, others
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.routes.route import Route, route_of
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.foreign_code import exit_is_raised, foreign_code, said_by


@dataclass(frozen=True, repr=False)
class CompiledScene(ShortRepr):
    """The scene that a planner gets before the first step: the scenario, and its World on the device.

    The device's coordinates are the map's less `origin`. The map is in the scenario: on the device everything counts as
    road, except in some attacks. A planner that looks at later steps of the tracks knows the future; only `log_replay`
    is meant to.
    """

    scenario: Scenario
    world: World
    way: Float[np.ndarray, "point 2"] | None = None  # [m] the way to drive along; None: its `route`

    @property
    def route(self) -> Route:
        """The route of the ego in the map's frame, as `Scene.route`; `on_device` turns its points."""
        return route_of(self.scenario)

    @property
    def origin(self) -> Float[np.ndarray, " 2"]:
        """The origin [m, map frame] of the device's coordinates."""
        return scene_origin(self.scenario)

    def on_device(self, points: Float[np.ndarray, "point 2"]) -> Float[Array, "point 2"]:
        """Points of the map frame in the device's coordinates [m]."""
        return on_device(seen_from(points, self.origin), np.float32)


class JaxPlanner(eqx.Module):
    """A planner inside the compiled loop: override `step`, and `init` or `look` where needed.

    `init` runs once per scenario on the host. Everything else must be traceable by JAX, also under `jax.vmap`: a
    `jax.pure_callback` needs its `vmap_method`. Memory of equal shapes over scenarios saves compilations.
    """

    most_braking_m_s2: ClassVar[float] = ACCEL_LIMIT  # the loop clips its controls to that

    def init(self, scene: CompiledScene) -> Any:
        """The memory at the first step, any pytree."""
        return ()

    def look(self, memory: Any, traffic: Traffic) -> Any:
        """What the planner sees of the others, with time as first axis; by default the `Traffic` of each step.

        Each row may depend only on its own step of `traffic`: `look` is called for all steps at once where the others
        do not depend on the ego, and step by step where they do.
        """
        steps = traffic.valid.shape[-1]
        motion, valid, z = jax.tree.map(lambda v: jnp.moveaxis(v, -1, 0), (traffic.motion, traffic.valid, traffic.z))
        sizes = (traffic.half_length, traffic.half_width)
        return Traffic(motion, valid, *(jnp.broadcast_to(v, (steps, *v.shape)) for v in sizes), z=z)

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """The scalar controls for one step, and the next memory.

        `sight` is one row of `look`: by default a `Traffic` whose values have shape [agent], without the ego. `ego` has
        scalars. The controls are clipped to the mirror's limits and `most_braking_m_s2`; a non-finite control is an
        error of the planner.
        """
        raise NotImplementedError(f"{type(self).__name__} has no `step`")

    def keep(self, last: Any) -> Any:
        """The part of the final memory that saves work in the next drive through the same scene.

        By default there is none. It must not change any decision.
        """
        return None

    def recall(self, memory: Any, kept: Any) -> Any:
        """The memory to begin the next drive with, from the initial memory and what `keep` returned."""
        return memory


def start(planner: JaxPlanner, scene: CompiledScene, name: str) -> Any:
    """The planner's memory of `scene`, after a check that it can take a step there.

    Raises DriveError with the planner's own error where it fails, and with what was expected where its answer has the
    wrong form. Non-finite values show later.
    """
    traffic, ego = _at_first(scene.world)

    def failed(error: BaseException) -> DriveError:
        said = str(error).strip().partition("\n")[0]
        return DriveError(
            f"planner {name!r} failed on case {scene.scenario.id}: {type(error).__name__}: {said}",
            "".join(traceback.format_exception(error)),
        )

    with foreign(name, scene.scenario.id), foreign_code(failed):
        memory = planner.init(scene)
        control, after = _forms(planner, memory, traffic, ego)
    if any(value.shape != () for value in jax.tree.leaves(control)):
        shapes = [list(value.shape) for value in jax.tree.leaves(control)]
        raise DriveError(f"planner {name!r}: controls of shapes {shapes}, expected two scalars (accel, curvature)")
    if other := _difference(memory, after):
        raise DriveError(f"planner {name!r}: `step` returns another kind of memory than it was given: {other}")
    return memory


def require_finite(controls: ControlArrays, name: str, case: str, first_step: int = 0) -> None:
    """Raise DriveError for a planner whose controls, from `first_step` on, are not all finite."""
    answers = np.stack([np.ravel(np.asarray(values)) for values in (controls.accel, controls.curvature)])
    bad = np.flatnonzero(~np.isfinite(answers).all(axis=0))
    if len(bad):
        accel, curvature = answers[:, bad[0]].tolist()
        raise DriveError(
            f"planner {name!r} answered accel {accel}, curvature {curvature} at step {first_step + int(bad[0])} "
            f"of case {case}, expected finite numbers"
        )


@contextmanager
def foreign(name: str, case: str, when: str = "") -> Iterator[None]:
    """Raise DriveError for errors of the planner while a program is traced or run (callbacks, `eqx.error_if`).

    Wait for the results inside the context, as an error comes with them.
    """
    where = f"on case {case} {when}".rstrip()
    try:
        with exit_is_raised():
            yield
    except RaisedInLoopError as error:
        said = said_by(error.__cause__ or error)
        raise DriveError(f"planner {name!r} failed {where}: {said}", error.trace) from error
    except (RuntimeError, ValueError) as error:  # JAX's own errors take both forms
        said = str(error)
        if not isinstance(error, eqx.EquinoxRuntimeError) and "callback error" not in said.lower():
            raise
        raise DriveError(f"planner {name!r} failed {where}: {_last_line(said)}", said) from error


def _last_line(said: str) -> str:
    """The message at the end of a traceback that JAX quotes."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    raised = [line for line in lines if re.match(r"[A-Za-z_][\w.]*(Error|Exception|Warning|Interrupt|Exit)\b", line)]
    return (raised or lines or ["no reason given"])[-1]


@compiled
def _at_first(world: World) -> tuple[Traffic, Motion]:
    """The first step: the others, with a time axis of length one, and the ego."""
    now = jax.tree.map(lambda values: values[:, :1], world.log)
    return others(world, now, world.valid[:, :1]), jax.tree.map(lambda values: values[0, 0], now)


def _forms(planner: JaxPlanner, *given: Any) -> tuple[ControlArrays, Any]:
    """The form of `decide`'s result, traced once for all scenes of one shape, as tracing costs more than a drive."""
    arrays, rest = eqx.partition(planner, eqx.is_array)
    try:
        hash(rest)
    except TypeError:  # it holds unhashable values, such as the arrays of a translated torch module
        return eqx.filter_eval_shape(decide, planner, *given)
    return _decided.eval_shape(rest, arrays, *given)


@partial(jax.jit, static_argnums=0)
def _decided(rest: JaxPlanner, arrays: JaxPlanner, *given: Any) -> tuple[ControlArrays, Any]:
    return decide(eqx.combine(arrays, rest), *given)


def _difference(before: Any, after: Any) -> str:
    """The first part of a memory in which two differ, and how; empty where both are of one kind."""
    was, now = _forms_by_place(before), _forms_by_place(after)
    for place in (*was, *now):
        found, expected = (forms.get(place, "nothing") for forms in (now, was))
        if found != expected:
            return f"memory{place} is {found}, expected {expected}"
    found, expected = map(jax.tree.structure, (after, before))
    return "" if found == expected else f"{found}, expected {expected}"


def _forms_by_place(memory: Any) -> dict[str, str]:
    """The form of each part of a memory by its place, such as `float32[384]` at `.x`."""
    parts = jax.tree_util.tree_leaves_with_path(memory)
    forms = (f"{jnp.result_type(value)}{list(jnp.shape(value))}" for _, value in parts)
    return dict(zip((jax.tree_util.keystr(place) for place, _ in parts), forms, strict=True))
