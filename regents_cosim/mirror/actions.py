"""Fit controls to recorded tracks, and fill the gaps of tracks.

The plain estimate (`bicycle.controls_between`, the paper's choice) inverts the model exactly but ignores positions, so
noise and model error add up over the horizon. The smooth fit is the least-squares solution of

    sum_k |p_k - p_log_k|^2 / s_p^2 + (yaw_k - yaw_log_k)^2 / s_yaw^2 + (u_k - u_log_k)^2 / s_u^2
        + (a_k - a_{k-1})^2 / s_a^2 + (c_k - c_{k-1})^2 / s_c^2

by Gauss-Newton in its time-recursive form (iterative LQR): every pass solves the linearised problem backwards in time
and then rolls out forwards *with the feedback that it found*. The first pass around the log itself is a tracking
controller, so it does not diverge where an open-loop fit does. Source: Li and Todorov 2004 (iLQR); limits by clipping
in the forward pass.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, turning_way, wrap
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario.scenario import Tracks

# Standard deviations of the fit: tight on position, loose on yaw (SUMO's vehicles slip up to 7 degrees at their centre
# in curves) and on the change of the controls per step.
_POSITION_M = 0.02
_YAW_RAD = 0.2
_SPEED_M_S = 1.0
_ACCEL_CHANGE = 2.0  # [m/s^2]
_CURVATURE_CHANGE = 0.02  # [1/m]


# Number of passes of the fit.
OF_RECORDINGS = 8  # noisy tracks
OF_SMOOTH_TRACKS = 3  # the result is within 0.1 mm of that of eight passes
OF_PREDICTIONS = 2  # the result is within 1 mm of that of eight passes


def fill_gaps(tracks: Tracks) -> Tracks:
    """Tracks in which invalid entries repeat the nearest valid state, the earlier one on a tie."""
    steps = np.arange(tracks.steps)
    nearest = np.zeros(tracks.x.shape, int)
    for agent, valid in enumerate(tracks.valid):
        present = np.flatnonzero(valid)
        if len(present):
            nearest[agent] = present[np.abs(steps[:, None] - present).argmin(axis=1)]
    filled = {name: np.take_along_axis(getattr(tracks, name), nearest, 1) for name in ("x", "y", "yaw", "speed", "z")}
    return Tracks(**filled, valid=tracks.valid)


@compiled
def fit_controls(
    log: Motion,
    valid: Bool[Array, "agent time"],
    start: Motion,
    moving: Bool[Array, "agent step"],
    dt: Float[Array, ""],
    mobility: Mobility,
    passes: int = OF_RECORDINGS,
) -> ControlArrays:
    """Controls [agent, step] within the limits whose roll-out from `start` [agent] follows `log` [agent, time].

    With highway-env's model the plain estimate is kept where it follows the log more closely: for a log of highway-env
    it is exact.
    """
    first = clip(mobility.controls_between(log, dt))

    def fit(mobility: Mobility, *given: Any) -> ControlArrays:
        if mobility.dynamics == "highway":
            return _fit_highway(partial(_advance_highway, mobility, dt), passes, *given)
        return _fit_one(partial(_advance, mobility.walks, dt), passes, *given)

    return jax.vmap(fit)(mobility, log, valid, start, moving, first)


class _Trajectory(eqx.Module):
    """One agent's states (x, y, yaw, speed, previous acceleration, previous curvature) and controls."""

    states: Float[Array, "time 6"]
    controls: Float[Array, "step 2"]
    cost: Float[Array, ""]


# A change of the controls: an offset, plus a gain times the deviation from the nominal states.
_Policy = tuple[Float[Array, "step 2"], Float[Array, "step 2 6"]]

_CHANGE_WEIGHT = np.array([1.0 / _ACCEL_CHANGE**2, 1.0 / _CURVATURE_CHANGE**2], np.float32)
_STATE_WEIGHT = np.array(
    [1.0 / _POSITION_M**2, 1.0 / _POSITION_M**2, 1.0 / _YAW_RAD**2, 1.0 / _SPEED_M_S**2, 0.0, 0.0], np.float32
)
_LIMITS = np.array([ACCEL_LIMIT, CURVATURE_LIMIT], np.float32)


