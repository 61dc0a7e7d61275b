import numpy as np
import pytest
from params import slow
from scenes import platoon, scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import PlannerError
from regents_cosim.mirror.rollout import drive, roll_out_background
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.controllers import LoopController
from regents_cosim.planners.interface import Snapshot
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.planners.names import OURS
from regents_cosim.planners.under_test import PlannerUnderTest

MINE = """
import jax.numpy as jnp
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.planners.interface import Snapshot
from regents_cosim.planners.jax_planner import JaxPlanner

class Raises(JaxPlanner):
    def step(self, memory, sight, ego):
        raise KeyError("lost")

class Vectors(JaxPlanner):
    def step(self, memory, sight, ego):
        return ControlArrays(accel=jnp.zeros(3), curvature=jnp.zeros(3)), memory

class Forgets(JaxPlanner):
    def init(self, scene):
        return jnp.zeros(3)

    def step(self, memory, sight, ego):
        return ControlArrays(accel=jnp.float32(0.0), curvature=jnp.float32(0.0)), jnp.zeros(2)

class Renames(JaxPlanner):
    def init(self, scene):
        return {"last": 0.0}

    def step(self, memory, sight, ego):
        return ControlArrays(accel=jnp.float32(0.0), curvature=jnp.float32(0.0)), {"speed": 0.0}

class Alone(JaxPlanner):
    def step(self, memory, sight, ego):
        return ControlArrays(accel=jnp.float32(0.0), curvature=jnp.float32(0.0))

class Plain(JaxPlanner):
    def step(self, memory, sight, ego):
        return 0.0, memory

class Stepless(JaxPlanner):
    pass
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    return f"{tmp_path}/mine.py"


def driven(scenario, name):
    planner, world = PlannerUnderTest.of(name).loop, to_world(scenario)
    return drive(
        planner, planner.init(CompiledScene(scenario, world)), world, roll_out_background(world, world.controls)
    )[0]


def test_log_replay_follows_the_log():
    made = platoon()
    world = to_world(made)
    motion = driven(made, "log_replay")
    assert np.hypot(motion.x - world.log.x[0], motion.y - world.log.y[0]).max() < 0.02


def test_constant_velocity():
    motion = driven(scene((0, 0, 7), (9, 0, 0)), "constant_velocity")
    assert motion.x[-1] - motion.x[0] == pytest.approx(7 * 8, abs=1e-3)


def test_a_planner_from_a_module():
    assert PlannerUnderTest.of("regents_cosim.planners.idm:IDM").loop == PlannerUnderTest.of("idm").loop


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no_such_module:Thing", "cannot be imported: ModuleNotFoundError"),
        ("regents_cosim.planners.idm:Nothing", "has no 'Nothing'"),
        ("nowhere.py:Thing", "cannot be imported: FileNotFoundError"),
        ("json:dumps", "cannot be made: TypeError: dumps.. missing 1 required"),
        ("math:pi", "is a float, expected a JaxPlanner"),
    ],
)
def test_a_planner_that_cannot_be_found(name, said):
    with pytest.raises(PlannerError, match=said):
        PlannerUnderTest.of(name)


def test_an_unknown_name_is_told_all_that_come_with_the_package():
    with pytest.raises(PlannerError, match="'no_such_planner' not found") as raised:
        PlannerUnderTest.of("no_such_planner")
    assert all(f" {name}," in str(raised.value) for name in OURS)


SEES_PIXELS = {"aim-bev", "aim-bev-hardened"}  # a millimetre is another pixel, and that another drive
QUICK = {"idm", "constant_velocity", "log_replay"}


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in OURS if name not in SEES_PIXELS])
def test_at_the_wheel_of_a_simulator_it_drives_as_in_the_mirror(name):
    made = platoon()
    mirror = driven(made, name)
    driver, tracks = LoopController(name, PlannerUnderTest.of(name).loop), made.tracks
    driver.start(made)
    ego = [tracks.x[0, 0], tracks.y[0, 0], tracks.yaw[0, 0], tracks.speed[0, 0]]
    seen = []
    for step in range(tracks.steps - 1):
        states = [np.array(v[:, step]) for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed)]
        for values, mine in zip(states, ego, strict=True):
            values[0] = mine
        seen.append(ego)
        ego = list(driver.advance(step, Snapshot(*states, tracks.valid[:, step])))
    seen.append(ego)
    origin = CompiledScene(made, to_world(made)).origin
    assert np.array(seen)[:, 0] - origin[0] == pytest.approx(np.asarray(mirror.x), abs=0.02)
    assert np.array(seen)[:, 1] - origin[1] == pytest.approx(np.asarray(mirror.y), abs=0.02)


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        ("Raises", "failed on case scene: KeyError: 'lost'"),
        ("Vectors", "controls of shapes [[3], [3]], expected two scalars"),
        ("Forgets", "another kind of memory than it was given: memory is float32[2], expected float32[3]"),
        ("Renames", "memory['last'] is nothing, expected float32[]"),
        ("Alone", "`step` returns ControlArrays, expected ControlArrays(accel, curvature) and the memory"),
        ("Plain", "`step` returns float, tuple, expected ControlArrays"),
        ("Stepless", "Stepless has no `step`"),
    ],
)
def test_a_planner_that_fails_says_how(mine, attribute, said):
    (attacked,) = attack([scene((0, 0, 10), (20, 0, 8))], REGENTS, f"{mine}:{attribute}")
    assert attacked.attack.outcome == "planner_error"
    assert said in attacked.attack.planner_error
