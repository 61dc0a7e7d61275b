"""Lanes are the engine for accelerators; here they run on the CPU and must find what threads find."""

import itertools

import pytest
from params import slow
from scenes import platoon, scene

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import REGENTS

HARD = scene((0, 0, 10), (60, 6.4, 10), (90, 3.2, 10), name="hard")
ALONE = scene((0, 0, 10), name="alone")
SAME = [platoon(seed=seed) for seed in range(3)]
MIXED = [HARD, platoon(seed=0), ALONE, platoon(seed=1)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "scenarios"),
    [
        (REGENTS.but(iterations=12), SAME),
        slow(REGENTS.but(iterations=80), MIXED),
        slow(FOCUSED_COST.but(iterations=80, background="log"), MIXED),
    ],
)
def test_batches_find_what_threads_find(config, scenarios):
    threads, batches = (
        list(attack_each(scenarios, config, "log_replay", batch=2, engine=engine)) for engine in ("threads", "batched")
    )
    assert [[s.id for s in results] for results in batches] == [[s.id for s in results] for results in threads]
    for mine, theirs in zip(itertools.chain(*batches), itertools.chain(*threads), strict=True):
        assert mine.attack.outcome == theirs.attack.outcome
        # They round differently, and Adam follows the sign of however small a gradient.
        assert mine.attack.iterations == pytest.approx(theirs.attack.iterations, rel=0.1)


@pytest.mark.slow
def test_how_many_go_side_by_side_changes_nothing():
    scenarios = [platoon(seed=seed) for seed in range(4)]
    few = REGENTS.but(iterations=60)
    two, four = (
        [s.attack.outcome for (s,) in attack_each(scenarios, few, "log_replay", batch=batch, engine="batched")]
        for batch in (2, 4)
    )
    assert two == four
