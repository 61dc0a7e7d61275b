"""Planners outside JAX: in the mirror, in the attack, in SUMO, and what happens when they fail."""

import json
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from command import regents
from mirror_drives import replay_in_mirror
from params import slow
from places import SUPPORT
from scenes import platoon, scene

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.rollout import drive_among_reacting
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.closed_loop import ClosedLoop, drive_on_host
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.collisions import first_contact

FILE = SUPPORT / "host_planners.py"
BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9))
QUICK = REGENTS.but(iterations=40)  # one for all tests: it is compiled once


def named(attribute):
    return f"{FILE}:{attribute}"


class CautiousInJax(JaxPlanner):
    """`host_planners.Cautious` once more."""

    def step(self, memory, sight, ego):
        ahead = (sight.motion.x - ego.x) * jnp.cos(ego.yaw) + (sight.motion.y - ego.y) * jnp.sin(ego.yaw)
        left = (sight.motion.y - ego.y) * jnp.cos(ego.yaw) - (sight.motion.x - ego.x) * jnp.sin(ego.yaw)
        near = jnp.any(sight.valid & (ahead > 0) & (ahead < 15.0) & (jnp.abs(left) < 2.0))
        return ControlArrays(accel=jnp.where(near, -4.0, 1.0), curvature=jnp.float32(0.0)), memory


IN_JAX = f"{Path(__file__)}:CautiousInJax"


@pytest.mark.parametrize("made", [slow(BUSY, id="busy"), pytest.param(platoon(), id="platoon")])
def test_it_drives_as_its_twin_in_the_compiled_loop(made):
    outside, inside = replay_in_mirror(made, named("Cautious")), replay_in_mirror(made, IN_JAX)
    assert np.hypot(outside.x - inside.x, outside.y - inside.y).max() < 1e-3


@pytest.mark.slow
def test_among_agents_that_react_as_well():
    made = scene((0, 0, 10), (-12, 0, 10), (25, 0, 6))
    world = to_world(made)
    reacting = world.vehicle & jnp.asarray(np.arange(len(world.vehicle)) > 0)
    inside, controls, _ = drive_among_reacting(CautiousInJax(), (), world, world.log, reacting)
    process = HostProcess(named("Cautious"))
    loop = ClosedLoop(made, world, world.log, reacting)
    drive_on_host(process, [loop])
    process.close()
    assert np.abs(loop.track.motion.x - inside.x[0]).max() < 1e-3
    assert np.abs(loop.track.controls.accel - controls.accel).max() < 1e-6
    # The follower brakes for the ego, and so it is seen.
    assert float(inside.x[1, -1]) < made.tracks.x[1, -1] - 1.0


@pytest.mark.slow
def test_an_attack_finds_what_it_finds_on_the_twin():
    exact = QUICK.but(replan_every=1)
    (outside,), (inside,) = (list(attack([BUSY], exact, name)) for name in (named("Cautious"), IN_JAX))
    assert outside.attack.outcome == inside.attack.outcome == "collision"
    assert outside.collision == pytest.approx(inside.collision) or (
        outside.collision.agent == inside.collision.agent and outside.collision.step == inside.collision.step
    )
    assert abs(outside.attack.iterations - inside.attack.iterations) <= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "config"),
    [
        pytest.param(named("Cautious"), QUICK, id="outside"),
        slow(IN_JAX, QUICK, id="inside"),
        pytest.param(named("Cautious"), FOCUSED_COST.but(iterations=40), id="reacting", marks=pytest.mark.slow),
    ],
)
def test_a_collision_that_counts_is_one_of_a_fresh_closed_loop(name, config):
    for case in attack([BUSY], config.but(replan_every=7), name):
        hit = case.collision
        assert case.attack.settings["replan_every"] == 7
        assert hit is not None
        again = replay_in_mirror(case, name)  # the background's tracks hold their reactions already
        agent, step = first_contact(case.agents, again)
        assert (case.agents[agent].id, step) == (hit.agent, hit.step)


@pytest.mark.slow
def test_in_batches_it_finds_the_same():
    scenes = [replace(BUSY, id="a"), scene((0, 0, 10), (25, 3.2, 8), name="b"), replace(platoon(3), id="c")]
    together = list(attack(scenes, QUICK, named("InBatches")))
    alone = list(attack(scenes, QUICK, named("Cautious")))
    for one, other in zip(together, alone, strict=True):
        assert one.attack.outcome == other.attack.outcome
        assert one.attack.iterations == other.attack.iterations
        assert np.array_equal(one.tracks.x, other.tracks.x)


def test_waypoints_are_followed():
    tracks = replay_in_mirror(scene((0, 3.2, 8.0)), named("Circles"))
    centre = np.array([0.0, 3.2 + 40.0])
    radius = np.hypot(tracks.x[0] - centre[0], tracks.y[0] - centre[1])
    assert np.abs(radius - 40.0).max() < 0.1
    assert tracks.speed[0] == pytest.approx(8.0, abs=0.05)


