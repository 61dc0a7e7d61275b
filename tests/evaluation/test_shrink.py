"""The least of a crash: what is taken away, and that the planner still crashes without it."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import platoon, scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.collisions import first_contact
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.reduction.interpolation import AttackInterpolation
from regents_cosim.evaluation.reduction.shrink import shrink_at, size
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.grades import GROSS_OFFENCES
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.saving import save_unlisted
from regents_cosim.verdicts.judge import judge


@pytest.fixture(scope="module")
def driver():
    with MirrorController("constant_velocity") as at_the_wheel:
        yield at_the_wheel


@pytest.fixture(scope="module")
def attacked():
    return next(attack([platoon(6, seed=1)], REGENTS, "constant_velocity"))


@pytest.fixture(scope="module")
def shrunk(attacked, driver):
    return shrink_at(driver, attacked)


@pytest.mark.slow
def test_there_is_less_of_everything(attacked, shrunk):
    before, after = size(attacked), size(shrunk.case)
    assert before.changed_agents > 1
    assert after.changed_agents == 1
    assert after.agents < before.agents
    assert after.steps < before.steps
    # The mean is over a shorter window, which ends at the crash: only the greatest compares.
    assert after.deviation_max_m <= before.deviation_max_m
    assert after.collision_step * 0.1 >= 2.0


@pytest.mark.slow
def test_the_planner_still_crashes_with_the_same_adversary(attacked, shrunk, driver):
    case = shrunk.case
    hit = case.attack.collision
    assert hit.agent == attacked.attack.collision.agent
    for tracks in (case.tracks, driver.drive(case).tracks):
        agent, step = first_contact(case.agents, tracks)
        assert (case.agents[agent].id, case.agents[agent].role, step) == (hit.agent, "adversary", hit.step)
    assert (case.id, case.attack.settings["shrunk_from"]) == (f"{attacked.id}-shrunk", attacked.id)


@pytest.mark.slow
def test_the_log_is_cut_alike_and_free_of_collisions(attacked, shrunk):
    case, begin = shrunk.case, shrunk.begin
    rows = [row for row, agent in enumerate(attacked.agents) if agent.id in {a.id for a in case.agents}]
    assert np.array_equal(case.log.x, attacked.log.x[rows, begin : begin + case.tracks.steps])
    before = case.before_attack()
    assert first_contact(before.agents, before.tracks) is None


@pytest.mark.slow
def test_a_shrunk_crash_tells_no_less(attacked, shrunk):
    before, after = judge(attacked).judgement, shrunk.case.judgement
    assert set(after.flaws) <= {*before.flaws, "unattributed"}
    assert set(after.preventable_by) >= set(before.preventable_by)
    broken = [
        {o.name for o in judged.law.adversary} & GROSS_OFFENCES if judged.law else set() for judged in (after, before)
    ]
    assert broken[0] <= broken[1]


@pytest.mark.slow
def test_a_shrunk_case_shrinks_no_further(shrunk, driver, tmp_path):
    saved = load_case(save_unlisted(shrunk.case, tmp_path))
    assert content_hash(shrink_at(driver, saved).case) == content_hash(shrunk.case)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["both", "accel", "curvature"])
def test_on_the_way_back_vehicles_move_as_they_can(attacked, part):
    agent = next(i for i, a in enumerate(attacked.agents) if a.role == "adversary")
    between = AttackInterpolation(attacked, agent)
    log = np.stack([attacked.log.x[agent], attacked.log.y[agent]])
    apart = []
    for share in (1.0, 0.5, 0.0):
        case = between.at(share, part)
        world = to_world(case)
        controls = world.mobility.controls_between(world.log, world.dt)
        assert np.abs(controls.accel[agent]).max() <= ACCEL_LIMIT + 1e-2
        assert np.abs(controls.curvature[agent]).max() <= CURVATURE_LIMIT + 1e-2
        apart.append(np.hypot(case.tracks.x[agent] - log[0], case.tracks.y[agent] - log[1]).mean())
    whole = np.hypot(attacked.tracks.x[agent] - log[0], attacked.tracks.y[agent] - log[1]).mean()
    assert apart[0] == pytest.approx(whole, abs=0.01)
    if part == "both":
        assert apart[0] > apart[1] > apart[2]
        assert apart[2] < 0.05


def test_without_a_collision_there_is_nothing_to_shrink(driver):
    missed = next(attack([platoon(6)], REGENTS.but(iterations=1), "constant_velocity"))
    with pytest.raises(RegentsError, match="no collision to shrink: its attack ended as no_collision"):
        shrink_at(driver, missed)
    with pytest.raises(RegentsError, match="no collision to shrink: it was never attacked"):
        shrink_at(driver, scene((0, 0, 10), (20, 0, 10)))


@pytest.mark.slow
def test_a_planner_that_does_not_crash_there(attacked):
    with (
        MirrorController("idm") as other,
        pytest.raises(RegentsError, match="planner 'idm' .*, expected a crash with car"),
    ):
        shrink_at(other, safe_for_idm(attacked))


def safe_for_idm(attacked):
    """The case as its log, in which nobody collides."""
    return replace(attacked, tracks=attacked.log)
