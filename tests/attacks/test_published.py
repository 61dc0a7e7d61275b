"""Each departure of the public code on a case that one can work out by hand."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import platoon, scene

from regents_cosim.attacks.accept import rules
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent import published
from regents_cosim.attacks.methods.presets import KING, METHODS, REGENTS
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.collisions import first_contact
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.bicycle import ControlArrays, Motion, roll_out
from regents_cosim.mirror.road_field import MARGIN_M
from regents_cosim.mirror.world import scene_origin, to_world
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.saving import save_unlisted

PUBLISHED = METHODS["regents-code"]
TAU_M = 1.25

# Compiled as a whole: op by op, every test would compile each of them alone.
pair_and_slope = eqx.filter_jit(
    lambda world, motion, allowed: jax.value_and_grad(
        lambda y: published.pair_proximity(world, replace(motion, y=y), allowed, TAU_M)
    )(motion.y)
)
ego_distance = eqx.filter_jit(published.ego_distance)
road_deviation = eqx.filter_jit(published.road_deviation)
total_cost = eqx.filter_jit(published.total_cost)
diverging_in_front = eqx.filter_jit(published.diverging_in_front)
candidates = eqx.filter_jit(published.candidates)
candidates_of_ours = eqx.filter_jit(rules.candidates)
stage = eqx.filter_jit(published.stage)
roll_out_published = eqx.filter_jit(published.roll_out_background)


def attack_one(scenario, config=PUBLISHED, planner="log_replay"):
    return next(attack([scenario], config, planner))


def with_valid(scenario, agent, valid):
    """`scenario` whose `agent` is recorded at some steps only."""
    tracks, mask = scenario.tracks, np.array(scenario.tracks.valid)
    mask[agent] = valid
    masked = {name: np.where(mask, getattr(tracks, name), 0.0) for name in ("x", "y", "yaw", "speed")}
    return replace(scenario, tracks=replace(tracks, valid=mask, **masked))


def chosen(world, *agents):
    return jnp.zeros(world.valid.shape[0], bool).at[jnp.array(agents)].set(True)


# --- which attack this is -----------------------------------------------------------------------


def test_the_code_is_a_method_of_its_own_with_the_settings_of_the_paper():
    assert replace(PUBLISHED, method="").compiled() != REGENTS.compiled()
    assert {**vars(PUBLISHED), "method": "regents"} == vars(REGENTS)


@pytest.mark.parametrize("ours", [{"search": "per-candidate"}, {"background": "reactive"}, {"softmin_m": 1.0}])
def test_what_was_never_published(ours):
    with pytest.raises(RegentsError, match="the public code has no soft minimum"):
        PUBLISHED.but(**ours)


# --- costs --------------------------------------------------------------------------------------


def test_the_ego_distance_is_squared_and_between_centres():
    world = to_world(with_valid(scene((0, 0, 10), (20, 0, 10), (30, 5, 10)), 1, np.arange(81) < 60))
    assert ego_distance(world, world.log, chosen(world, 1, 2)) == pytest.approx(400, rel=1e-5)
    assert ego_distance(world, world.log, chosen(world, 2)) == pytest.approx(925, rel=1e-5)


def test_the_ego_distance_averages_squares_over_logged_steps():
    world = to_world(with_valid(scene((0, 0, 10), (20, 0, 12)), 1, np.arange(81) < 41))
    expected = np.mean((20 + 0.2 * np.arange(41)) ** 2)
    assert ego_distance(world, world.log, chosen(world, 1)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("apart_m", "cost", "slope"), [(3.0, -(TAU_M**2), 0.0), (1.3, -(TAU_M**2), 0.0), (1.0, -1.0, 2.0)]
)
def test_pairs_do_not_repel_before_their_boxes_overlap(apart_m, cost, slope):
    """Cars are 1.8 m wide: at 1.3 m, side by side, they overlap by half a metre."""
    world = to_world(scene((0, 0, 10), (40, 0, 10), (40, 6.4, 10)))
    motion = replace(world.log, y=world.log.y.at[2, 50].set(world.log.y[1, 50] + apart_m))
    value, gradient = pair_and_slope(world, motion, chosen(world, 1, 2))
    assert value == pytest.approx(cost, abs=1e-5)
    assert gradient[1, 50] == pytest.approx(slope, abs=1e-5)
    assert np.count_nonzero(gradient) == (2 if slope else 0)


def test_one_candidate_makes_the_loss_nan():
    world = to_world(scene((0, 0, 10), (40, 0, 10), (40, 6.4, 10)))
    assert np.isnan(total_cost(world, world.log, chosen(world, 1), KING).total)


def test_the_road_is_read_in_one_square_and_transposed():
    world = to_world(scene((0, 0, 10), (60, 0, 10)))
    corner = np.asarray(world.road.corner)  # 12 m before the first car, and as far right of the road's middle lane

    def cost_at(along, up):
        x, y = corner[0] + along, corner[1] + up
        stands = Motion(
            *(v.at[1].set(to) for v, to in ((world.log.x, x), (world.log.y, y), (world.log.yaw, 0.0))), world.log.speed
        )
        return float(road_deviation(world, stands))

    assert cost_at(3.5, 13.5) == pytest.approx(4 * 81, rel=0.01), "on the road, counted as off it at every step"
    assert cost_at(13.5, 3.5) == pytest.approx(0, abs=0.03 * 4 * 81), "off the road, counted as on it"
    assert cost_at(3.5, 3.5) == pytest.approx(4 * 81, rel=0.01), "off the road on both readings"
    assert cost_at(40.0, 3.5) == 0, "off the road, but outside of the square"


# --- rules --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("yaw_deg", "bearing_deg", "red"), [(70, 10, True), (89, 10, True), (91, 10, False), (70, 23, False)]
)
def test_the_red_zone_is_four_times_as_wide_in_yaw_only(yaw_deg, bearing_deg, red):
    yaw, bearing, still = np.full(10, np.deg2rad(yaw_deg)), np.deg2rad(bearing_deg), np.zeros(10)
    rows = ((still, 20 * np.cos(bearing) + still), (still, 20 * np.sin(bearing) + still), (still, yaw), (still, still))
    motion = Motion(*(jnp.asarray(np.stack(pair), jnp.float32) for pair in rows))
    assert bool(diverging_in_front(motion)[1]) == red
    around = jax.tree.map(lambda values: values[0], motion)
    assert not rules.diverging_in_front(around, motion, jnp.ones((2, 10), bool))[1]


def test_fillers_count_as_places():
    """In the public code, a follower that leaves early and a parked car that appears late are candidates too."""
    made = scene((0, 0, 10), (-20, 0, 10), (100, 3.2, 0), (0, -100, 10))
    made = with_valid(with_valid(made, 1, np.arange(81) < 50), 2, np.arange(81) > 5)
    world = to_world(made)
    assert np.flatnonzero(candidates_of_ours(world, REGENTS)).tolist() == [3]
    assert np.flatnonzero(candidates(world, PUBLISHED)).tolist() == [1, 2, 3]
    brief = to_world(with_valid(made, 1, np.arange(81) < 30))
    assert not candidates(brief, PUBLISHED)[1], "half of the horizon, whatever was filled"


# --- motion -------------------------------------------------------------------------------------


def test_a_step_of_adam_moves_far_by_steering_and_hardly_by_accelerating():
    """The end point after 9 s at 7.4 m/s: 4 cm and 2.2 m, of which ReGentS takes half."""
    world = replace(to_world(scene((0, 0, 7.4), (50, 0, 7.4), (90, 6.4, 7.4))), dt=jnp.float32(9 / 80))
    logged = roll_out_published(world, ControlArrays(jnp.zeros((16, 80)), jnp.zeros((16, 80))))
    moved = []
    for config in (KING, REGENTS):
        step = published.in_physical_units(ControlArrays(jnp.float32(1e-3), jnp.float32(1e-3)), config)
        accel, curvature = step.accel * ACCEL_LIMIT, step.curvature * CURVATURE_LIMIT
        controls = ControlArrays(jnp.zeros((16, 80)).at[1].set(accel), jnp.zeros((16, 80)).at[2].set(curvature))
        motion = roll_out_published(world, controls)
        moved += [motion.x[1, -1] - logged.x[1, -1], motion.y[2, -1] - logged.y[2, -1]]
    assert moved == pytest.approx([0.0405, 2.22, 0.0405, 1.11], rel=0.02)


def test_braking_past_standstill_creeps_backwards():
    world = to_world(scene((0, 0, 10), (50, 0, 2)))
    controls = ControlArrays(jnp.zeros((16, 80)).at[1].set(-1.0), jnp.zeros((16, 80)))
    motion = roll_out_published(world, controls)
    assert motion.speed[1, [20, 80]] == pytest.approx([0.0, -6.0], abs=1e-4)
    assert motion.x[1, 80] - motion.x[1, 0] == pytest.approx(2 * 8 - 0.5 * 8**2, abs=1e-3)


def test_who_never_stops_moves_as_in_ours():
    world = to_world(platoon(cars=8))
    ours = roll_out(world.start, world.controls, world.moving, world.dt)
    theirs = roll_out_published(world, world.controls)
    for name in ("x", "y", "yaw", "speed"):
        assert np.asarray(getattr(theirs, name)) == pytest.approx(np.asarray(getattr(ours, name)), abs=1e-4)


def test_late_agents_never_join_their_log_and_ended_ones_drive_on():
    made = scene((0, 0, 10), (30, 0, 12), (60, 3.2, 10))
    made = with_valid(with_valid(made, 1, np.arange(81) < 50), 2, np.arange(81) >= 20)
    world = to_world(made)
    acted = stage(world)
    motion = roll_out_published(acted, acted.controls)
    assert np.asarray(motion.x[1]) == pytest.approx(float(world.log.x[1, 0]) + 1.2 * np.arange(81), abs=0.05), (
        "on and on"
    )
    tracks = made.tracks
    corner = [at[tracks.valid].min() for at in (tracks.x, tracks.y)] - scene_origin(made) - MARGIN_M
    reached = corner - 1 - 0.1 * np.arange(81)[:, None] * (np.cos(-1), np.sin(-1))  # at -1 m/s, heading -1 rad
    assert np.stack([motion.x[2], motion.y[2]], axis=1) == pytest.approx(reached, abs=0.1)
    assert acted.valid[:3].tolist() == [[True] * 81, [True] * 81, [False] * 20 + [True] * 61]
    assert (np.asarray(acted.controls.accel[1, 49:]) == 0).all()


# --- end to end ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "planner"),
    [("regents-code", "log_replay"), ("regents-code", "idm"), ("king-code", "log_replay")],
)
def test_it_attacks(method, planner):
    recorded = platoon(cars=8, seed=1)
    attacked = attack_one(recorded, METHODS[method], planner)
    record = attacked.attack
    assert record.outcome == "collision"
    assert record.method == method
    assert attacked.id == f"{recorded.id}-{method}-{planner}"
    agent, step = first_contact(attacked.agents, attacked.tracks)
    assert (attacked.agents[agent].id, step) == (record.collision.agent, record.collision.step)
    assert np.isfinite(list(record.cost_history.values())).all()
    assert {len(values) for values in record.cost_history.values()} == {record.iterations}


@pytest.mark.slow
def test_a_vehicle_hits_the_ego_after_its_log_ended():
    """The slow car ahead is recorded for 6 s; the ego would reach it after 6.7 s."""
    made = with_valid(scene((0, 0, 12), (38, 0, 7), (150, 6.4, 10)), 1, np.arange(81) < 60)
    assert first_contact(made.agents, made.tracks) is None
    attacked = attack_one(made, METHODS["king-code"])
    assert attacked.attack.outcome == "already_colliding"
    assert attacked.attack.collision.step == 67
    assert attacked.tracks.valid[1].all()
    assert not attacked.log.valid[1, 60:].any()


@pytest.mark.slow
def test_hits_by_others_do_not_stop_the_search():
    """A follower that may not attack runs into the ego, which brakes for the car ahead."""
    attacked = attack_one(scene((0, 0, 12), (25, 0, 4), (-8, 0, 12), (250, 6.4, 15)), planner="idm")
    agent, _ = first_contact(attacked.agents, attacked.tracks)
    assert (agent, attacked.attack.candidates) == (2, ("car01", "car03"))
    assert (attacked.attack.outcome, attacked.attack.iterations) == ("no_collision", 500)


@pytest.mark.slow
def test_one_candidate_diverges_and_can_be_saved(tmp_path):
    attacked = attack_one(scene((0, 0, 10), (15, 3.2, 9)))
    assert attacked.attack.outcome == "diverged"
    assert content_hash(load_case(save_unlisted(attacked, tmp_path))) == content_hash(attacked)


@pytest.mark.slow
def test_no_candidate_is_an_outcome():
    assert attack_one(scene((0, 0, 10), (-20, 0, 10), (30, 3.2, 0))).attack.outcome == "no_candidate"
