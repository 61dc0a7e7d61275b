"""Searches for planners outside the compiled loop: they sample, and the planner drives few of the samples itself."""

import os
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mirror_drives import replay_in_mirror
from places import SUPPORT
from scenes import platoon, scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent.pursuit import ClosedLoopDrive, DriveRequest
from regents_cosim.attacks.descent.replanned import BackgroundTraffic
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.engines import RankedDrives
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import CMA_ES
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.sampling.ego_as_driven import EgoAsDriven
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.rollout import EgoTrack, drive
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.system.workers import cores

CAUTIOUS = f"{SUPPORT / 'host_planners.py'}:Cautious"
FEW = CMA_ES.but(
    iterations=60, nearest=2, starts=0, accept="any", adversary_may="anything", driving="any", background="log"
)


def attacked(config=FEW, planner=CAUTIOUS):
    return list(attack([platoon(seed=1)], config, planner))


@pytest.fixture(scope="module")
def found():
    return attacked()


@pytest.mark.slow
def test_cma_es_finds_crashes_of_a_planner_outside(found):
    crashes = [case for case in found if case.attack.outcome == "collision"]
    assert crashes
    for case in crashes:  # each is one of the planner's own drives
        agent, step = first_contact(case.agents, replay_in_mirror(case, CAUTIOUS))
        assert (case.agents[agent].id, step) == (case.collision.agent, case.collision.step)
        assert 2 <= case.attack.drives < case.attack.rollouts


@pytest.mark.slow
def test_the_number_of_copies_of_the_planner_changes_nothing(found, monkeypatch):
    copies = 1 if cores() > 1 else 3
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(copies))
    for one, other in zip(found, attacked(), strict=True):
        assert replace(one.attack, act_time=None) == replace(other.attack, act_time=None)
        assert np.array_equal(one.tracks.x, other.tracks.x)


@pytest.mark.slow
def test_no_window_takes_more_drives_than_it_may():
    never = FEW.but(drives=4, accept="telling", adversary_may="mistakes")
    cases = list(attack([scene((0, 0, 10), (200, 0, 10), (220, 3.2, 10))], never, CAUTIOUS))
    assert [case.attack.outcome for case in cases] == ["no_collision"]
    assert cases[0].attack.drives == 4


@pytest.mark.parametrize(("least", "expected", "driven"), [
    (np.inf, (), [1]),  # the best one of a first look
    (4.0, (), [1]),
    (2.4, (), []),  # hardly nearer than the best drive so far
    (2.4, (0,), [0]),
    (2.4, (0, 2), [2, 0]),
])  # fmt: skip
def test_the_planner_drives_what_promises_a_crash_or_comes_much_nearer(least, expected, driven):
    cost = np.array([5.0, 2.0, 3.0])
    terms = np.stack([cost, 0.0 * cost, 0.0 * cost], axis=1)
    ranked = RankedDrives(cost, terms, np.isin(np.arange(3), expected), least)
    assert ranked.best.tolist() == driven


def test_drives_are_counted_by_scene_shared_among_its_moves_and_not_repeated():
    made, other = scene((0, 0, 10), (20, 0, 8)), scene((0, 0, 10), (20, 0, 8))
    drives = PlannerDrives(lambda requests: [DriveError("lost") for _ in requests], most=10)
    motion = Motion(*(jnp.zeros((2, 81)) for _ in range(4)))

    def asked(one):
        return DriveRequest(one, SearchJob(None, None, None), BackgroundTraffic(motion, None))

    drives([asked(one) for one in (made, made, other)])
    assert (drives.made(made), drives.left(made), drives.left(other)) == (2, 8, 9)
    assert drives.shares([made, other, made]) == {made: 4, other: 9}
    drives([asked(made)] * 9)
    assert (drives.made(made), drives.left(made), drives.shares([made])) == (11, 0, {made: 1})
    asked_for = []
    ego = EgoTrack(Motion(*(jnp.zeros(81) for _ in range(4))), ControlArrays(jnp.zeros(80), jnp.zeros(80)))
    again = PlannerDrives(lambda some: [asked_for.append(one) or ClosedLoopDrive(ego, [0.1]) for one in some], most=10)
    assert [len(again([request])[0].seconds) for request in [asked(made)] * 2] == [1, 0]
    assert len(asked_for) == again.made(made) == 1
    assert PlannerDrives(lambda _: [], most=0).left(made) > 1000


@pytest.mark.slow
def test_the_stand_in_repeats_a_drive_and_brakes_nearly_as_the_planner_does_nearby():
    made = scene((0, 0, 12), (40, 0, 12))
    world, planner = to_world(made), IDM()
    memory = planner.init(CompiledScene(made, world))
    job = SearchJob(world, memory, SearchedAgents.only(1, len(world.valid)))

    def traffic(stops_at):
        time = jnp.arange(81) * 0.1
        x, speed = 40.0 + 12.0 * jnp.minimum(time, stops_at), jnp.where(time < stops_at, 12.0, 0.0)
        changed = world.log.x.at[1].set(x - (made.tracks.x[0].min() + made.tracks.x[0].max()) / 2)
        return replace(world.log, x=changed, speed=world.log.speed.at[1].set(speed))

    def driven(by, memory, background):
        motion, controls, _ = jax.jit(lambda m, b: drive(by, m, world, b))(memory, background)
        return EgoTrack(motion, controls)

    answers = [ClosedLoopDrive(driven(planner, memory, traffic(at))) for at in (3.0, 4.0)]
    drives = PlannerDrives(lambda requests: answers, most=0)
    drives([DriveRequest(made, job, BackgroundTraffic(traffic(at), None)) for at in (3.0, 4.0)])
    stand_in = drives.near(made, job)
    again = driven(EgoAsDriven(), stand_in, traffic(3.0))
    assert np.abs(again.motion.x - answers[0].ego.motion.x).max() < 0.3
    between, expected = driven(EgoAsDriven(), stand_in, traffic(3.5)), driven(planner, memory, traffic(3.5))
    assert np.abs(between.motion.x - expected.motion.x).max() < 3.0
    assert float(between.motion.speed[-1]) < 2.0
