"""Learning from crashes: which count, what is taught of them, and whether it helped."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from blind_weights import save_blind
from command import regents
from hypothesis import given
from hypothesis import strategies as st
from params import slow
from quick_xla import as_users_have_it
from scenes import TIME, crash, moved, moving, platoon, scene

from regents_cosim.cli import run
from regents_cosim.errors import PlannerError, RegentsError, ScenarioError
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.norms.grades import Prevention
from regents_cosim.planners.aim_bev.planner import AimBev, aim_bev
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.training.failed_drives import failed_drives, teachable
from regents_cosim.training.fine_tuning import (
    SHARES,
    Mixture,
    before_after,
    best,
    hold_back,
    interpolate,
    learnt_path,
    mixture,
)
from regents_cosim.training.lessons.classroom import gather
from regents_cosim.training.lessons.curriculum import EVADING, KINDS, evading_steps, plan
from regents_cosim.verdicts.careful.evasion import evaded
from regents_cosim.verdicts.judge import judge

STOPS_AT = 30  # step at which the car ahead stands still


def stopping_ahead(gap=40.0, name="stops"):
    """An attacked case that its ego passes: the car ahead, which drove on, now stops; the ego changed lanes."""
    made = scene((0, 0, 10.0), (gap, 0, 10.0), name=name)
    x = made.tracks.x[1]
    hit = crash(made, moved(made, 1, x=np.minimum(x, x[STOPS_AT]), speed=np.where(np.arange(81) < STOPS_AT, 10.0, 0.0)))
    passed = replace(hit.attack, outcome="no_collision", collision=None)
    return replace(moving(hit, 0, y=np.clip(TIME, 0.0, 3.2)), agents=made.agents, attack=passed)


def straight_on(case, **seen):
    """What becomes of a case whose ego keeps its speed and direction."""
    with MirrorController("constant_velocity") as driver:
        (found,) = failed_drives([case], [driver.drive(case).tracks], "constant_velocity", **seen)
    return found


@pytest.fixture(scope="module")
def failed():
    return straight_on(stopping_ahead())


def test_a_failed_drive_is_the_planners_own(failed):
    case = stopping_ahead()
    assert first_contact(case.agents, case.tracks) is None, "the ego of the case itself passes"
    assert failed.tracks.x[0] == pytest.approx(10.0 * 0.1 * np.arange(81), abs=1e-3)
    assert np.array_equal(failed.tracks.x[1:], case.tracks.x[1:]), "everybody else as in the case"
    hit = failed.collision
    assert (hit.agent, hit.collision_type, hit.attributed) == ("car01", "rear_end_by_ego", True)
    assert failed.attack.planner == "constant_velocity"
    assert teachable([failed, None]) == [failed]


def test_the_teacher_is_the_careful_driver(failed):
    assert failed.judgement.prevention is Prevention.PREVENTABLE
    assert failed.evades_from == int(failed.judgement.careful.acts_s / failed.dt + 1e-6)
    assert first_contact(failed.agents, evaded(failed).tracks) is None


def test_what_the_planner_passes_is_no_failure():
    assert straight_on(scene((0, 0, 10.0), (40, 0, 10.0))) is None


def test_a_crash_of_ordinary_traffic_is_nobodys_attack():
    found = straight_on(replace(stopping_ahead(), attack=None, log=None))
    assert not found.collision.attributed
    assert np.array_equal(found.log.x, stopping_ahead().tracks.x)


def test_an_ego_that_is_run_into_has_nothing_to_learn():
    behind = scene((0, 0, 5.0), (-20, 0, 15.0))
    found = straight_on(behind)
    assert "rear_ends_ego" in found.judgement.flaws
    assert teachable([found]) == []


def test_what_comes_into_view_too_late_teaches_nothing(failed):
    found = straight_on(stopping_ahead(), view_m=10.0)
    assert found.judgement == failed.judgement
    assert found.evasion is None, "the careful driver brakes before it is in view"
    assert teachable([found]) == []


def test_no_evasion_begins_out_of_sight(failed):
    onset = failed.evades_from
    assert failed.tracks.x[1, onset] - failed.tracks.x[0, onset] <= 19.2 + 1e-3


def test_only_the_ego_is_taught_and_before_it_evades_as_ever(failed):
    steps = evading_steps(failed)
    assert steps == range(failed.evades_from, failed.collision.step + 10)
    curriculum = plan(gather([platoon(), evaded(failed)]), {1: steps})
    rows = curriculum.rows[EVADING]
    assert set(rows[:, 0]) == {1}
    assert set(rows[:, 1]) == {0}
    assert list(rows[:, 2]) == [step for step in steps if step < 81 - 8]
    ordinary = np.concatenate([curriculum.rows[kind] for kind in KINDS if kind != EVADING])
    ordinary = ordinary[ordinary[:, 0] == 1]
    assert set(ordinary[:, 1]) == {0}, "no adversary is a teacher"
    assert sorted(ordinary[:, 2]) == list(range(steps.start))


def test_lessons_of_evasion_brake_and_do_not_give_away_where(failed):
    room = gather([platoon(), evaded(failed)])
    curriculum = plan(room, {1: evading_steps(failed)})
    lesson = curriculum.draw(200, np.random.default_rng(0), evading=0.5)
    crashes = np.asarray(lesson.scene) == 1
    assert 0.3 < (crashes & (np.asarray(lesson.step) >= evading_steps(failed).start)).mean() < 0.7
    assert np.asarray(lesson.goal)[crashes] == pytest.approx(np.tile(failed.target, (crashes.sum(), 1)))
    onset = failed.evades_from
    rows = np.array([[1, 0, onset + 10]])
    on_its_way = curriculum.lessons(rows, curriculum.states(rows), np.random.default_rng(0))
    way = np.asarray(room.labels(on_its_way))[0, :, 0]
    speeds = np.diff(way) / 0.1
    assert (np.diff(speeds) < 0.0).all()
    assert float(room.targets(on_its_way)[0, 0]) == pytest.approx(
        failed.target[0] - evaded(failed).tracks.x[0, onset + 10], abs=1e-3
    )


def test_without_crashes_the_shares_are_as_ever():
    curriculum = plan(gather([platoon()]))
    assert len(curriculum.rows[EVADING]) == 0
    lesson = curriculum.draw(50, np.random.default_rng(0), evading=0.3)
    assert set(np.asarray(lesson.scene)) == {0}
    assert lesson.goal.dtype == jnp.float32


def test_a_crash_that_a_careful_driver_does_not_avoid_teaches_nothing():
    at_once = judge(crash(scene((0, 0, 10.0), (40, 0, 10.0)), scene((0, 0, 10.0), (5.5, 0, 0.0)).tracks))
    assert at_once.judgement.prevention is Prevention.NOT_PREVENTABLE
    with pytest.raises(ScenarioError, match="expected a collision that a careful driver avoids"):
        evading_steps(at_once)


@given(share=st.floats(0.0, 1.0))
def test_weights_lie_between_their_ends(share):
    before, after = {"a": np.array([1.0, -2.0], np.float16)}, {"a": np.array([3.0, -2.0], np.float32)}
    mixed = interpolate(before, after, share)["a"]
    assert mixed.dtype == np.float32
    assert mixed == pytest.approx([1.0 + 2.0 * share, -2.0])
    assert np.array_equal(interpolate(before, after, 0.0)["a"], before["a"])
    assert np.array_equal(interpolate(before, after, 1.0)["a"], after["a"])


@pytest.mark.parametrize("after", [{}, {"b": np.zeros(2)}, {"a": np.zeros(3)}])
def test_weights_of_two_networks_do_not_mix(after):
    with pytest.raises(RegentsError, match="expected the same arrays in both"):
        interpolate({"a": np.zeros(2)}, after, 0.5)


def test_as_much_is_kept_as_ordinary_traffic_bears():
    before = Mixture(0.0, 20, 0.90)
    assert best(before, [Mixture(0.5, 15, 0.895), Mixture(1.0, 10, 0.85)]).share == 0.5
    assert best(before, [Mixture(0.5, 15, 0.895), Mixture(1.0, 15, 0.95)]).share == 0.5, "the one that changes least"
    assert best(before, [Mixture(0.5, 20, 0.95), Mixture(1.0, 25, 0.95)]) == before
    assert mixture(0.5, [drive("a", True), drive("b", False)], [drive("c", False, 0.5)]) == Mixture(0.5, 1, 0.5)


def drive(case, hits, completion=1.0):
    return DriveResult(
        case, "made by hand", "other" if hits else None, 3 if hits else None, completion=completion, score=completion
    )


def test_the_table_compares_case_by_case():
    before = [drive(str(i), i < 8) for i in range(20)]
    before[0] = replace(before[0], collision_type="rear_end_by_adversary")
    after = [drive(str(i), i in (0, 10), completion=0.9) for i in range(20)]
    first, second = before_after("adversarial", before, after)
    assert (first.weights, first.collisions, first.from_behind, first.alone) == ("before", 8, 1, 7)
    assert (second.weights, second.collisions, second.from_behind, second.alone) == ("after", 2, 0, 1)
    assert second.collision_interval_percent == pytest.approx((2.8, 30.1), abs=0.1)
    assert first.p_value == second.p_value == pytest.approx(0.0703, abs=1e-4)  # 2 (1 + 8) / 2^8
    assert (first.route_completion_percent, second.route_completion_percent) == (100.0, 90.0)


def test_windows_are_held_back_whole():
    cases = [stopping_ahead(name=f"{window}-{way}") for window in range(10) for way in "ab"]
    cases = [replace(c, attack=replace(c.attack, case=c.id[0])) for c in cases]
    taught, held = hold_back(cases)
    assert [c.id for c in held] == ["4-a", "4-b", "9-a", "9-b"]
    assert len(taught) == 16


def test_weights_by_name():
    assert PlannerUnderTest.of("aim-bev").loop is aim_bev()
    assert isinstance(PlannerUnderTest.of(f"aim-bev:{SHIPPED}").loop, AimBev)
    with pytest.raises(RegentsError, match="weights"):
        PlannerUnderTest.of("aim-bev:nowhere.safetensors")
    with pytest.raises(PlannerError, match="did you mean aim-bev"):
        PlannerUnderTest.of("aim-bef")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Suites: ordinary traffic, crashes that can be avoided, what is passed anyway, another horizon."""
    root = tmp_path_factory.mktemp("fine_tuning")
    suites = {
        "ordinary": [platoon(cars=2, seed=seed) for seed in range(7)],
        "hard": [stopping_ahead(40.0 + i, f"hard{i}") for i in range(7)],
        "easy": [scene((0, 0, 10.0), (60.0 + i, 0, 10.0), name=f"easy{i}") for i in range(7)],
        "short": [scene((0, 0, 10.0), (60, 0, 10.0), steps=41)],
    }
    for name, made in suites.items():
        suite = SuiteWriter(root / name, 0)
        for case in made:
            suite.add(case)
    return root


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """Weights that see nothing: they plan to go straight on."""
    return save_blind(tmp_path_factory.mktemp("weights") / "blind.safetensors")


