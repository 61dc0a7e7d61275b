from dataclasses import replace

import jax
import numpy as np
import pytest
from scenes import absent, platoon, scene

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.attack import attack, attack_each
from regents_cosim.attacks.methods.presets import KING, METHODS, REGENTS, REGENTS_FOCUSED
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.checks.ranges import Range
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario.collisions import first_contact


def attack_one(scenario, config=REGENTS, planner="log_replay"):
    return next(attack([scenario], config, planner))


def test_a_collision_is_found_and_confirmed_by_the_exact_boxes():
    recorded = platoon()
    attacked = attack_one(recorded)
    assert first_contact(recorded.agents, recorded.tracks) is None
    found = attacked.collision
    assert attacked.attack.outcome == "collision"
    agent, step = first_contact(attacked.agents, attacked.tracks)
    assert (attacked.agents[agent].id, step) == (found.agent, found.step)
    assert attacked.agents[agent].role == "adversary"
    assert [a.role for a in attacked.agents].count("adversary") == 1
    assert found.time_s == pytest.approx(found.step * 0.1)
    assert found.attributed


def test_the_log_is_kept():
    recorded = platoon()
    attacked = attack_one(recorded)
    assert content_hash(attacked.before_attack()) != content_hash(attacked)
    assert np.array_equal(attacked.log.x, recorded.tracks.x)


@pytest.mark.slow
def test_controls_stay_within_the_limits_and_non_candidates_keep_theirs():
    recorded = platoon()
    attacked = attack_one(recorded, REGENTS.but(learning_rate=0.05))
    assert np.abs(attacked.tracks.accel).max() <= ACCEL_LIMIT
    assert np.abs(attacked.tracks.curvature).max() <= CURVATURE_LIMIT
    ahead = scene((0, 0, 10), (-20, 0, 10), (25, 3.2, 10), (200, 0, 0))
    changed = attack_one(ahead)
    deviation = np.hypot(changed.tracks.x - ahead.tracks.x, changed.tracks.y - ahead.tracks.y).max(axis=1)
    assert deviation[[0, 1, 3]] == pytest.approx(0, abs=0.02)
    assert deviation[2] > 0.3


def test_the_cost_history_has_a_value_per_iteration_and_goes_down():
    history = attack_one(platoon()).attack
    assert {len(values) for values in history.cost_history.values()} == {history.iterations}
    assert history.cost_history["ego"][-1] < history.cost_history["ego"][0]


@pytest.mark.slow
@pytest.mark.parametrize("config", [KING, REGENTS])
@pytest.mark.parametrize("planner", ["log_replay", "constant_velocity", "idm"])
def test_every_preset_attacks_every_planner(config, planner):
    record = attack_one(platoon(seed=1), config, planner).attack
    assert record.outcome == "collision"
    assert (record.method, record.planner) == (config.method, planner)


def test_no_candidate():
    record = attack_one(scene((0, 0, 10), (-20, 0, 10), (30, 3.2, 0))).attack
    assert (record.outcome, record.iterations) == ("no_candidate", 0)


def test_already_colliding():
    record = attack_one(scene((0, 0, 10), (20, 0, 4), (30, 3.2, 10))).attack
    assert (record.outcome, record.iterations) == ("already_colliding", 0)
    assert record.collision.agent == "car01"
    assert not record.collision.attributed


def test_overlaps_of_the_log_are_no_success():
    made = scene((0, 0, 10), (2, 0, 10), (150, 3.2, 10))
    record = attack_one(made, REGENTS.but(iterations=3)).attack
    assert record.outcome == "no_collision"


def test_no_collision_when_the_iterations_are_spent():
    record = attack_one(scene((0, 0, 10), (150, 3.2, 10)), REGENTS.but(iterations=5)).attack
    assert (record.outcome, record.iterations) == ("no_collision", 5)


def test_one_candidate_is_enough():
    assert attack_one(scene((0, 0, 10), (15, 3.2, 9))).attack.outcome == "collision"


