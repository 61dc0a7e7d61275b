from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from params import slow
from quick_xla import ALL_PASSES
from scenes import moving, platoon, scene

from regents_cosim.attacks.descent import costs
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING
from regents_cosim.geometry import boxes as host
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import COMPILER_OPTIONS
from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.separation import distance
from regents_cosim.mirror.world import to_world

# Compiled as a whole: op by op, every test would compile each of them alone.
pooled_ego_distances = eqx.filter_jit(costs.pooled_ego_distances)
road_deviation = eqx.filter_jit(costs.road_deviation)
total_cost = eqx.filter_jit(costs.total_cost)


def ego_distance(world, boxes, searched):
    return total_cost(world, boxes, searched, KING).ego


def pair_proximity(world, boxes, searched, reach_m):
    return total_cost(world, boxes, searched, KING.but(pair_reach_m=reach_m)).pair


def prepared(scenario, candidates=None):
    """World, boxes along the log, and who may attack (all but the ego)."""
    world = to_world(scenario)
    chosen = np.zeros(world.valid.shape[0], bool)
    chosen[list(range(1, len(scenario.agents)) if candidates is None else candidates)] = True
    return world, world.boxes(world.log), SearchedAgents.among(jnp.asarray(chosen))


def test_the_ego_distance_is_the_mean_gap_to_the_nearest_candidate():
    world, boxes, searched = prepared(scene((0, 0, 10), (20, 0, 10), (30, 0, 10)))
    assert ego_distance(world, boxes, searched) == pytest.approx(20 - 4.6, abs=1e-3)


def test_only_candidates_count():
    world, boxes, searched = prepared(scene((0, 0, 10), (20, 0, 10), (30, 0, 10)), [2])
    assert ego_distance(world, boxes, searched) == pytest.approx(30 - 4.6, abs=1e-3)


def test_the_mean_is_over_time_and_over_valid_steps_only():
    made = scene((0, 0, 10), (20, 0, 12))
    world, boxes, searched = prepared(made)
    assert ego_distance(world, boxes, searched) == pytest.approx(20 - 4.6 + 0.5 * 2 * 8, abs=1e-2)
    world, boxes, searched = prepared(moving(made, 1, valid=np.arange(81) < 41))
    assert ego_distance(world, boxes, searched) == pytest.approx(20 - 4.6 + 0.5 * 2 * 4, abs=1e-2)


def test_the_soft_minimum_pulls_the_closest_moments_together():
    made = scene((0, 0, 10), (20, 0, 12), (30, 3.2, 8))
    world, boxes, _ = prepared(made)
    soft = pooled_ego_distances(world, boxes, KING.but(softmin_m=2.0))
    exact = host.distance(host.Boxes(*(v[:1] for v in made.boxes)), made.boxes)
    expected = -2.0 * np.log(np.mean(np.exp(-exact / 2.0), axis=1))
    assert soft[1:3] == pytest.approx(expected[1:3], abs=1e-2)
    assert exact[2].min() < soft[2] < exact[2].mean()


def test_who_is_behind_does_not_pull():
    world, boxes, _ = prepared(scene((0, 0, 10), (-20, 0, 10), (-20, 0, 15)))
    distances = pooled_ego_distances(world, boxes, KING.but(pull_from_behind=False))
    assert distances[1] > 1e3
    assert distances[2] < 20


def test_mean_distances_are_those_of_the_exact_boxes():
    made = platoon()
    world, boxes, _ = prepared(made)
    ego = host.Boxes(*(v[:1] for v in made.boxes))
    assert pooled_ego_distances(world, boxes)[:9] == pytest.approx(
        host.distance(ego, made.boxes).mean(axis=1), abs=1e-3
    )


def test_the_pair_cost_is_the_least_gap_of_two_background_agents():
    world, boxes, searched = prepared(scene((0, 0, 10), (40, 0, 10), (45, 0, 10), (80, 0, 10)))
    assert pair_proximity(world, boxes, searched, 1.25) == pytest.approx(-(5 - 4.6), abs=1e-3)


