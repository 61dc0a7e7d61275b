"""How fast the parts of an attack are: `make bench-parts` prints it."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from plain_numpy import cost
from timing import STILL, attack, bounded_job, dense_traffic, in_threads, job, seconds
from walkers import as_kind

from regents_cosim.attacks.attack import attack as attack_scenarios
from regents_cosim.attacks.methods.presets import KING, REGENTS
from regents_cosim.mirror.world import to_world

AGENTS = 32
FIRST_CALL = Path(__file__).parent / "first_call.py"


@pytest.mark.parametrize("planner", ["log_replay", "idm"])
def test_one_iteration(benchmark, planner):
    under_test, wanted = job(dense_traffic(AGENTS), planner)
    took = 1e3 * seconds(lambda: attack(under_test, wanted)) / STILL.steps.iterations
    benchmark.pedantic(lambda: attack(under_test, wanted), rounds=1)
    benchmark.extra_info["ms_per_iteration"] = took
    print(f"\n{planner}: {took:.3f} ms per iteration, {AGENTS} agents, 80 steps, one scenario")


@pytest.mark.parametrize("one", [False, True])
def test_an_iteration_with_people(benchmark, one):
    """A third of the 32 on foot beside vehicles alone, the same bounds in both: of all together, or of one of them."""
    config = STILL.but(driving="ordinary", adversary_kinds=("vehicle", "pedestrian"))
    vehicles = mixed = dense_traffic(AGENTS)
    for agent in range(2, AGENTS, 3):
        mixed = as_kind(mixed, agent, "pedestrian")
    jobs = [bounded_job(made, config, 2 if one else None) for made in (vehicles, mixed)]
    of_vehicles, of_mixed = (1e3 * seconds(lambda j=j: attack(*j, config)) / STILL.steps.iterations for j in jobs)
    benchmark.pedantic(attack, (*jobs[1], config), rounds=1)
    benchmark.extra_info |= {"ms_per_iteration": of_mixed, "times_vehicles_alone": of_mixed / of_vehicles}
    print(f"\n{'one' if one else 'joint'}: {of_mixed:.3f} ms, {of_mixed / of_vehicles:.2f} x that of vehicles alone")


@pytest.mark.parametrize("planner", ["log_replay", "idm"])
def test_two_threads_beside_one(benchmark, planner):
    jobs = [job(dense_traffic(AGENTS, seed=seed), planner) for seed in range(32)]
    one, two = (
        seconds(lambda threads=threads: in_threads(threads, lambda j: attack(*j), jobs), rounds=4) for threads in (1, 2)
    )
    benchmark.pedantic(in_threads, (2, lambda j: attack(*j), jobs), rounds=1)
    per_iteration = 1e3 * two / len(jobs) / STILL.steps.iterations
    benchmark.extra_info |= {"ms_per_iteration_and_scenario": per_iteration, "speed_up": one / two}
    print(f"\n{planner}: {per_iteration:.3f} ms per iteration and scenario on 2 threads, {one / two:.2f} x one thread")


def test_a_whole_attack(benchmark):
    """500 iterations on idm, unless it crashes before: 32 scenarios, from tracks to cases."""
    scenarios = [dense_traffic(AGENTS, seed=seed) for seed in range(32)]
    unhit = REGENTS.but(learning_rate=1e-9)
    for name, config in (("all 500 iterations", unhit), ("ReGentS", REGENTS)):
        took = seconds(lambda config=config: list(attack_scenarios(scenarios, config, "idm")), rounds=2)
        print(f"\n{name}: {took / len(scenarios):.3f} s per scenario, warm, with the fit of the controls")
    benchmark.pedantic(lambda: list(attack_scenarios(scenarios, REGENTS, "idm")), rounds=1)


def test_a_first_call(benchmark, tmp_path):
    """Time a new process up to KING's first iteration on idm: with an empty cache, then with a full one."""

    def first_call() -> float:
        kept = os.environ | {"REGENTS_CACHE": str(tmp_path)}
        said = subprocess.run([sys.executable, FIRST_CALL], env=kept, capture_output=True, text=True, check=True)
        return float(said.stdout)

    cold = benchmark.pedantic(first_call, rounds=1)
    warm = min(first_call() for _ in range(3))
    benchmark.extra_info |= {"cold_s": cold, "with_the_cache_s": warm}
    print(f"\ntracing and compiling: {cold:.2f} s; with the programs kept on disk {warm:.2f} s")


def test_against_plain_numpy(benchmark):
    """Time the cost in NumPy, without any gradient, beside a whole iteration."""
    scenario = dense_traffic(AGENTS)
    world = jax.tree.map(jax.device_get, to_world(scenario))
    weights = KING.cost.pair_weight, KING.cost.road_weight, KING.cost.pair_reach_m
    plain = seconds(lambda: cost(world, AGENTS, *weights), rounds=2)
    under_test, wanted = job(scenario, "log_replay")
    ours = seconds(lambda: attack(under_test, wanted)) / STILL.steps.iterations
    benchmark.pedantic(cost, (world, AGENTS, *weights), rounds=1)
    steps = 2 * (AGENTS - 1) * 80
    print(f"\nNumPy: {1e3 * plain:.0f} ms per value, {plain / ours:.0f} x one iteration with its gradient")
    print(f"(by finite differences over {steps} actions: {steps * plain / ours:.2g} x)")
