from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import moving, scene

from regents_cosim.attacks.accept.rules import candidates, diverging_in_front, mostly_behind
from regents_cosim.attacks.candidates import candidates_of
from regents_cosim.attacks.engines import by_program
from regents_cosim.attacks.methods.presets import KING, REGENTS
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.blind import LogReplay
from regents_cosim.scenario.collisions import find_overlaps

EIGHTH = np.pi / 8


def chosen(scenario, config):
    return np.flatnonzero(candidates(to_world(scenario), config)).tolist()


def test_king_takes_every_vehicle():
    assert chosen(scene((0, 0, 10), (-20, 0, 10), (20, 0, 0), (30, 3.2, 10)), KING) == [1, 2, 3]


def test_regents_leaves_out_those_behind_and_those_that_stand():
    assert chosen(scene((0, 0, 10), (-20, 0, 10), (20, 0, 0), (30, 3.2, 10)), REGENTS) == [3]


def test_pedestrians_are_no_candidates():
    made = scene((0, 0, 10), (20, 0, 10), (30, 3.2, 10))
    agents = (*made.agents[:2], replace(made.agents[2], kind="pedestrian"))
    assert chosen(replace(made, agents=agents), KING) == [1]


def test_agents_are_there_for_at_least_half_of_the_horizon():
    made = scene((0, 0, 10), (20, 0, 10), (30, 3.2, 10))
    assert chosen(moving(made, 1, valid=np.arange(81) < 40), KING) == [2]
    assert chosen(moving(made, 1, valid=np.arange(81) < 41), KING) == [1, 2]


def test_agents_that_overlap_the_ego_from_the_start_are_no_candidates():
    assert chosen(scene((0, 0, 10), (2, 0, 10), (30, 3.2, 10)), KING) == [2]


def test_who_collides_in_the_log_is_no_candidate():
    made = scene((0, 0, 10), (20, 3.2, 10), (40, 0, 8), (60, 0, 5))
    made = replace(made, overlaps=find_overlaps(made.agents, made.tracks))
    (one,) = candidates_of(AttackSetup(KING, LogReplay(), "log_replay", None), made, by_program)
    assert np.flatnonzero(one.job.searched.candidate).tolist() == [1]


@pytest.mark.parametrize(
    ("degrees", "behind"), [(0, True), (22, True), (-22, True), (23, False), (-23, False), (180, False)]
)
def test_the_rear_sector_is_45_degrees_wide(degrees, behind):
    angle = np.pi + np.deg2rad(degrees)
    made = scene((0, 0, 10), (30 * np.cos(angle), 30 * np.sin(angle), 10))
    assert bool(mostly_behind(to_world(made))[1]) == behind


def test_the_rear_sector_turns_with_the_ego():
    made = scene((0, 0, 10), (0, 20, 10), (-20, 0, 10))
    north = {"x": made.tracks.x[:, :1] + 0 * made.tracks.x, "y": made.tracks.y + made.tracks.x - made.tracks.x[:, :1]}
    turned = replace(made, tracks=replace(made.tracks, **north, yaw=np.full((3, 81), -np.pi / 2)))
    # all drive north in the log, but the ego looks south: who is north of it is behind it
    assert mostly_behind(to_world(turned))[:3].tolist() == [False, True, False]


def test_behind_for_more_than_the_share_of_the_valid_steps():
    overtaking = scene((0, 0, 10), (-20, 0, 14))  # alongside after 5 s = 50 of 81 steps
    assert not mostly_behind(to_world(overtaking))[1]
    early = moving(overtaking, 1, valid=np.arange(81) < 45)
    assert mostly_behind(to_world(early))[1]


def red(dyaw, dalpha, share=1.0, valid=None):
    """Agent 1 at bearing `dalpha`, turned by `dyaw`, for `share` of ten steps; else straight ahead."""
    inside = np.arange(10) < round(10 * share)
    bearing, yaw = np.where(inside, dalpha, 0.0), np.where(inside, dyaw, 0.0)
    ego = np.zeros(10)
    x, y = 20 * np.cos(bearing), 20 * np.sin(bearing)
    motion = Motion(*(jnp.asarray(np.stack([ego, v]), jnp.float32) for v in (x, y, yaw, ego)))
    mask = jnp.ones((2, 10), bool) if valid is None else jnp.asarray(np.stack([np.ones(10, bool), valid]))
    around = jax.tree.map(lambda v: v[0], motion)
    return bool(diverging_in_front(around, motion, mask)[1])


@pytest.mark.parametrize("side", [1, -1])
def test_the_red_zone_is_ahead_to_one_side_and_turned_away_to_it(side):
    assert red(0.3 * side, 0.1 * side)
    assert not red(0.3 * side, -0.1 * side), "turned to the other side: it converges"
    assert not red(0.1 * side, 0.3 * side), "turned less than it is offset"
    assert not red(0.0, 0.1 * side), "not turned"
    assert not red(0.3 * side, 0.0), "straight ahead"


@pytest.mark.parametrize("side", [1, -1])
def test_bounds_of_the_red_zone(side):
    just, over = 0.99 * EIGHTH, 1.01 * EIGHTH
    assert red(just * side, 0.2 * side)
    assert not red(over * side, 0.2 * side), "yaw beyond pi/8"
    assert red(just * side, 0.9 * just * side)
    assert not red(2 * EIGHTH * side, over * side), "bearing beyond pi/8"


def test_it_takes_more_than_half_of_the_valid_steps():
    assert not red(0.3, 0.1, share=0.5)
    assert red(0.3, 0.1, share=0.6)
    assert red(0.3, 0.1, share=0.5, valid=np.arange(10) < 8)
