import jax
import jax.numpy as jnp
import numpy as np
from jax.test_util import check_grads
from scenes import scene

from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.rollout import drive, roll_out_background
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.jax_planner import JaxPlanner


class Follows(JaxPlanner):
    """A planner that smoothly keeps 15 m behind the first of the others."""

    def step(self, memory, sight, ego):
        gap = sight.motion.x[0] - ego.x - 15.0
        accel = 2.0 * jnp.tanh(0.1 * gap + 0.2 * (sight.motion.speed[0] - ego.speed))
        return ControlArrays(accel, 0.01 * jnp.tanh(sight.motion.y[0] - ego.y)), memory


def test_the_gradient_through_the_planner_is_that_of_finite_differences(x64):
    world = to_world(scene((0, 0, 10), (20, 0.5, 9), (50, 3.2, 10)))
    world = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, world)
    direction = jax.tree.map(lambda v: jnp.asarray(np.random.default_rng(0).normal(size=v.shape)), world.controls)

    @jax.jit
    def where_the_ego_ends(amount):
        controls = jax.tree.map(lambda v, d: v + jnp.asarray(amount) * 1e-2 * d, world.controls, direction)
        ego, *_ = drive(Follows(), (), world, roll_out_background(world, controls))
        return ego.x[-1] + 3.0 * ego.y[-1] + ego.speed[-1]

    check_grads(where_the_ego_ends, (jnp.asarray(0.5),), order=1, modes=["rev"], eps=1e-5, rtol=1e-5)


def test_the_ego_starts_where_it_was_recorded():
    world = to_world(scene((0, 0, 10), (20, 0.5, 9)))
    ego, controls, _ = drive(Follows(), (), world, roll_out_background(world, world.controls))
    assert ego.x.shape == (81,)
    assert controls.accel.shape == (80,)
    assert (ego.x[0], ego.speed[0]) == (world.start.x[0], world.start.speed[0])