def test_what_it_sees():
    (case,) = attack([scene((0, 0, 10), (20, 3.2, 8), (400, 0, 0))], QUICK, named("Witness"))
    assert "0.3 car00 {'car01': 22.4, 'car02': 400.0} ['lane0', 'lane1'] (80.0, 0.0)" in case.attack.planner_error


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        ("Raises", "failed in `act` at step 5: KeyError: 'lost'"),
        slow("Sleeps", "gave no answer within 0.5 s in `act` at step 5"),
        slow("Exits", "failed in `act` at step 5: SystemExit: 3"),
        slow("Quits", "failed in `act` at step 5: SystemExit: 4"),
        ("NotANumber", "accel is nan, expected a finite number"),
        slow("Vectors", "accel of shape [3], expected a single number"),
        slow("Beyond", f"accel -12 m/s^2 is beyond the limit, expected {-ACCEL_LIMIT:g} to {ACCEL_LIMIT:g}"),
        ("Mute", "`act` returned a NoneType, expected Control(accel, curvature) or Waypoints"),
        slow("Scattered", "waypoints of shape [4, 3], expected [point, 2]"),
        slow("Unpaced", "spacing_s is inf, expected a finite number"),
        slow("AllAtOnce", "`act_batch` returned a NoneType, expected a list of decisions"),
        slow("NeverMade", "failed when it was made: OSError: no weights"),
    ],
)
def test_one_that_fails_says_how(attribute, said, tmp_path):
    (case,) = attack([BUSY], QUICK, named(attribute), act_timeout_s=0.5)
    assert case.attack.outcome == "planner_error"
    assert said in case.attack.planner_error
    if attribute in ("Raises", "Sleeps"):  # its own lines, and none of ours above them
        assert "in fail" in case.attack.planner_error
        assert "host_process.py" not in case.attack.planner_error.partition("in fail")[0]
    assert np.array_equal(case.tracks.x, BUSY.tracks.x)
    assert load_case(save_unlisted(case, tmp_path)).attack == case.attack


@pytest.mark.slow
@pytest.mark.parametrize("attribute", ["FailsInOneScene", "FailsInOneSceneInBatches"])
def test_it_costs_its_own_case_only(attribute):
    scenes = [replace(BUSY, id="good"), replace(BUSY, id="bad"), replace(BUSY, id="fine")]
    outcomes = [case.attack.outcome for case in attack(scenes, QUICK, named(attribute))]
    # One that takes batches only is asked again, scene by scene, when a batch fails.
    assert outcomes == ["collision", "planner_error", "collision"]


@pytest.mark.slow
def test_how_long_it_takes_is_noted_and_does_not_change_the_content():
    first, second = (next(attack([BUSY], QUICK, named("Cautious"))) for _ in range(2))
    time = first.attack.act_time
    assert 0.0 < time.median_ms <= time.p99_ms
    assert time.decisions % (BUSY.tracks.steps - 1) == 0
    assert content_hash(first) == content_hash(second)
    assert next(attack([BUSY], QUICK, IN_JAX)).attack.act_time is None


@pytest.mark.slow
def test_a_drive_that_fails_gets_nowhere():
    good, bad = drive_each([BUSY, replace(BUSY, id="bad")], named("FailsInOneScene"))
    assert not good.error
    assert good.completion > 0.5
    assert len(good.act_s) == BUSY.tracks.steps - 1
    assert "KeyError: 'lost'" in bad.error
    assert bad.completion == bad.score == 0.0


def test_a_gradient_through_the_planner_wants_it_in_every_iteration():
    with pytest.raises(RegentsError, match="replan_every 1"):
        REGENTS.but(gradient="through-planner", replan_every=5)


@pytest.mark.slow
def test_the_command_line(tmp_path):
    for made in (replace(BUSY, id="good"), replace(BUSY, id="bad")):
        save_unlisted(made, tmp_path / "cases")
    cases = [tmp_path / "cases" / name for name in ("good", "bad")]

    planner = named("FailsInOneScene")
    done = regents(
        "attack", cases[1], "--planner", planner, "--iterations", 5, "--no-pictures", "-o", tmp_path / "out", "--json"
    )
    assert done.returncode == 4
    assert json.loads(done.stdout)[0]["outcome"] == "planner_error"
    assert "KeyError: 'lost'" in done.stderr
    assert "in reset" in load_case(tmp_path / "out" / "bad-focused-FailsInOneScene").attack.planner_error
    done = regents("evaluate", cases[0], "--planner", planner, "--json", code=0)
    row = json.loads(done.stdout)[0]
    assert row["planner_errors"] == 0
    assert 0.0 < row["act_median_ms"] <= row["act_p99_ms"]
