"""What ends a search that looks for clean collisions, and where its later attempts begin."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from scenes import platoon, scene

from regents_cosim.attacks.acceptance import is_clean
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent import ego_contacts, to_controls
from regents_cosim.attacks.movers import Movers
from regents_cosim.attacks.presets import REGENTS_FOCUSED
from regents_cosim.attacks.timings import retimed
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import to_tracks, to_world


@eqx.filter_jit
def judged(world, driven, movers):
    boxes = world.boxes(driven)
    return is_clean(world, movers, boxes, driven.speed[0], ego_contacts(world, boxes))


def clean(*cars, drift=0.0, candidate=1):
    """Whether the crash of cars that go straight on, the second drifting sideways, is clean."""
    made = scene(*cars)
    world = to_world(made)
    moved = np.array(world.log.y)
    moved[1] += drift * np.linspace(0, 1, 81) ** 2
    driven = replace(world.log, y=jnp.asarray(moved, jnp.float32))
    assert ego_contacts(world, world.boxes(driven)).any()
    return bool(judged(world, driven, Movers.only(candidate, world.valid.shape[0])))


def test_a_cut_in_is_clean():
    assert clean((0, 0, 10), (8, 3.2, 9), drift=-3.2)


def test_a_crash_with_somebody_that_the_attack_leaves_alone_is_not():
    assert not clean((0, 0, 10), (8, 3.2, 9), (60, 0, 10), drift=-3.2, candidate=2)


def test_an_adversary_that_was_off_the_road_is_not():
    assert clean((0, 0, 10), (22, 0, 7.5), drift=-0.5)
    assert not clean((0, 0, 10), (22, 0, 7.5), drift=-1.7)


def test_an_adversary_that_hits_somebody_else_first_is_not():
    assert not clean((0, 0, 10), (20, 0, 7.5), (26, 0, 6.9))


def test_an_adversary_that_runs_into_the_back_of_the_ego_is_not():
    assert not clean((20, 0, 5), (0, 0, 10))


def test_a_standing_ego_is_not():
    assert not clean((40, 0, 0.1), (20, 3.2, 6), drift=-8.0)


@pytest.mark.slow
def test_what_the_search_accepts_is_what_the_exact_boxes_call_clean():
    from regents_cosim.verdicts.clean import cleanness

    found = list(attack([platoon(seed=1)], replace(REGENTS_FOCUSED, nearest=3), "log_replay"))
    crashes = [flaws for case in found if (flaws := cleanness(case))]
    assert crashes
    assert all(flaws.clean for flaws in crashes)


def bent():
    """A platoon whose fourth car drives a curve."""
    made = platoon()
    world = to_world(made)
    curvature = world.controls.curvature.at[3].set(0.01)
    driven = roll_out_background(world, replace(world.controls, curvature=curvature))
    return to_world(replace(made, tracks=to_tracks(driven, world.controls, made)))


def test_another_timing_keeps_to_the_path_and_moves_along_it():
    world = bent()
    movers = Movers.only(3, world.valid.shape[0])
    ego = jax.tree.map(lambda values: values[0], world.log)
    path = np.stack([world.log.x[3], world.log.y[3]], axis=-1)
    ends = set()
    for rank in range(3):
        actions = retimed(world, ego, movers, REGENTS_FOCUSED, jnp.int32(rank))
        driven = roll_out_background(world, movers.put(world.controls, to_controls(actions)))
        places = np.stack([driven.x[3], driven.y[3]], axis=-1)
        ends.add(round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 1))
        along = places[np.hypot(*(places - path[0]).T) < np.hypot(*(path[-1] - path[0])) - 1.0]
        line = shapely.LineString(path)
        assert max(line.distance(shapely.Point(place)) for place in along) < 0.3
    assert len(ends) == 3
    assert round(float(np.hypot(*np.diff(path, axis=0).T).sum()), 1) not in ends


@pytest.mark.slow
def test_later_attempts_are_counted_and_cost_what_they_cost():
    far = scene((0, 0, 10), (60, 6.4, 10))
    few = replace(REGENTS_FOCUSED, iterations=3)
    once, thrice = (next(attack([far], replace(few, attempts=n), "log_replay")).attack for n in (1, 3))
    assert (once.outcome, once.iterations) == ("no_collision", 3)
    assert (thrice.outcome, thrice.iterations) == ("no_collision", 9)


def test_at_least_one_attempt_is_made():
    with pytest.raises(RegentsError, match="attempts is 0, expected 1 to 1000"):
        replace(REGENTS_FOCUSED, attempts=0)


def test_a_search_that_stands_still_ends_at_the_end_of_its_patience():
    """A car on the road's other side, far ahead, comes no nearer."""
    far = scene((0, 0, 10), (90, 6.4, 10), (95, 3.2, 10))
    found = next(attack([far], replace(REGENTS_FOCUSED, nearest=1), "log_replay")).attack
    distances = found.cost_history["ego"]  # of the last attempt
    patience = REGENTS_FOCUSED.patience
    assert found.outcome == "no_collision"
    assert patience < len(distances) < 500
    assert min(distances[-patience:]) > 0.98 * min(distances[:-patience])
    assert found.iterations > len(distances)


def test_patience_is_none_or_some():
    with pytest.raises(RegentsError, match="patience is -1, expected 0 to 100000: iterations without progress, or 0"):
        replace(REGENTS_FOCUSED, patience=-1)
