"""What the descent is compared with: searches without gradients, and SUMO's own drivers at their most dangerous."""

import numpy as np
import pytest
from scenes import scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import METHODS, RANDOM, REGENTS_FOCUSED, BySampling
from regents_cosim.attacks.sampling.sampled_search import AtRandom, ByEvolution
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.scores import rollouts_at_most
from regents_cosim.scenario.collisions import first_contact

BLIND = [method for method in METHODS.values() if isinstance(method, BySampling)]


@pytest.mark.slow
@pytest.mark.parametrize("config", BLIND, ids=lambda config: config.method)
def test_a_blind_search_finds_collisions_and_finds_them_again(config):
    unbound = {"accept": "any", "adversary_may": "anything", "driving": "any", "starts": 0}
    few = config.but(iterations=60, nearest=1, **unbound)
    leader = scene((0, 0, 10), (18, 0, 10))  # braking alone makes it a crash, steering alone too
    first, again = (list(attack([leader], few, "log_replay")) for _ in range(2))
    assert any(case.attack.outcome == "collision" for case in first)
    for one, other in zip(first, again, strict=True):
        assert one.attack == other.attack
        assert np.array_equal(one.tracks.x, other.tracks.x)
        if one.collision:
            agent, step = first_contact(one.agents, one.tracks)
            assert (one.agents[agent].id, step) == (one.collision.agent, one.collision.step)
            assert 1 <= one.attack.iterations <= 60
            assert len(one.attack.cost_history["ego"]) == one.attack.iterations


@pytest.mark.parametrize("config", BLIND, ids=lambda config: config.method)
def test_a_blind_search_has_as_many_roll_outs_as_our_preset(config):
    assert rollouts_at_most(config) == rollouts_at_most(REGENTS_FOCUSED)


@pytest.mark.slow
def test_a_blind_search_spends_its_roll_outs_and_no_more():
    few = RANDOM.but(iterations=10, nearest=1)
    far = [(200 + 20 * i, 6.4, 10) for i in range(2)]
    (missed,) = attack([scene((0, 0, 10), *far)], few, "log_replay")
    assert (missed.attack.outcome, missed.attack.iterations) == ("no_collision", 10)
    (before,) = attack([scene((0, 0, 10), (20, 0, 4), *far[1:])], few, "log_replay")
    assert (before.attack.outcome, before.attack.iterations) == ("already_colliding", 0)


def test_evolution_learns_and_chance_does_not():
    goal = np.linspace(-1.0, 1.0, 10)

    def least(sampler):
        found = np.inf
        for _ in range(60):
            changes = sampler.ask()
            costs = ((changes - goal) ** 2).sum(axis=1)
            sampler.tell(changes, costs)
            found = min(found, costs.min())
        return found

    assert least(ByEvolution(0)) < 0.1 < least(AtRandom(0))


def test_a_blind_search_is_for_one_candidate_at_a_time():
    with pytest.raises(RegentsError, match="searches one candidate at a time"):
        RANDOM.but(search="joint")


@pytest.mark.slow
@pytest.mark.parametrize(("sampled", "searches"), [(0, 0), (2, 1)])
def test_before_the_descent_from_the_log_samples_are_tried_there(sampled, searches):
    few = REGENTS_FOCUSED.but(iterations=10, nearest=1, sampled=sampled, near_m=0.0)
    (missed,) = attack([scene((0, 0, 10), (200, 0, 10))], few, "log_replay")  # no drive meets the ego
    assert missed.attack.outcome == "no_collision"
    assert missed.attack.iterations == 10 * (1 + searches)
