"""How fast the attack is: `make bench` prints it. The same file runs on a GPU where JAX sees one."""

import os
from dataclasses import replace

import jax
import jax.numpy as jnp
import pytest
from plain_numpy import cost
from timing import STILL, attack, dense_traffic, in_threads, job, seconds

from regents_cosim.attacks.attack import attack as attack_scenarios
from regents_cosim.attacks.lanes import search_in_lanes
from regents_cosim.attacks.presets import KING, REGENTS
from regents_cosim.attacks.search import descend
from regents_cosim.mirror.world import to_world

AGENTS = 32
ON_CPU = jax.default_backend() == "cpu"


@pytest.mark.parametrize("planner", ["log_replay", "idm"])
def test_one_iteration(benchmark, planner):
    under_test, wanted = job(dense_traffic(AGENTS), planner)
    took = 1e3 * seconds(lambda: attack(under_test, wanted)) / STILL.iterations
    benchmark.pedantic(lambda: attack(under_test, wanted), rounds=1)
    benchmark.extra_info["ms_per_iteration"] = took
    print(f"\n{planner}: {took:.3f} ms per iteration, {AGENTS} agents, 80 steps, one scenario")


@pytest.mark.parametrize("planner", ["log_replay", "idm"])
def test_two_threads_beside_one(benchmark, planner):
    jobs = [job(dense_traffic(AGENTS, seed=seed), planner) for seed in range(32)]
    one, two = (
        seconds(lambda threads=threads: in_threads(threads, lambda j: attack(*j), jobs), rounds=4) for threads in (1, 2)
    )
    benchmark.pedantic(in_threads, (2, lambda j: attack(*j), jobs), rounds=1)
    per_iteration = 1e3 * two / len(jobs) / STILL.iterations
    benchmark.extra_info |= {"ms_per_iteration_and_scenario": per_iteration, "speed_up": one / two}
    print(f"\n{planner}: {per_iteration:.3f} ms per iteration and scenario on 2 threads, {one / two:.2f} x one thread")


def test_a_whole_attack(benchmark):
    """500 iterations on idm, unless it crashes before: 32 scenarios, from tracks to cases."""
    scenarios = [dense_traffic(AGENTS, seed=seed) for seed in range(32)]
    unhit = replace(REGENTS, learning_rate=1e-9)
    for name, config in (("all 500 iterations", unhit), ("ReGentS", REGENTS)):
        took = seconds(lambda config=config: list(attack_scenarios(scenarios, config, "idm")), rounds=2)
        print(f"\n{name}: {took / len(scenarios):.3f} s per scenario, warm, with the fit of the controls")
    benchmark.pedantic(lambda: list(attack_scenarios(scenarios, REGENTS, "idm")), rounds=1)


def test_compiling(benchmark):
    under_test, wanted = job(dense_traffic(AGENTS), "idm")
    config = replace(KING, pair_weight=5.01).compiled()  # a program of its own

    def compile_it():
        return descend.lower(wanted.world, under_test, wanted.memory, config, wanted.movers, jnp.int32(101)).compile()

    cached = os.environ.get("REGENTS_CACHE", "unset")
    print(f"\ntracing and compiling: {benchmark.pedantic(compile_it, rounds=1) and benchmark.stats.stats.min:.2f} s")
    print(f"(REGENTS_CACHE {cached}; with the programs kept on disk, run it twice)")


def test_against_plain_numpy(benchmark):
    """One value of the cost in NumPy, without any gradient, beside a whole iteration."""
    scenario = dense_traffic(AGENTS)
    world = jax.tree.map(jax.device_get, to_world(scenario))
    weights = KING.pair_weight, KING.road_weight, KING.pair_reach_m
    plain = seconds(lambda: cost(world, *weights), rounds=2)
    under_test, wanted = job(scenario, "log_replay")
    ours = seconds(lambda: attack(under_test, wanted)) / STILL.iterations
    benchmark.pedantic(cost, (world, *weights), rounds=1)
    steps = 2 * (AGENTS - 1) * 80
    print(f"\nNumPy: {1e3 * plain:.0f} ms per value, {plain / ours:.0f} x one iteration with its gradient")
    print(f"(by finite differences over {steps} actions: {steps * plain / ours:.2g} x)")


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, 8, 32, 128] if ON_CPU else [1, 32, 256, 1024, 4096])
def test_lanes(benchmark, lanes):
    """Searches side by side in one program, which is how a GPU runs them."""
    under_test, wanted = job(dense_traffic(AGENTS), "log_replay")
    few = replace(STILL, iterations=25)
    took = seconds(lambda: search_in_lanes([wanted] * lanes, under_test, few, lanes), rounds=2)
    benchmark.pedantic(search_in_lanes, ([wanted] * lanes, under_test, few, lanes), rounds=1)
    rate = lanes * few.iterations / took
    print(f"\n{jax.default_backend()}, {lanes} lanes: {rate:.0f} iterations per second, {1e3 / rate:.3f} ms each")