def test_beyond_tau_pairs_do_not_repel():
    world, boxes, searched = prepared(scene((0, 0, 10), (40, 0, 10), (50, 0, 10)))
    assert pair_proximity(world, boxes, searched, 1.25) == pytest.approx(-1.25)


def test_the_ego_is_in_no_pair():
    world, boxes, searched = prepared(scene((0, 0, 10), (5, 0, 10), (60, 0, 10)))
    assert pair_proximity(world, boxes, searched, 1.25) == pytest.approx(-1.25)


def test_pairs_that_overlap_in_the_log_are_left_out():
    world, boxes, searched = prepared(scene((0, 0, 10), (40, 0, 10), (42, 0, 10), (45.1, 3.2, 10)))
    # the gap of the third to the fourth is across the lanes: 3.2 - 1.8
    assert pair_proximity(world, boxes, searched, 9.0) == pytest.approx(-1.4, abs=1e-3)


def test_pairs_of_which_neither_may_change_do_not_hide_the_others():
    world, boxes, searched = prepared(scene((0, 0, 10), (40, 0, 10), (45, 0, 10), (50.6, 0, 10)), [3])
    assert pair_proximity(world, boxes, searched, 1.25) == pytest.approx(-1.0, abs=1e-3)


def test_one_background_agent_makes_no_pair():
    world, boxes, searched = prepared(scene((0, 0, 10), (40, 0, 10)))
    assert pair_proximity(world, boxes, searched, 1.25) == pytest.approx(-1.25)


@pytest.mark.slow
def test_the_closest_pair_is_found_among_many():
    rng = np.random.default_rng(0)
    for _ in range(5):
        cars = [
            (x, y, v)
            for x, y, v in zip(rng.uniform(0, 150, 20), rng.uniform(0, 60, 20), rng.uniform(5, 15, 20), strict=True)
        ]
        made = scene(*cars)
        world, boxes, searched = prepared(made)
        mine, theirs = (
            host.Boxes(*(np.expand_dims(np.broadcast_to(v, made.tracks.x.shape), axis) for v in made.boxes))
            for axis in (1, 0)
        )
        exact = host.distance(mine, theirs)
        i, j = np.triu_indices(20, k=1)
        counted = (i > 0) & (exact[i, j, 0] > 0)
        least = exact[i[counted], j[counted]].min()
        assert pair_proximity(world, boxes, searched, 99.0) == pytest.approx(-least, abs=1e-3)