# (state, control, moves) -> the state one step later
_Advance = Callable[[Array, Array, Array], Float[Array, " 6"]]


class _Drive(NamedTuple):
    """What the controls of one agent have to follow, and how they move it."""

    advance: _Advance
    begin: Float[Array, " 6"]
    goal: Float[Array, "time 6"]
    valid: Bool[Array, " time"]
    moving: Bool[Array, " step"]


def _product(a: Float[Array, "row inner"], b: Float[Array, "inner *column"]) -> Float[Array, "row *column"]:
    """A matrix product by broadcasting: for small matrices in a batch XLA would call a library once per matrix."""
    return (a[:, :, None] * b[None]).sum(axis=1) if b.ndim == 2 else (a * b[None]).sum(axis=1)


def _fit_one(
    advance: _Advance, passes: int, log: Motion, valid: Array, start: Motion, moving: Array, first: ControlArrays
) -> ControlArrays:
    controls = jnp.stack([first.accel, first.curvature], axis=-1)
    goal = jnp.stack([log.x, log.y, log.yaw, log.speed], axis=-1)
    goal = jnp.concatenate([goal, jnp.concatenate([controls[:1], controls])], axis=-1)
    begin = jnp.concatenate([jnp.stack([start.x, start.y, start.yaw, start.speed]), controls[0]])
    drive = _Drive(advance, begin, goal, valid, moving)

    def improve(best: _Trajectory, _: None) -> tuple[_Trajectory, None]:
        policy = _solve_backwards(drive, best)

        def scaled(best: _Trajectory, scale: Array) -> tuple[_Trajectory, None]:
            new = _roll_forwards(drive, best, policy, scale)
            better = new.cost < best.cost
            return jax.tree.map(lambda a, b: jnp.where(better, a, b), new, best), None

        return jax.lax.scan(scaled, best, jnp.asarray([1.0, 0.3], goal.dtype))

    nominal = _Trajectory(goal, controls, jnp.asarray(jnp.inf, goal.dtype))
    best, _ = jax.lax.scan(improve, nominal, length=passes)
    return ControlArrays(best.controls[:, 0], best.controls[:, 1])


def _advance(walks: Array | None, dt: Array, state: Array, control: Array, moves: Array) -> Float[Array, " 6"]:
    """One step of `bicycle.step` that also stores the control; the agent stands still unless it `moves`."""
    x, y, yaw, speed = state[:4]
    next_speed = jnp.where(speed + control[0] * dt >= 0.0, speed + control[0] * dt, 0.0)
    travelled = 0.5 * (speed + next_speed) * dt
    turned = control[1] * turning_way(travelled, walks, dt)
    mid = yaw + 0.5 * turned
    ahead = jnp.stack([x + travelled * jnp.cos(mid), y + travelled * jnp.sin(mid), yaw + turned, next_speed])
    return jnp.concatenate([jnp.where(moves, ahead, state[:4]), control])


def _advance_highway(mobility: Mobility, dt: Array, state: Array, control: Array, moves: Array) -> Float[Array, " 6"]:
    """One step of highway-env's model that also stores the control; the agent stands still unless it `moves`."""
    ahead = mobility.step(Motion(*state[:4]), ControlArrays(*control), dt)
    moved = jnp.stack([ahead.x, ahead.y, ahead.yaw, ahead.speed])
    return jnp.concatenate([jnp.where(moves, moved, state[:4]), control])


