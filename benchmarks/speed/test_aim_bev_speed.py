"""Measures the neural ego: a view, a drive of 80 steps, alone and with both cores busy, and an attack on it."""

import functools
import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import KING
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import drive
from regents_cosim.mirror.separation import Box
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.aim_bev.observe import Surroundings, observe
from regents_cosim.planners.aim_bev.planner import aim_bev
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights
from regents_cosim.planners.jax_planner import CompiledScene

CASE = "signals"
FRAMES = 64
ROUNDS = 15


@pytest.fixture(scope="module")
def driven():
    made = next(case.before_attack() for case in load_suite(shipped("scenarios") / "quickstart") if CASE in case.id)
    world = to_world(made)
    return world, aim_bev().init(CompiledScene(made, world))


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
    view = Surroundings(Box(*jax.tree.leaves(now)), world.log.speed[1:, 0], world.valid[1:, 0], memory.lights[0])
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


def test_network(benchmark):
    """Time a view as in a drive, beside torch with folded batch norms, channels last, on all threads."""
    torch = pytest.importorskip("torch", reason="torch is an extra")
    network = aim_bev().network
    view = np.random.default_rng(0).integers(0, 256, (192, 192, 3), np.uint8)
    speed, target = np.float32(8.0), np.array([20.0, 1.0], np.float32)
    plan = compiled(lambda network, *seen: network(*seen))
    ours = functools.partial(plan, network, *jax.device_put((view, speed, target)))

    folded = folded_in_torch(torch)
    pictures = torch.tensor(view).permute(2, 0, 1)[None].to(torch.float32, memory_format=torch.channels_last) / 255.0
    seen = pictures, torch.tensor(speed)[None], torch.tensor(target)[None]

    def theirs():
        with torch.inference_mode():
            return folded(*seen)[0]

    np.testing.assert_allclose(ours(), theirs(), atol=1e-3)
    ours_ms = least_seconds(lambda: ours().block_until_ready(), 300) * 1e3
    torch_ms = least_seconds(theirs, 300) * 1e3
    benchmark.pedantic(lambda: ours().block_until_ready(), rounds=20)
    benchmark.extra_info |= {"ms": ours_ms, "of_torch": ours_ms / torch_ms}
    print(f"\nthe network {ours_ms:.2f} ms, {ours_ms / torch_ms:.2f} of torch's {torch_ms:.2f} ms (least of 300)")


def folded_in_torch(torch):
    from regents_cosim.training.lessons.torch_network import AimBevNetwork

    network = AimBevNetwork().eval()
    weights = {name: torch.tensor(values.astype(np.float32)) for name, values in load_weights(SHIPPED).items()}
    network.load_state_dict(weights, strict=False)
    for layer in network.modules():
        if isinstance(layer, torch.nn.Sequential) and len(layer) > 1 and isinstance(layer[1], torch.nn.BatchNorm2d):
            layer[0], layer[1] = torch.nn.utils.fusion.fuse_conv_bn_eval(layer[0], layer[1]), torch.nn.Identity()
    return network.to(memory_format=torch.channels_last)


def test_drives(benchmark, driven):
    world, memory = driven
    planner = aim_bev()
    run = compiled(lambda memory: drive(planner, memory, world, world.log)[:2])

    def alone():
        jax.block_until_ready(run(memory))

    def two():
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda _: jax.block_until_ready(run(memory)), range(4)))

    benchmark.pedantic(alone, rounds=3, warmup_rounds=1)
    seconds = {"alone": least_seconds(alone), "per_scenario_on_two_threads": least_seconds(two) / 4}
    benchmark.extra_info |= seconds
    print("\n" + ", ".join(f"{name}: {value:.3f} s" for name, value in seconds.items()) + " for 80 steps")


def attacked(preset, every, iterations=500):
    """The windows of `scenarios/quickstart` attacked on all cores: cases and seconds."""
    windows = [case.before_attack() for case in load_suite(shipped("scenarios") / "quickstart")]
    config = preset.but(replan_every=every, iterations=iterations)
    begin = time.perf_counter()
    found = list(attack_each(windows, config, "aim-bev"))
    return [case for cases in found for case in cases], time.perf_counter() - begin


@pytest.mark.parametrize(("every", "iterations"), [(1, 40), (25, 500)])
def test_king(benchmark, every, iterations):
    """Time KING with a drive in every iteration (of the first forty), and in every 25th."""
    attacked(KING, every, iterations=1)
    once, begun = attacked(KING, every, iterations=1)
    found, took = benchmark.pedantic(attacked, (KING, every, iterations), rounds=1)
    more = sum(case.attack.iterations for case in found) - sum(case.attack.iterations for case in once)
    seconds = begun / len(once) + 500 * (took - begun) / more
    benchmark.extra_info["seconds_of_500"] = seconds
    print(f"\nKING, a drive every {every} iterations: {seconds:.1f} s per scenario for 500, on two threads")
