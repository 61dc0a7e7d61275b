"""What the neural ego costs: a view, a drive of 80 steps, alone and with both cores busy, and an attack on it."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from timing import STILL, attack, in_threads

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.job import Job
from regents_cosim.attacks.movers import Movers
from regents_cosim.attacks.presets import KING, REGENTS_FOCUSED
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.observe import View, observe
from regents_cosim.mirror.rollout import drive
from regents_cosim.mirror.separation import Box
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.aim_bev.planner import aim_bev
from regents_cosim.planners.jax_planner import LoopScene
from regents_cosim.shipped import shipped
from regents_cosim.suite import load_cases

CASE = "signals"
FRAMES = 64
ROUNDS = 15


@pytest.fixture(scope="module")
def driven():
    made = next(case.before_attack() for case in load_cases(shipped("scenarios") / "quickstart") if CASE in case.id)
    world = to_world(made)
    return world, aim_bev().init(LoopScene(made, world))


def least_seconds(call, rounds=ROUNDS) -> float:
    call()
    found = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        found.append(time.perf_counter() - start)
    return min(found)


def test_views(benchmark, driven):
    world, memory = driven
    now = jax.tree.map(lambda v: jnp.broadcast_to(v, world.log.x.shape)[1:, 0], world.boxes(world.log))
    view = View(Box(*jax.tree.leaves(now)), world.log.speed[1:, 0], world.valid[1:, 0], memory.lights[0])
    egos = jax.tree.map(lambda v: v[0, :FRAMES], world.log)
    render = compiled(jax.vmap(observe, (None, None, None, 0)))
    halves = [jax.tree.map(lambda v, part=part: v[part], egos) for part in (slice(0, None, 2), slice(1, None, 2))]

    def both_cores():
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda e: render(memory.ground, memory.bars, view, e).block_until_ready(), halves))

    benchmark.pedantic(both_cores, rounds=3, warmup_rounds=1)
    frame_ms = least_seconds(both_cores) / FRAMES * 1e3
    benchmark.extra_info["ms_per_frame"] = frame_ms
    print(f"\n{frame_ms:.3f} ms per view, in batches on two threads (least of {ROUNDS})")


def test_drives(benchmark, driven):
    world, memory = driven
    planner = aim_bev()
    run = compiled(lambda memory: drive(planner, memory, world, world.log))

    def alone():
        jax.block_until_ready(run(memory))

    def two():
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda _: jax.block_until_ready(run(memory)), range(4)))

    benchmark.pedantic(alone, rounds=3, warmup_rounds=1)
    seconds = {"alone": least_seconds(alone), "per_scenario_on_two_threads": least_seconds(two) / 4}
    benchmark.extra_info |= seconds
    print("\n" + ", ".join(f"{name}: {value:.3f} s" for name, value in seconds.items()) + " for 80 steps")


def test_attacks(benchmark, driven):
    """With the network in every iteration: of 500, as long as ten take."""
    world, memory = driven
    wanted = Job(world, memory, Movers.among(world.vehicle & (np.arange(len(world.vehicle)) > 0)))
    planner, few = aim_bev(), replace(STILL, iterations=10)

    def two():
        in_threads(2, lambda _: attack(planner, wanted, few), [0, 1])

    benchmark.pedantic(two, rounds=1, warmup_rounds=1)
    looks = few.iterations + 1
    seconds = least_seconds(two, rounds=3) / 2 / looks * (500 + 1)
    benchmark.extra_info["seconds_of_500"] = seconds
    print(f"\n{seconds:.0f} s per scenario for 500 iterations with a drive in each, on two threads")


def test_attacks_with_a_drive_now_and_then(benchmark):
    """On the twelve windows of `scenarios/quickstart`, every 25 iterations, on two threads; warm."""
    windows = [case.before_attack() for case in load_cases(shipped("scenarios") / "quickstart")]

    def attacked(preset):
        return [case for found in attack_each(windows, replace(preset, replan_every=25), "aim-bev") for case in found]

    for preset in (KING, REGENTS_FOCUSED):
        attacked(preset)
        begin = time.perf_counter()
        found = attacked(preset)
        took = time.perf_counter() - begin
        benchmark.extra_info[preset.method] = took / len(windows)
        print(f"\n{preset.method}: {took / len(windows):.1f} s per window")
        if preset is KING:
            iterations = sum(case.attack.iterations for case in found)
            print(f"which is {500 * took / iterations:.1f} s for 500 iterations")
    benchmark.pedantic(attacked, (KING,), rounds=1)