def said(capsys):
    return " ".join(capsys.readouterr().err.split())


def fine_tune(folders, suite, out, *more):
    small = ["--lessons", "64", "--drives", "2", "--epochs", "1", "--frozen", "13", "--quiet"]
    named = [str(folders / "ordinary"), "--finetune", str(folders / suite), "-o", str(out)]
    return ["train", "aim-bev", *named, *small, *(str(word) for word in more)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suite", "more", "complaint"),
    [
        ("short", (), "2 different horizons (4 s in steps of 0.1 s, 8 s in steps of 0.1 s), expected one"),
        ("nothing", (), "nothing"),
        ("hard", ("--evading", "1.0"), "a share 1.0 of lessons, expected one between 0 and 1"),
        slow("hard", ("--resume", "no.safetensors"), "no.safetensors"),
    ],
)
def test_what_cannot_be_trained_on_is_said_at_once(folders, tmp_path, capsys, suite, more, complaint):
    pytest.importorskip("torch", reason="torch is an extra")
    assert run(fine_tune(folders, suite, tmp_path / "new" / "weights.safetensors", *more)) == 2
    assert complaint in said(capsys)
    assert not (tmp_path / "new").exists(), "nothing is half written"


@pytest.mark.slow
def test_too_few_windows_to_judge_by(folders, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    words = fine_tune(folders, "hard", tmp_path / "weights.safetensors")
    words[2] = str(folders / "easy" / "easy0")
    assert run(words) == 2
    assert "expected at least 7 windows, or 5 and --ordinary CASES to judge by" in said(capsys)


def test_where_nothing_can_be_written(folders, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    (tmp_path / "file").touch()
    assert run(fine_tune(folders, "hard", tmp_path / "file" / "weights.safetensors")) == 2
    assert "cannot write" in said(capsys)


def test_an_empty_suite(folders, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    (tmp_path / "empty").mkdir()
    words = fine_tune(folders, tmp_path / "empty", tmp_path / "weights.safetensors")
    assert run(words) == 2
    assert "no suite.json" in said(capsys)


def test_cases_to_judge_by_need_a_fine_tuning(folders, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    words = ["train", "aim-bev", str(folders / "ordinary"), "--held-out", str(folders / "hard")]
    assert run([*words, "-o", str(tmp_path / "weights.safetensors")]) == 2
    assert "expected --finetune SUITE" in said(capsys)


@pytest.mark.slow
def test_a_suite_without_failures_teaches_nothing(folders, blind, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    assert run(fine_tune(folders, "easy", tmp_path / "weights.safetensors", "--resume", blind)) == 2
    assert "crashes in 0 of 5 cases" in said(capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_fine_tuning_from_the_command_line(folders, blind, tmp_path):
    pytest.importorskip("torch", reason="torch is an extra")
    out = tmp_path / "weights.safetensors"
    words = fine_tune(folders, "hard", out, "--resume", blind, "--json")
    done = regents(*words, **as_users_have_it(), code=0)
    rows = json.loads(done.stdout)
    assert [(row["cases"], row["weights"], row["n"]) for row in rows] == [
        (cases, weights, 1) for cases in ("adversarial", "ordinary") for weights in ("before", "after")
    ]
    assert rows[0]["collisions"] == 1
    before, learnt, kept = (load_weights(path) for path in (blind, learnt_path(out), out))
    assert not np.array_equal(learnt["output.weight"], before["output.weight"])
    statistics = [name for name in before if "running" in name]
    assert statistics
    assert all(np.array_equal(learnt[name], before[name].astype(np.float32)) for name in statistics)
    shares = [0.0, *SHARES]
    assert any(
        np.array_equal(kept["output.weight"], interpolate(before, learnt, share)["output.weight"]) for share in shares
    )
    assert isinstance(PlannerUnderTest.of(f"aim-bev:{out}").loop, AimBev)
