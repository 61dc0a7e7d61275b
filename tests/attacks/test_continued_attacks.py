"""A search that looks again at an attack that is carried out: what its vehicle does already is judged as well."""

import pytest
from scenes import scene

from regents_cosim.attacks.descent.search import descend
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.jax_planner import CompiledScene, start
from regents_cosim.planners.under_test import PlannerUnderTest

CLEAN = REGENTS_FOCUSED.but(accept="clean", adversary_may="anything", background="log", starts=0, attempts=1)
# The ego runs into the slower car ahead after three seconds.
BLOCKED, FREE = ((0, 0, 13), (20, 0, 8), (45, 0, 0)), ((0, 0, 13), (20, 0, 8), (90, 0, 0))


def looked_at(cars, continues):
    """Whether a mere look at the second car's log accepts it."""
    made, planner = scene(*cars), PlannerUnderTest.of("constant_velocity").loop
    world = to_world(made)
    searched = SearchedAgents.only(1, len(world.valid), continues)
    found = descend(
        SearchJob(world, start(planner, CompiledScene(made, world), "ego"), searched), planner, CLEAN, iterations=0
    )
    assert bool(found.hit)
    return bool(found.accepted)


@pytest.mark.slow
def test_it_counts_unchanged_but_not_through_a_third_car():
    """The adversary touches the third car before it meets the ego."""
    assert looked_at(FREE, continues=True)
    assert not looked_at(BLOCKED, continues=True)


@pytest.mark.slow
def test_what_collides_in_a_recording_is_not_searched():
    assert looked_at(BLOCKED, continues=False)