@pytest.mark.slow
def test_the_closest_pair_is_found_where_more_come_within_reach_than_there_are_agents():
    rng = np.random.default_rng(1)
    made = scene(*((x, y, 10) for x, y in rng.uniform(0, 60, (60, 2))))
    world, boxes, searched = prepared(made)
    first = host.Boxes(*(np.broadcast_to(v, made.tracks.x.shape)[:, 0] for v in made.boxes))
    exact = host.distance(*(host.Boxes(*(np.expand_dims(v, axis) for v in first)) for axis in (1, 0)))
    i, j = np.triu_indices(60, k=1)
    apart = exact[i, j][(i > 0) & (exact[i, j] > 0)]
    assert (apart < 9.0).sum() > 64, "not all of them fit among the pairs that are compared first"
    assert pair_proximity(world, boxes, searched, 9.0) == pytest.approx(-apart.min(), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("agent", [1, 4, 8])
def test_one_mover_costs_what_it_costs_among_all_rows(agent):
    world, boxes, among = prepared(platoon(), [agent])
    alone = SearchedAgents.only(agent, world.valid.shape[0])
    mine, same = (total_cost(world, boxes, searched, KING) for searched in (alone, among))
    assert mine.ego == pytest.approx(float(same.ego), abs=1e-4)
    assert mine.pair == pytest.approx(float(same.pair), abs=1e-4)
    others = [i for i in range(1, 9) if i != agent]
    rest = sum(road_deviation(world, boxes, SearchedAgents.only(i, world.valid.shape[0])) for i in others)
    assert mine.road + rest == pytest.approx(float(same.road), abs=1e-4)


def test_leaving_the_road_costs_one_per_corner():
    world, boxes, searched = prepared(scene((0, 0, 10), (30, 3.2, 10)))
    assert road_deviation(world, boxes, searched) == pytest.approx(0, abs=0.05)
    off = jax.tree.map(lambda v: v, world.log)
    off = type(off)(off.x, off.y.at[1, 41:].add(100.0), off.yaw, off.speed)
    assert road_deviation(world, world.boxes(off), searched) == pytest.approx(4 * 40 / 81, abs=0.05)


def test_corners_that_began_off_the_road_are_left_out():
    world, boxes, searched = prepared(scene((0, 0, 10), (30, -1.2, 10)))
    assert road_deviation(world, boxes, searched) == pytest.approx(0, abs=0.1)


@eqx.filter_jit
def cost_along(amount, direction, world, searched):
    controls = jax.tree.map(lambda v, d: v + amount * 1e-3 * d, world.controls, direction)
    return total_cost(world, world.boxes(roll_out_background(world, controls)), searched, KING).total


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
def test_the_gradient_of_the_whole_cost_is_that_of_finite_differences(x64, seed):
    world, _, searched = prepared(platoon(seed=seed))
    world = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, world)
    direction = jax.tree.map(
        lambda v, s=seed: jnp.asarray(np.random.default_rng(s).normal(size=v.shape)), world.controls
    )

    def cost(amount):
        return cost_along(jnp.asarray(amount), direction, world, searched)

    check_grads(cost, (jnp.asarray(0.3),), order=1, modes=["rev"], eps=1e-5, rtol=1e-4)


@pytest.mark.slow
def test_masked_agents_send_no_gradient():
    world, _, searched = prepared(moving(platoon(), 4, valid=np.arange(81) < 3))

    def cost(controls):
        return total_cost(world, world.boxes(roll_out_background(world, controls)), searched, KING).total

    gradient = eqx.filter_jit(jax.grad(cost))(world.controls)
    assert np.abs(gradient.accel[4, 3:]).max() == 0
    assert all(np.isfinite(g).all() for g in jax.tree.leaves(gradient))


@pytest.mark.slow
def test_the_compiled_gradient_has_every_step_of_the_uncompiled_one():
    """A minimum that XLA computes twice and rounds differently once lost the gradient of every tenth step."""
    world, _, searched = prepared(scene((0, 0, 10), (20, 2.9, 9), (50, 3.2, 10)), [1])
    noise = 0.03 * np.random.default_rng(0).normal(size=(2, *world.controls.accel.shape)).astype(np.float32)
    controls = ControlArrays(world.controls.accel + 6.0 * noise[0], world.controls.curvature + 0.3 * noise[1])

    @eqx.filter_jit
    def moved(own):
        return world.boxes(with_ego(roll_out_background(world, own), jax.tree.map(lambda v: v[0], world.log)))

    @partial(eqx.filter_jit, compiler_options=COMPILER_OPTIONS | ALL_PASSES)
    def compiled(at):
        return jax.grad(lambda boxes: costs.total_cost(world, boxes, searched, KING).ego)(at)

    def one_by_one(at):
        """The gradient for the only candidate, uncompiled."""
        ego, adversary = (jax.tree.map(lambda v, row=row: v[row], at) for row in (0, 1))
        return jax.grad(lambda box: distance(ego, box).mean())(adversary)

    boxes = moved(controls)
    found, wanted = compiled(boxes), one_by_one(boxes)
    for name in ("x", "y", "cos", "sin"):
        mine, theirs = np.asarray(getattr(found, name))[1], np.asarray(getattr(wanted, name))
        assert mine == pytest.approx(theirs, abs=1e-3 * float(np.abs(theirs).max()))
