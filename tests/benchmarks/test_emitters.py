"""Who proposes changes: on a problem of which the answer is known."""

import numpy as np
import pytest

from regents_cosim.benchmarks.elite_grid import EliteGrid, ranks
from regents_cosim.benchmarks.emitters import BATCH, CmaMe, CmaMega, RandomEmitter

SIZE = 10


def value(change):
    return -float(np.sum(change**2))


def slopes(change):
    """Of the value, and of two measures: the first two coordinates."""
    return np.stack([-2.0 * change, np.eye(SIZE)[0], np.eye(SIZE)[1]])


def by_chance(grid, seed):
    return RandomEmitter(SIZE, seed)


def evolved(grid, seed):
    return CmaMe(grid, SIZE, seed)


def by_gradient(grid, seed):
    return CmaMega(grid, SIZE, 2, seed, slopes)


def fill(make, seed=0, rounds=60):
    """The grid that it fills."""
    grid = EliteGrid()
    emitter = make(grid, seed)
    for _ in range(rounds):
        changes = emitter.ask()
        assert changes.shape == (BATCH, SIZE)
        gains = [grid.add(tuple(np.floor(one[:2]).astype(int).tolist()), value(one), one) for one in changes]
        emitter.tell(changes, gains)
    return grid


def well_filled(make):
    return sum(best > -40.0 for best, _ in fill(make).cells.values())


def test_gradients_fill_more_than_evolution_and_that_more_than_chance():
    assert well_filled(by_chance) < well_filled(evolved) < well_filled(by_gradient)


@pytest.mark.parametrize("make", [by_chance, evolved, by_gradient])
def test_the_same_seed_gives_the_same_grid(make):
    one, again, other = (fill(make, seed, rounds=20).cells for seed in (3, 3, 4))
    assert list(one) == list(again) != list(other)
    assert [best for best, _ in one.values()] == [best for best, _ in again.values()]


def test_slopes_of_nothing_lead_nowhere():
    emitter = CmaMega(EliteGrid(), SIZE, 2, 0, lambda change: np.zeros((3, SIZE)))
    assert np.all(emitter.ask() == 0.0)


def test_a_new_cell_adds_more_than_a_better_solution_and_that_more_than_none():
    grid, change = EliteGrid(), np.ones(1)
    first = grid.add((0,), 1.0, np.zeros(1))
    better, worse, new = (grid.add(*given, change) for given in (((0,), 3.0), ((0,), 2.0), ((1,), -9.0)))
    assert ranks([worse, better, new]) == [2.0, 1.0, 0.0]
    assert [gain.adds for gain in (first, better, worse, new)] == [True, True, False, True]
    assert grid.cells[(0,)][0] == 3.0
