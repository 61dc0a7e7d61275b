"""One adversary against several planners, and planners among each other's adversaries."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scenes import platoon, scene

from regents_cosim.attacks.actions import to_actions
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.presets import KING, REGENTS
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.attacks.universal import AttackedPlanners, UniversalDescent
from regents_cosim.benchmarks.cross import among_adversaries, cross_rows
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.collisions import first_contact
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.rollout import EgoTrack, FixedEgo
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.replays.mirror import MirrorController

PLANNERS = ("constant_velocity", "log_replay")


class OnItsTrack(FixedEgo, JaxPlanner):
    """A planner whose ego stays on the track that is its memory."""


@pytest.fixture(scope="module", params=["mean", pytest.param("worst", marks=pytest.mark.slow)])
def attacked(request):
    config = replace(REGENTS, universal=request.param)
    return next(attack([platoon(seed=1)], config, PLANNERS[0], also_crash=PLANNERS[1:]))


@pytest.mark.slow
def test_one_adversary_makes_all_of_them_crash(attacked):
    record = attacked.attack
    assert (record.outcome, record.planner) == ("collision", PLANNERS[0])
    assert record.against == PLANNERS[1:]
    assert record.crashed == PLANNERS
    for name in PLANNERS:
        with MirrorController(name) as driver:
            tracks = driver.drive(among_adversaries(attacked)).tracks
        assert first_contact(attacked.agents, tracks) is not None


@pytest.mark.slow
def test_a_second_planner_that_is_the_first_changes_nothing():
    """The mean of two equal costs is the cost: the search goes the same way."""
    twin = "regents_cosim.planners.log_replay:LogReplay"
    one = next(attack([platoon(seed=1)], REGENTS, "log_replay"))
    both = next(attack([platoon(seed=1)], REGENTS, "log_replay", also_crash=[twin]))
    assert both.attack.collision.agent == one.attack.collision.agent
    assert both.attack.iterations == pytest.approx(one.attack.iterations, abs=1)
    assert np.abs(both.tracks.x - one.tracks.x).max() < 0.05


@pytest.mark.parametrize("how", ["mean", "worst"])
@pytest.mark.slow
def test_the_gradient_is_that_of_finite_differences(x64, how):
    world = to_world(scene((0, 0, 10), (20, 2.9, 9), (50, 3.2, 10)))
    world = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, world)
    here = EgoTrack(*jax.tree.map(lambda v: v[0], (world.log, world.controls)))
    there = replace(here, motion=replace(here.motion, x=here.motion.x + 3.0, y=here.motion.y + 0.4))
    searched = SearchedAgents.among(jnp.arange(world.valid.shape[0]) == 1)
    several = AttackedPlanners((OnItsTrack(), OnItsTrack()), ("here", "there"))
    descent = UniversalDescent.of(world, several, (here, there), searched, replace(KING, universal=how))
    rng = np.random.default_rng(0)
    moves = searched.candidate[:, None]
    direction = jax.tree.map(lambda v: jnp.where(moves, jnp.asarray(rng.normal(size=v.shape)), 0.0), world.controls)

    def actions(amount):
        return jax.tree.map(lambda v, d: v + amount * 1e-3 * d, to_actions(world.controls), direction)

    @jax.custom_vjp
    def total(amount):
        return value(amount)[0]

    @jax.jit
    def value(amount):
        at = actions(amount)
        cost, _, gradient = descent.gradient(at, descent.look(at, descent.unseen()))
        return cost, 1e-3 * (
            (gradient.accel * direction.accel).sum() + (gradient.curvature * direction.curvature).sum()
        )

    total.defvjp(lambda amount: value(amount), lambda slope, g: (g * slope,))
    check_grads(total, (jnp.asarray(0.3),), order=1, modes=["rev"], eps=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_who_collides_in_the_log_is_said_before_any_search():
    """The planner that keeps its speed runs into the queue, while the log brakes before it."""
    made = scene((0, 0, 10), (60, 0, 0), (90, 3.2, 10))
    time = 0.1 * np.arange(81)
    speed = np.maximum(10 - 2.0 * time, 0.0)
    x = np.array(made.tracks.x)
    x[0] = np.concatenate([[0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))])
    speeds = np.array(made.tracks.speed)
    speeds[0] = speed
    braking = replace(made, tracks=replace(made.tracks, x=x, speed=speeds))
    found = next(attack([braking], replace(REGENTS, iterations=3), "log_replay", also_crash=["constant_velocity"]))
    assert found.attack.outcome == "already_colliding"
    assert found.attack.crashed == ("constant_velocity",)


def test_planners_that_cannot_be_attacked_together():
    def refused(message, planner="idm", against=("log_replay",), config=REGENTS):
        with pytest.raises(RegentsError, match=message):
            next(attack([platoon()], config, planner, also_crash=against))

    refused("'sumo' is not in JAX", against=("sumo",))
    refused("expected each of them once", against=("idm",))
    refused("leave out --as-published", config=replace(REGENTS, as_published=True))
    refused("leave out --as-published and --replan-every", config=replace(REGENTS, replan_every=5))


def test_a_single_planner_leaves_no_word_of_several():
    plain = next(attack([platoon(seed=1)], replace(REGENTS, iterations=1), "log_replay")).attack
    assert "universal" not in plain.settings
    assert (plain.against, plain.crashed, plain.promised) == ((), None, None)


@pytest.mark.slow
def test_the_ego_of_another_planner_does_not_follow_the_one_that_crashed(attacked):
    other = among_adversaries(attacked)
    assert np.array_equal(other.tracks.x[0], attacked.log.x[0])
    assert np.array_equal(other.tracks.x[1:], attacked.tracks.x[1:])
    assert content_hash(other.before_attack()) == content_hash(attacked.before_attack())


@pytest.mark.slow
def test_planners_crash_among_the_adversaries_that_were_found_for_them():
    windows = [platoon(seed=1), replace(scene((0, 0, 10), (20, 0, 4), (30, 3.2, 10)), id="queue")]
    found = {name: list(attack(windows, REGENTS, name)) for name in PLANNERS}
    rows = {(row.adversaries_of, row.planner): row for row in cross_rows(found, PLANNERS)}
    assert set(rows) == {(a, b) for a in PLANNERS for b in (*PLANNERS, "all")}
    for name in PLANNERS:
        own = rows[name, name]
        assert (own.n, own.crashes, own.windows) == (1, 1, 1), "who collides in the log is left out"
        assert rows[name, "all"].crashes == min(rows[name, other].crashes for other in PLANNERS)
