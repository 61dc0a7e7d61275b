"""The twin against highway-env's own vehicle, state by state."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from highway_env.vehicle.kinematics import Vehicle
from hypothesis import given, settings
from hypothesis import strategies as st

from regents_cosim.geometry.frames import HighwayPose, Pose, from_highway, to_highway, wheel_from_curvature
from regents_cosim.mirror import bicycle, highway_bicycle
from regents_cosim.mirror.bicycle import ControlArrays, Motion

HORIZON_S = 8.0


class Drive(NamedTuple):
    """Start states and controls of some vehicles, on the host."""

    start: np.ndarray  # (x, y, yaw, speed) [4, agent]
    controls: np.ndarray  # (accel, curvature) [2, agent, step]
    lengths: np.ndarray
    dt: float

    def on_device(self, dtype=jnp.float64) -> tuple:
        arrays = [[jnp.asarray(v, dtype) for v in values] for values in (self.start, self.controls)]
        moving = jnp.ones(self.controls.shape[1:], bool)
        return Motion(*arrays[0]), ControlArrays(*arrays[1]), moving, jnp.asarray(0.5 * self.lengths, dtype), self.dt


def random_drive(seed: int, dt: float = 0.1, agents: int = 4) -> Drive:
    """A random drive whose controls are each held for a few steps."""
    rng = np.random.default_rng(seed)
    steps = round(HORIZON_S / dt)
    start = np.stack([rng.uniform(*range_, agents) for range_ in ((-200, 200), (-200, 200), (-4, 4), (0, 44))])
    lengths = rng.uniform(2.0, 14.0, agents)
    held = rng.integers(1, 8)
    accel, sine = (
        np.repeat(rng.uniform(-size, size, (agents, steps)), held, axis=1)[:, :steps] for size in (6.0, 0.65)
    )
    return Drive(start, np.stack([accel, sine / (0.5 * lengths[:, None])]), lengths, dt)


def gentle_drive(seed: int) -> Drive:
    """A drive as in usual traffic, away from the limits, from the middle of the map."""
    start, controls, lengths, dt = random_drive(seed)
    scale = np.array([0.0, 0.0, 1.0, 0.5])[:, None], np.array([0.2, 0.05])[:, None, None]
    return Drive(scale[0] * start + [[0], [0], [0], [3]], scale[1] * controls, lengths, dt)


def drive_highway_env(drive: Drive) -> np.ndarray:
    """(x, y, yaw, speed) [4, agent, time] of highway-env's vehicles under the same controls, in our frame."""
    steps = drive.controls.shape[2]
    seen = np.zeros((4, len(drive.lengths), steps + 1))
    for agent, length in enumerate(drive.lengths):
        x, y, yaw, speed = drive.start[:, agent].tolist()
        at = to_highway(Pose(x, y, yaw))
        vehicle = Vehicle(None, [at.x, at.y], at.heading, speed)
        vehicle.LENGTH = length
        for k in range(steps + 1):
            pose = from_highway(HighwayPose(*vehicle.position, vehicle.heading))
            seen[:, agent, k] = *pose, vehicle.speed
            if k < steps:
                accel, curvature = drive.controls[:, agent, k]
                stops = -vehicle.speed / drive.dt
                steering = float(wheel_from_curvature(curvature, length))
                vehicle.act({"acceleration": max(accel, stops), "steering": steering})
                vehicle.step(drive.dt)
    return seen


_roll_out = eqx.filter_jit(highway_bicycle.roll_out)


def roll_out(drive: Drive, dtype=jnp.float64) -> np.ndarray:
    motion = _roll_out(*drive.on_device(dtype))
    return np.stack([motion.x, motion.y, motion.yaw, motion.speed]).astype(float)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1 / 5, 1 / 10, 1 / 15]))
def test_the_twin_is_highway_env_s_vehicle(x64, seed, dt):
    drive = random_drive(seed, dt)
    np.testing.assert_allclose(roll_out(drive), drive_highway_env(drive), atol=1e-8)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_in_single_precision_traffic_stays_within_half_a_millimetre_after_8_s(seed):
    drive = gentle_drive(seed)
    miss = roll_out(drive, jnp.float32)[:2] - drive_highway_env(drive)[:2]
    assert np.hypot(*miss).max() < 5e-4


def test_step_by_step_is_the_roll_out(x64):
    drive = random_drive(3)
    state, controls, moving, half_length, dt = drive.on_device()
    for k in range(moving.shape[1]):
        state = highway_bicycle.step(state, jax.tree.map(lambda v, k=k: v[:, k], controls), half_length, dt)
    found = np.stack([state.x, state.y, state.yaw, state.speed])
    np.testing.assert_allclose(found, roll_out(drive)[..., -1], atol=1e-9)


def test_controls_between_inverts_the_roll_out(x64):
    drive = random_drive(5)
    driven = roll_out(drive)
    found = highway_bicycle.controls_between(Motion(*map(jnp.asarray, driven)), drive.dt)
    again = drive._replace(controls=np.stack([found.accel, found.curvature]))
    np.testing.assert_allclose(roll_out(again)[:2], driven[:2], atol=1e-6)


def test_a_late_agent_waits_at_its_start(x64):
    drive = random_drive(7)
    start, controls, moving, half_length, dt = drive.on_device()
    motion = _roll_out(start, controls, moving & (jnp.arange(80) >= 30), half_length, dt)
    np.testing.assert_array_equal(motion.x[:, :31], np.tile(drive.start[0][:, None], 31))
    assert not np.allclose(motion.x[:, 31], drive.start[0])


def test_a_braking_vehicle_stops_and_can_start_again(x64):
    accel = np.array([[-6.0] * 10 + [2.0] * 10])
    drive = Drive(np.array([[0.0], [0.0], [0.0], [2.0]]), np.stack([accel, 0 * accel]), np.array([5.0]), 0.1)
    speed = roll_out(drive)[3]
    assert speed.min() == 0.0
    assert speed[0, -1] == pytest.approx(2.0)


def test_the_gradient_is_that_of_finite_differences(x64):
    start, controls, moving, half_length, dt = gentle_drive(11).on_device()

    def end(shift: jax.Array) -> jax.Array:
        moved = ControlArrays(controls.accel + shift[..., 0], controls.curvature + 0.01 * shift[..., 1])
        motion = highway_bicycle.roll_out(start, moved, moving, half_length, dt)
        return jnp.sum(motion.x[:, -1] + 2.0 * motion.y[:, -1])

    zero = jnp.zeros((*moving.shape, 2))
    gradient = jax.jit(jax.grad(end))(zero)
    rng = np.random.default_rng(0)
    for _ in range(3):
        along = jnp.asarray(rng.normal(size=zero.shape))
        numeric = (end(1e-6 * along) - end(-1e-6 * along)) / 2e-6
        assert float((gradient * along).sum()) == pytest.approx(float(numeric), rel=1e-5)


def test_our_own_bicycle_is_another_model():
    start, controls, moving, half_length, dt = random_drive(13).on_device(jnp.float32)
    twin = _roll_out(start, controls, moving, half_length, dt)
    assert float(jnp.abs(twin.x - bicycle.roll_out(start, controls, moving, dt).x).max()) > 1.0
