"""What the careful driver does at a step follows from what has happened up to then, on crashes of real traffic."""

from dataclasses import replace

import numpy as np
import pytest
from shipped_cases import crash_on

from benchmarks.false_alarms import careful_brakes
from regents_cosim.cases.files import load_case
from regents_cosim.norms.careful import CAREFUL, careful_reaction_steps
from regents_cosim.norms.limits import steps_of
from regents_cosim.verdicts.careful.careful_driver import careful_verdict, expected_swerve
from regents_cosim.verdicts.careful.ego_path import ego_path
from regents_cosim.verdicts.careful.foresight import all_risks

NETWORKS = ("crossing", "merge", "roundabout")


def with_another_future(attacked, step, seed):
    """The case in which all others do something else after a step: they go elsewhere, at other speeds, or vanish."""
    rng, tracks = np.random.default_rng(seed), attacked.tracks
    changed = {name: np.array(getattr(tracks, name)) for name in ("x", "y", "yaw", "speed", "valid")}
    later = (slice(1, None), slice(step + 1, None))
    for name, most in (("x", 20.0), ("y", 20.0), ("yaw", 3.0), ("speed", 9.0)):
        changed[name][later] += rng.uniform(0.0, most, changed[name][later].shape)
    changed["valid"][later] &= rng.random(changed["valid"][later].shape) < 0.8
    return replace(attacked, tracks=replace(tracks, **changed))


def decisions(attacked, path, steps):
    """At which steps the driver brakes for each of the others."""
    agents = range(1, len(attacked.agents))
    return np.array([careful_brakes(risk, attacked.dt) for risk in all_risks(attacked, path, agents, steps)])


@pytest.mark.parametrize("network", NETWORKS)
def test_braking_up_to_a_step_does_not_depend_on_what_others_do_after_it(network):
    attacked = load_case(crash_on(network))
    path, steps = ego_path(attacked), attacked.tracks.steps
    found = decisions(attacked, path, steps)
    differs = False
    for step in (15, 30, 45):
        elsewhere = decisions(with_another_future(attacked, step, step), path, steps)
        np.testing.assert_array_equal(found[:, : step + 1], elsewhere[:, : step + 1])
        differs |= bool((found != elsewhere).any())
    assert differs  # else nothing was changed that matters


@pytest.mark.parametrize("network", NETWORKS)
def test_the_verdict_brakes_when_the_decisions_say_so(network):
    attacked = load_case(crash_on(network))
    hit, drive = attacked.collision, careful_verdict(attacked)[0]
    adversary = attacked.index(hit.agent)
    brakes = decisions(attacked, ego_path(attacked), hit.step + 1)[adversary]
    assert drive.avoids
    acts = int(drive.acts_s / attacked.dt + 1e-6)  # the last step before the brakes act
    assert brakes[acts:].all()
    assert not brakes[acts - 1]


@pytest.mark.parametrize("network", NETWORKS)
def test_the_side_of_a_swerve_is_chosen_by_what_has_been_seen(network):
    attacked = load_case(crash_on(network))
    hit, path = attacked.collision, ego_path(attacked)
    adversary = attacked.index(hit.agent)
    decides = hit.step - int(careful_reaction_steps(np, attacked.dt))
    acts = decides + int(steps_of(np, CAREFUL.delay_s, attacked.dt))
    asked = (path, adversary, decides, acts, attacked.tracks.speed[0])
    elsewhere = with_another_future(attacked, decides, 0)
    assert expected_swerve(attacked, *asked)[0] == expected_swerve(elsewhere, *asked)[0]