def _fit_highway(
    advance: _Advance, passes: int, log: Motion, valid: Array, start: Motion, moving: Array, first: ControlArrays
) -> ControlArrays:
    """The fit by highway-env's model, or `first` where that follows the log more closely."""
    begin = jnp.stack([start.x, start.y, start.yaw, start.speed, 0.0 * start.x, 0.0 * start.x])

    def miss(controls: ControlArrays) -> Float[Array, ""]:
        def forward(state: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
            return advance(state, *now), state[:2]

        inputs = (jnp.stack([controls.accel, controls.curvature], axis=-1), moving)
        last, places = jax.lax.scan(forward, begin, inputs)
        x, y = jnp.concatenate([places, last[None, :2]]).T
        return jnp.max(jnp.where(valid, jnp.hypot(x - log.x, y - log.y), 0.0))

    fit = _fit_one(advance, passes, log, valid, start, moving, first)
    keep = miss(first) < miss(fit)
    return jax.tree.map(lambda a, b: jnp.where(keep, a, b), first, fit)


def _deviation(state: Array, goal: Array) -> Float[Array, " 6"]:
    return (state - goal).at[2].set(wrap(state[2] - goal[2]))


def _solve_backwards(drive: _Drive, nominal: _Trajectory) -> _Policy:
    """The Gauss-Newton policy around `nominal`, whose states need not follow from its controls."""
    states, controls = nominal.states, nominal.controls
    a, b = jax.vmap(jax.jacfwd(drive.advance, (0, 1)))(states[:-1], controls, drive.moving)
    reached = jax.vmap(drive.advance)(states[:-1], controls, drive.moving)
    defect = reached - states[1:]
    weight = drive.valid[:, None] * _STATE_WEIGHT
    pull = weight * jax.vmap(_deviation)(states, drive.goal)
    change = controls - states[:-1, 4:]

    def back(value: tuple[Array, Array], step: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        slope, curve = value
        a_k, b_k, defect_k, weight_k, pull_k, change_k = step
        slope = slope + _product(curve, defect_k)
        steer = jnp.diag(_CHANGE_WEIGHT)
        along_state = pull_k + _product(a_k.T, slope) - jnp.pad(_product(steer, change_k), (4, 0))
        along_control = _product(steer, change_k) + _product(b_k.T, slope)
        state_state = jnp.diag(weight_k) + _product(_product(a_k.T, curve), a_k) + jnp.pad(steer, ((4, 0), (4, 0)))
        control_state = _product(_product(b_k.T, curve), a_k) - jnp.pad(steer, ((0, 0), (4, 0)))
        inverse = _inverse_2x2(steer + _product(_product(b_k.T, curve), b_k))
        offset, gain = _product(-inverse, along_control), _product(-inverse, control_state)
        slope = along_state + _product(control_state.T, offset)
        curve = state_state + _product(control_state.T, gain)
        return (slope, 0.5 * (curve + curve.T)), (offset, gain)

    last = (pull[-1], jnp.diag(weight[-1]))
    _, (offset, gain) = jax.lax.scan(back, last, (a, b, defect, weight[:-1], pull[:-1], change), reverse=True)
    return offset, gain


def _inverse_2x2(m: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return jnp.array([[m[1, 1], -m[0, 1]], [-m[1, 0], m[0, 0]]]) / determinant


def _roll_forwards(drive: _Drive, nominal: _Trajectory, policy: _Policy, scale: Array) -> _Trajectory:
    """Roll out from the begin with the policy around `nominal`; controls are clipped to the limits."""

    def forward(state: Array, step: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        nominal_state, nominal_control, offset, gain, moves = step
        correction = scale * offset + _product(gain, _deviation(state, nominal_state))
        control = jnp.clip(nominal_control + correction, -_LIMITS, _LIMITS)
        return drive.advance(state, control, moves), (state, control)

    steps = (nominal.states[:-1], nominal.controls, *policy, drive.moving)
    last, (states, controls) = jax.lax.scan(forward, drive.begin, steps)
    states = jnp.concatenate([states, last[None]])
    misses = drive.valid[:, None] * _STATE_WEIGHT * jax.vmap(_deviation)(states, drive.goal) ** 2
    changes = _CHANGE_WEIGHT * (controls - states[:-1, 4:]) ** 2
    return _Trajectory(states, controls, misses.sum() + changes.sum())