@pytest.mark.slow
def test_numbers_that_blow_up_cost_this_scenario_only(monkeypatch):
    monkeypatch.setattr(Range, "check", lambda *_: None)  # which refuses such a number by name
    absurd = REGENTS.but(learning_rate=float("nan"))
    outcomes = [s.attack.outcome for s in attack([scene((0, 0, 10), (20, 3.2, 9))], absurd, "log_replay")]
    assert outcomes == ["diverged"]


def test_the_same_input_gives_the_same_bits_in_any_batch_and_order():
    scenes = [platoon(seed=seed) for seed in range(3)]
    alone = [content_hash(attack_one(s)) for s in scenes]
    together = [content_hash(s) for s in attack(scenes, REGENTS, "log_replay", batch=2)]
    backwards = [content_hash(s) for s in attack(scenes[::-1], REGENTS, "log_replay", batch=32)]
    assert alone == together == backwards[::-1]


def test_agents_that_come_late_or_leave_early_are_absent_everywhere():
    made = absent(platoon(), (2, slice(30)), (4, slice(50, None)))
    attacked = attack_one(made)
    assert np.array_equal(attacked.tracks.valid, made.tracks.valid)
    assert (attacked.tracks.x[~made.tracks.valid] == 0).all()


def test_an_attacked_case_is_not_attacked_again():
    attacked = attack_one(platoon())
    with pytest.raises(RegentsError, match="attacked already"):
        attack_one(attacked)


@pytest.mark.slow
def test_a_search_per_candidate_finds_every_adversary_once():
    recorded = platoon()
    results = list(attack([recorded], FOCUSED_COST, "log_replay"))
    adversaries = [s.collision.agent for s in results]
    assert len(adversaries) > 1
    assert len(set(adversaries)) == len(adversaries)
    assert len({s.id for s in results}) == len(results)
    for found in results:
        assert found.attack.case == recorded.id
        assert len(found.attack.candidates) == 1
        changed = np.hypot(found.tracks.x - recorded.tracks.x, found.tracks.y - recorded.tracks.y).max(axis=1) > 0.3
        assert changed.sum() <= 3, "the adversary, and who had to brake for it"


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["threads", pytest.param("batched", marks=pytest.mark.slow)])
def test_where_one_adversary_is_enough_it_is_the_first_of_all(engine):
    empty = replace(scene((0, 0, 10)), id="empty")
    recorded = [platoon(), empty, replace(platoon(), id="again")]
    some = FOCUSED_COST.but(nearest=3, iterations=150)
    every, one = (
        list(attack_each(recorded, some.but(adversaries=wanted), "log_replay", engine=engine))
        for wanted in ("all", "one")
    )
    for all_, (first,) in zip(every, one, strict=True):
        same = {case.id: case for case in all_}[first.id]
        assert first.attack.outcome == same.attack.outcome
        np.testing.assert_allclose(first.tracks.x, same.tracks.x, atol=1e-3)  # lanes of another number round elsewhere
    assert [len(cases) for cases in every] == [len(every[0]), 1, len(every[0])]
    assert len(every[0]) > 1


@pytest.mark.slow
def test_where_one_adversary_is_enough_none_is_tried_after_it():
    tried = []

    def wish(world, motion, controls):
        jax.debug.callback(tried.append, controls.accel[1, 0])
        return 0.0

    few = FOCUSED_COST.but(iterations=500, nearest=3)
    for wanted in ("one", "all"):
        list(attack([platoon()], few.but(adversaries=wanted), "log_replay", extra_cost=wish))
        tried.append(wanted)
    assert 0 < tried.index("one") < tried.index("all") - tried.index("one") - 1


