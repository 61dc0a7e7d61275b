"""Several drives judged by one program agree with each drive judged alone."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import scene

from regents_cosim.attacks.descent.actions import to_actions
from regents_cosim.attacks.descent.search import look_and_descend
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.jax_planner import CompiledScene, start
from regents_cosim.planners.under_test import PlannerUnderTest

ANY = REGENTS_FOCUSED.but(accept="any", adversary_may="anything", background="log", starts=3)
BRAKES = (0.0, -0.1, -0.9, -0.5)  # shares of the limit, over the first half; the third stops before the ego


@pytest.fixture(scope="module")
def looking():
    made, planner = scene((0, 0, 12), (40, 0, 12)), PlannerUnderTest.of("constant_velocity").loop
    world = to_world(made)
    job = SearchJob(world, start(planner, CompiledScene(made, world), "ego"), SearchedAgents.only(1, len(world.valid)))
    logged = job.searched.rows(to_actions(world.controls))
    early = jnp.arange(logged.accel.shape[1]) < 40
    starts = [replace(logged, accel=logged.accel + early * share) for share in BRAKES]

    def look(chosen, updates=0):
        given = [starts[index] for index in (*chosen, *[chosen[-1]] * (len(starts) - len(chosen)))]
        stacked = ControlArrays(*(jnp.stack(values) for values in zip(*map(jax.tree.leaves, given), strict=True)))
        count, most = jnp.int32(len(chosen)), jnp.int32(updates)
        return look_and_descend(job, planner, ANY.compiled(), stacked, count, most)

    return look


@pytest.mark.slow
def test_each_is_seen_as_if_it_were_alone(looking):
    found, together = looking([0, 1, 2, 3])
    alone = [looking([index])[1] for index in range(4)]
    assert np.asarray(together.accepted).tolist() == [False, False, True, False]
    for index in range(3):
        assert float(together.cost[index]) == pytest.approx(float(alone[index].cost[0]), rel=1e-5)
        assert np.asarray(together.terms[index]) == pytest.approx(np.asarray(alone[index].terms[0]), rel=1e-5)
    assert bool(alone[3].accepted[0])
    assert np.isinf(float(together.cost[3]))  # after one that is accepted none is looked at
    assert bool(found.accepted)
    assert int(found.iterations) == 0


@pytest.mark.slow
def test_updates_begin_with_the_last_one(looking):
    from_last, _ = looking([0, 1], updates=3)
    alone, _ = looking([1], updates=3)
    assert int(from_last.iterations) == 3
    for one, other in zip(jax.tree.leaves(from_last.controls), jax.tree.leaves(alone.controls), strict=True):
        assert np.asarray(one) == pytest.approx(np.asarray(other), abs=1e-6)
