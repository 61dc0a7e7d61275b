"""Emitters propose changes for a problem with a known answer."""

import numpy as np

from regents_cosim.attacks.sampling.emitters import BATCH, CmaMe, Elite, EliteGrid, Proposal, ranks

SIZE = 10


def value(change):
    return -float(np.sum(change**2))


class ByChance:
    """Changes from a normal distribution that never learns."""

    def __init__(self, grid, size, seed):
        self.rng, self.size = np.random.default_rng(seed), size

    def ask(self):
        return [Proposal(0, change) for change in self.rng.normal(size=(BATCH, self.size))]

    def tell(self, tried, gains):
        pass


def fill(make, seed=0, rounds=60):
    """The grid that an emitter fills; its measures are the first two coordinates."""
    grid = EliteGrid()
    emitter = make(grid, SIZE, seed)
    for _ in range(rounds):
        proposals = emitter.ask()
        assert [one.change.shape for one in proposals] == BATCH * [(SIZE,)]
        gains = [grid.add(cell(one.change), Elite(False, value(one.change), one)) for one in proposals]
        emitter.tell(proposals, gains)
    return grid


def cell(change):
    return tuple(np.floor(change[:2]).astype(int).tolist())


def well_filled(make):
    return sum(best.value > -40.0 for best in fill(make).cells.values())


def test_evolution_fills_more_than_chance():
    assert well_filled(ByChance) < well_filled(CmaMe)


def test_the_same_seed_gives_the_same_grid():
    one, again, other = (fill(CmaMe, seed, rounds=20).cells for seed in (3, 3, 4))
    assert list(one) == list(again) != list(other)
    assert [best.value for best in one.values()] == [best.value for best in again.values()]


def test_who_adds_nothing_begins_again_at_an_elite_that_crashes():
    grid, elite = EliteGrid(), Proposal(2, np.full(SIZE, 9.0))
    emitter = CmaMe(grid, SIZE, 0)
    grid.add((0, 0), Elite(False, 5.0, Proposal(1, np.zeros(SIZE))))
    grid.add((9, 9), Elite(True, 0.0, elite))
    for _ in range(2):
        proposals = emitter.ask()
        emitter.tell(proposals, [grid.add((9, 9), Elite(False, 9.0, one)) for one in proposals])
    assert {one.start for one in proposals} == {elite.start}


def test_a_first_crash_adds_most_then_a_new_cell_then_a_better_solution():
    grid = EliteGrid()

    def add(place, crash, value):
        return grid.add((place,), Elite(crash, value, Proposal(0, np.zeros(1))))

    first, better, worse, new = add(0, False, 1.0), add(0, False, 3.0), add(0, False, 2.0), add(1, False, -9.0)
    assert [gain.adds for gain in (first, better, worse, new)] == [True, True, False, True]
    crash, second, near = add(0, True, -50.0), add(0, True, -40.0), add(0, False, 9.0)
    assert ranks([worse, better, new, crash]) == [3.0, 2.0, 1.0, 0.0]
    assert [gain.adds for gain in (crash, second, near)] == [True, True, False]
    assert (second.value, grid.crashes, grid.cells[(0,)].value) == (10.0, 1, -40.0)
    assert not add(2, False, 0.0).adds  # once there is a crash, near misses lead nowhere