@pytest.mark.slow
def test_a_search_per_candidate_without_success_gives_one_result():
    far = scene((0, 0, 10), (90, 6.4, 10), (95, 3.2, 10))
    few = REGENTS_FOCUSED.but(iterations=2)
    (result,) = attack([far], few, "log_replay")
    assert result.attack.outcome == "no_collision"
    (result,) = attack([scene((0, 0, 10))], few, "log_replay")
    assert result.attack.outcome == "no_candidate"
    (result,) = attack([scene((0, 0, 10), (20, 0, 4), (30, 3.2, 10))], few, "log_replay")
    assert result.attack.outcome == "already_colliding"


@pytest.mark.slow
def test_a_blind_follower_counts_as_not_attributed_and_a_reacting_one_brakes():
    """The ego brakes for the car ahead, which the attack slows down, while another car follows closely."""
    made = scene((0, 0, 12), (30, 0, 12), (-9, 0, 12), (-22, 0, 12))
    slow = REGENTS.but(method="slow", pair_weight=0.0)
    blind = next(attack([made], slow, "idm")).attack
    reactive = next(attack([made], slow.but(background="reactive"), "idm")).attack
    assert blind.collision is not None
    assert not blind.collision.attributed
    assert reactive.collision is None or reactive.collision.attributed


@pytest.mark.slow
def test_a_trust_region_keeps_actions_near_the_log():
    recorded = platoon()
    bound = REGENTS.but(learning_rate=0.02, max_deviation=0.01, iterations=60)
    near = attack_one(recorded, bound)
    free = attack_one(recorded, bound.but(max_deviation=0.0))
    logged = to_world(recorded).controls
    for attacked, most in ((near, 0.01), (free, 1.0)):
        accel = np.abs(attacked.tracks.accel[1:] - np.asarray(logged.accel)[1:9]).max() / ACCEL_LIMIT
        curvature = np.abs(attacked.tracks.curvature[1:] - np.asarray(logged.curvature)[1:9]).max() / CURVATURE_LIMIT
        assert max(accel, curvature) <= most + 1e-5
    assert max(accel, curvature) > 0.01


@pytest.mark.slow
def test_lateral_acceleration_is_bounded():
    recorded = scene((0, 0, 10), (60, 6.4, 10), (90, 3.2, 10))
    wild = REGENTS.but(learning_rate=0.02, iterations=4)
    for config, bounded in ((wild, False), (wild.but(max_lateral_accel=0.5), True)):
        tracks = attack_one(recorded, config).tracks
        lateral = np.abs(tracks.curvature[1:]) * (0.5 * (tracks.speed[1:, :-1] + tracks.speed[1:, 1:])) ** 2
        assert (lateral.max() < 0.5 * 1.01) == bounded


@pytest.mark.slow
def test_an_extra_cost_is_heard():
    def hurry(world, motion, controls):
        return -1000.0 * motion.speed[1:].mean()

    recorded = scene((0, 0, 10), (60, 6.4, 10), (90, 3.2, 10))
    few = REGENTS.but(iterations=30)
    plain, hurried = (next(attack([recorded], few, "log_replay", extra_cost=e)) for e in (None, hurry))
    assert plain.tracks.speed[1, -1] < 10 < hurried.tracks.speed[1, -1]


@pytest.mark.slow
def test_the_gradient_may_pass_through_the_planner():
    config = REGENTS.but(gradient="through-planner")
    assert attack_one(platoon(seed=1), config, "idm").attack.outcome == "collision"
    with pytest.raises(RegentsError, match="reactions are not differentiated"):
        config.but(background="reactive")


def test_king_is_regents_without_its_rules():
    rules = {"method", "cancel_front_steering", "exclude_rear", "exclude_static"}
    king, regents = KING.settings, METHODS["regents"].settings
    assert {name for name in king if king[name] == regents[name]} == set(king) - rules


def test_who_is_searched_and_how_often_needs_no_other_program():
    fewer = REGENTS_FOCUSED.but(method="mine", iterations=7, nearest=1, starts=0, attempts=1, exclude_rear=False)
    assert fewer.compiled() == REGENTS_FOCUSED.compiled()
    assert REGENTS_FOCUSED.compiled() != REGENTS_FOCUSED.but(pair_weight=1.0).compiled()
