"""Pedestrians and cyclists who attack: which of them may, within which bounds, and what they find."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_drives import driven_in
from scenes import TIME, crash, scene
from walkers import as_kind, moved_through, walked

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.accept.acceptance import ego_contacts, is_clean
from regents_cosim.attacks.accept.rules import candidates
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.attacked_cases import failed_case
from regents_cosim.attacks.descent.actions import allowed, to_actions, to_controls
from regents_cosim.attacks.descent.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING, REGENTS, REGENTS_FOCUSED, preset
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.attacks.starts.timed_drives import starts
from regents_cosim.cli.options import SearchOptions
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.mirror.bicycle import TURN_PACE_M_S, ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import MOST_SPEED_M_S
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.handling import handling
from regents_cosim.verdicts.ordinary import CYCLIST, PEDESTRIAN, ordinary


def street():
    """The ego, a car and a cyclist ahead of it, and a pedestrian that walks along the kerb."""
    made = as_kind(scene((0, 0, 10), (40, 3.2, 9), (45, 0.0, 5), (50, 0, 0)), 2, "bicycle")
    return walked(made, 3, 35.0 + 1.3 * TIME, 0 * TIME - 3.0)


def chosen(config):
    return np.flatnonzero(candidates(to_world(street()), config)).tolist()


@pytest.mark.slow
def test_who_may_attack():
    assert chosen(REGENTS_FOCUSED) == [1, 2, 3]
    assert chosen(KING) == chosen(REGENTS) == [1]
    assert chosen(preset("focused", adversary_kinds=("cyclist",))) == [2]
    assert chosen(preset("regents", adversary_kinds=("pedestrian", "vehicle"))) == [1, 3]


def test_the_option_names_kinds():
    assert SearchOptions(adversary_kinds="cyclist, pedestrian").config().candidates.adversary_kinds == (
        "cyclist",
        "pedestrian",
    )
    assert SearchOptions().config().candidates.adversary_kinds == ("vehicle", "cyclist", "pedestrian")
    assert SearchOptions(method="king").config().candidates.adversary_kinds == ("vehicle",)


@pytest.mark.parametrize("kinds", ["dog", "", "vehicle,vehicle"])
def test_kinds_that_there_are_not(kinds):
    with pytest.raises(RegentsError, match="expected one or more of vehicle,cyclist,pedestrian, each once"):
        SearchOptions(adversary_kinds=kinds).config()


def test_a_case_without_pedestrians_and_cyclists_does_not_say_who_might_have_attacked():
    def said(made, config=REGENTS_FOCUSED):
        return failed_case(AttackSetup(config, None, "idm", None), made, DriveError("fails", "")).attack.settings

    assert "adversary_kinds" not in said(scene((0, 0, 10), (30, 0, 10)))
    assert "adversary_kinds" not in said(street(), KING)
    assert said(street())["adversary_kinds"] == "vehicle,cyclist,pedestrian"


# --- bounds --------------------------------------------------------------------------------------


def bounded(config=REGENTS_FOCUSED):
    made = street()
    return with_bounds(to_world(made), made, config, limits_by_kind(made, config))


WALKED = ("x", "y", "yaw", "speed")


def assert_walks_like_people(felt):
    """Check that no motion exceeds what was recorded of people, measured in the same way."""
    for one in felt:
        assert one.accel.max() <= PEDESTRIAN.accel
        assert one.accel.min() >= -PEDESTRIAN.braking
        assert one.aside.max() <= PEDESTRIAN.lateral_accel
        assert np.abs(one.jerk).max() <= PEDESTRIAN.jerk


@compiled
def _held(world, actions):
    searched = SearchedAgents.among(jnp.arange(world.valid.shape[0]) > 0)
    held = to_controls(allowed(actions, to_actions(world.controls), world, searched, FOCUSED_COST))
    return held, roll_out_background(world, held)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_whatever_a_search_asks_for_people_move_like_people(seed):
    world = bounded(FOCUSED_COST)
    rng = np.random.default_rng(seed)
    wild = ControlArrays(*(jnp.asarray(rng.uniform(-1, 1, world.controls.accel.shape), jnp.float32) for _ in range(2)))
    held, motion = _held(world, wild)
    for agent, kind in ((2, "bicycle"), (3, "pedestrian")):
        assert float(motion.speed[agent].max()) <= MOST_SPEED_M_S[kind] + 1e-3
    assert np.all(np.abs(held.curvature[3]) * TURN_PACE_M_S <= PEDESTRIAN.lateral_accel)
    walk = Tracks(*(np.asarray(getattr(motion, name)[3:4], float) for name in WALKED), valid=np.ones((1, 81), bool))
    assert_walks_like_people(handling(walk, 0, 0.1, 81))


def test_those_who_are_slower_keep_to_their_bounds_however_vehicles_drive():
    bounds = bounded(FOCUSED_COST).bounds
    assert float(bounds.braking[2]) == CYCLIST.braking
    assert 0.99 * PEDESTRIAN.accel < float(bounds.accel[3]) < PEDESTRIAN.accel
    assert float(bounds.braking[1]) > 100.0
    assert bounded(KING).bounds is None


def test_a_crowd_that_turns_on_the_spot_excuses_no_one_on_foot():
    many = scene((0, 0, 10), *((10.0 * i, 0, 1.4) for i in range(10)))
    for agent in range(1, 11):
        x = 10.0 * agent + np.cumsum(0.14 * (np.arange(81) // 10 % 2))
        many = walked(many, agent, x, np.cumsum(0.14 * (np.arange(81) // 10 % 2 == 0)))
    assert ordinary(many, "pedestrian") == PEDESTRIAN


def test_who_walks_harder_than_people_may_until_it_leaves_its_log():
    world = bounded()
    turns = np.asarray(world.controls.curvature).copy()
    turns[3, [10, 60]] = 0.2
    world = replace(world, controls=replace(world.controls, curvature=jnp.asarray(turns)))
    asked = to_actions(world.controls)
    asked = replace(asked, accel=asked.accel.at[3, 40:].set(0.1))
    held, _ = _held(world, asked)
    assert float(held.curvature[3, 10]) == pytest.approx(0.2)
    assert float(held.curvature[3, 60]) * TURN_PACE_M_S < PEDESTRIAN.lateral_accel


def test_what_the_log_does_is_always_allowed():
    world = bounded()
    held, _ = _held(world, to_actions(world.controls))
    for name in ("accel", "curvature"):
        assert getattr(held, name)[1:] == pytest.approx(np.asarray(getattr(world.controls, name))[1:], abs=1e-5)


# --- what they find ------------------------------------------------------------------------------


def test_starts_of_a_pedestrian_meet_the_ego_where_it_crosses_its_way():
    made = street()
    ego = replace(made.tracks, **{n: getattr(made.tracks, n)[:1] for n in ("x", "y", "yaw", "speed", "valid", "z")})
    found = starts(made, 3, ego, 12, PEDESTRIAN)
    assert found
    for one in found:
        assert np.hypot(one.x[0] - 35.0, one.y[0] + 3.0) < 1e-6, "it begins where it is seen"
        assert one.speed.max() <= MOST_SPEED_M_S["pedestrian"] + 1e-6
        assert abs(one.x[one.meets] - 10.0 * TIME[one.meets]) < 4.0


@pytest.mark.slow
def test_a_pedestrian_walks_in_front_of_the_ego():
    made = walked(scene((0, 0, 8), (50, 0, 0)), 1, 40.0 - 1.3 * TIME, 0 * TIME - 3.0)
    (found,) = attack([made], FOCUSED_COST.but(iterations=300), "log_replay")
    assert found.attack.outcome == "collision"
    assert found.collision.collision_type == "person_by_front"
    assert flaws(found) == ()
    assert found.tracks.speed[1].max() <= MOST_SPEED_M_S["pedestrian"] + 1e-3


# --- on the device as on the host ----------------------------------------------------------------


@compiled
def _accepted(world, driven, searched):
    boxes = world.boxes(driven)
    hits = ego_contacts(world, boxes)
    return is_clean(world, searched, driven, boxes, hits)


@pytest.mark.slow
def test_the_device_accepts_what_the_host_calls_clean():
    """Pedestrians that cross, stand, run into the side or the rear, at any angle."""
    rng = np.random.default_rng(0)
    made = walked(scene((0, 0, 8), (80, 6.4, 0)), 1, 0 * TIME + 30.0, 0 * TIME - 4.0)
    world = to_world(made)
    searched, verdicts = SearchedAgents.only(1, len(world.valid)), []
    while len(verdicts) < 60:
        way, speed, stops_s = rng.uniform(0, np.pi), rng.uniform(0.3, 2.9), rng.choice([rng.uniform(1.0, 6.0), 9.0])
        gone = speed * np.minimum(TIME, stops_s)
        x = 30.0 + rng.uniform(-15, 15) + gone * np.cos(way)
        tracks = moved_through(made, 1, x, rng.uniform(-5.0, -1.6) + gone * np.sin(way))
        if first_contact(made.agents, tracks) is None:
            continue
        spoilt = bool(flaws(crash(made, tracks)))
        verdicts.append((spoilt, bool(_accepted(world, driven_in(world, made, tracks), searched))))
    assert not [1 for spoilt, accepted in verdicts if spoilt and accepted]
    clean = [accepted for spoilt, accepted in verdicts if not spoilt]
    assert sum(clean) >= 0.9 * len(clean) > 0
