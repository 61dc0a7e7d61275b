"""Torch modules as planners."""

from dataclasses import replace
from importlib.util import find_spec

import jax.numpy as jnp
import numpy as np
import pytest
from places import SUPPORT
from scenes import platoon, scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import PlannerError
from regents_cosim.mirror.rollout import drive
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.closed_loop import ClosedLoop, drive_on_host
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.hosting.torch_bridge import TorchPlanner, features
from regents_cosim.planners.hosting.torch_in_loop import TorchInLoop
from regents_cosim.planners.hosting.torch_translation import NotTranslatedError, translate
from regents_cosim.planners.interface import Observation, Others, Scene
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.planners.under_test import PlannerUnderTest

# Imported by the tests that need it themselves: it takes two seconds of every process that only collects them.
pytestmark = pytest.mark.skipif(find_spec("torch") is None, reason="torch is an extra")

FILE = SUPPORT / "torch_planners.py"
BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9))
QUICK = REGENTS.but(iterations=20)


def first_look(made) -> Observation:
    told, tracks = Scene.of(made, 6.0, 0.3), made.tracks
    seen = (values[1:, 0] for values in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid))
    return Observation(told, 0, told.ego, Others(told.others, *seen))


def test_what_it_sees():
    made = first_look(BUSY)
    turned = replace(made.ego, x=10.0, y=2.0, yaw=np.pi / 2)  # to the north
    ego, others = features([replace(made, ego=turned)])
    assert ego[0] == pytest.approx([10.0, 4.6, 1.8, -2.0, -70.0], abs=1e-5)
    assert others.shape == (1, 16, 8)
    assert others[0, 0] == pytest.approx([1, 1.2, -10.0, 0, -1, 8, 4.6, 1.8], abs=1e-5)
    assert others[0, 1] == pytest.approx([1, 1.2, -20.0, 0, -1, 9, 4.6, 1.8], abs=1e-5)
    assert not others[0, 2:].any()


def test_the_absent_are_not_seen_and_the_nearest_come_first():
    made = first_look(scene((0, 0, 10), *((200.0 - 8 * k, 3.2, 8) for k in range(20))))
    valid = made.others.valid.copy()
    valid[-1] = False
    _, others = features([replace(made, others=replace(made.others, valid=valid))])
    assert others[0, :, 1] == pytest.approx(56.0 + 8 * np.arange(16))


@pytest.mark.slow
@pytest.mark.parametrize("attribute", ["Careful", "READY"])
def test_many_at_once_as_one_by_one(attribute):
    planner = TorchPlanner(f"{FILE}:{attribute}")
    looks = [first_look(made) for made in (BUSY, platoon(30), scene((0, 0, 10)))]
    planner.reset_batch([look.scene for look in looks])
    together = planner.act_batch(looks)
    for look, answer in zip(looks, together, strict=True):
        planner.reset(look.scene)
        alone = planner.act(look)
        assert [alone.accel, alone.curvature] == pytest.approx([answer.accel, answer.curvature], abs=1e-6)
    assert len({answer.accel for answer in together}) == 3


@pytest.mark.slow
def test_inside_the_compiled_loop_it_drives_as_outside():
    made, name = platoon(20), f"torch:{FILE}:Careful"
    world = to_world(made)
    inside = PlannerUnderTest.of(name).loop
    assert isinstance(inside, TorchInLoop)
    motion, controls, _ = drive(inside, inside.init(CompiledScene(made, world)), world, world.log)
    process, loop = HostProcess(name), ClosedLoop(made, world, world.log, None)
    drive_on_host(process, [loop])
    process.close()
    assert np.abs(loop.track.motion.x - motion.x).max() < 1e-3
    assert np.abs(loop.track.motion.y - motion.y).max() < 1e-3
    assert np.ptp(controls.accel) > 0.01


@pytest.mark.slow
def test_translated_it_answers_the_same():
    import torch
    import torch_planners

    module = torch_planners.OfManyParts().eval()
    for parameter in module.parameters():
        parameter.requires_grad_(False)
    ego, others = 10.0 * torch.randn(1, 5), 10.0 * torch.randn(1, 16, 8)
    translated = translate(module, ego, others)
    for seed in range(3):
        torch.manual_seed(seed)
        ego, others = 10.0 * torch.randn(1, 5), 10.0 * torch.randn(1, 16, 8)
        answer = translated(jnp.asarray(ego.numpy()), jnp.asarray(others.numpy()))
        assert np.asarray(answer) == pytest.approx(module(ego, others).numpy(), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("attribute", "said"), [("Sorted", "aten.sort.default is not among"), ("Raises", "data-dependent")]
)
def test_what_is_not_translated_drives_outside(attribute, said):
    import torch
    import torch_planners

    module = getattr(torch_planners, attribute)().eval()
    with pytest.raises(NotTranslatedError, match=said):
        translate(module, torch.zeros(1, 5), torch.zeros(1, 16, 8))
    assert PlannerUnderTest.of(f"torch:{FILE}:{attribute}").where == "own process"


@pytest.mark.slow
def test_attacked():
    slow = scene((0, 0, 5), (20, 3.2, 8), (30, 3.2, 9), name="slow")
    for case in attack([BUSY, slow], QUICK, f"torch:{FILE}:Careful"):
        assert case.attack.outcome in ("collision", "no_collision")
        assert case.attack.act_time is None
    raised, fine = attack([BUSY, slow], QUICK, f"torch:{FILE}:Raises")
    assert "in `act` at step 0: KeyError: 'lost'" in raised.attack.planner_error
    assert "torch_planners.py" in raised.attack.planner_error
    assert fine.attack.outcome in ("collision", "no_collision")
    assert fine.attack.act_time.decisions >= 80


@pytest.mark.slow
def test_one_that_does_not_fit():
    (case,) = attack([BUSY], QUICK, f"torch:{FILE}:Shapeless")
    assert case.attack.outcome == "planner_error"
    assert "the module answered [1, 1], expected a tensor [1, 2] (batch, control)" in case.attack.planner_error


@pytest.mark.slow
def test_one_that_is_no_module_is_refused_before_anything_is_driven():
    with pytest.raises(PlannerError, match="is a int, expected a torch.nn.Module"):
        list(attack([BUSY], QUICK, f"torch:{FILE}:NO_MODULE"))


@pytest.mark.slow
@pytest.mark.parametrize("made", [False, True], ids=["class", "instance"])
def test_a_module_is_a_planner_as_it_is(made):
    from torch_planners import Careful

    found = PlannerUnderTest.of(Careful() if made else Careful)
    assert (found.name, found.where) == ("torch_planners:Careful", "compiled loop")
    assert isinstance(found.ticket.planner().loop, TorchInLoop), "translated once, it travels as it is"
