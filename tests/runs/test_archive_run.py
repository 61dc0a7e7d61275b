"""A run that keeps the best crash of each kind ends with the same ones: stopped, divided, with fewer windows."""

import random
import shutil
from dataclasses import replace

import pytest
from attack_sessions import StoppedError, attack_session
from made_crashes import MadeCrashes, window
from shipped_cases import shipped_window

from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED, preset
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.errors import CaseError
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.runs.archive.crash import crash_of
from regents_cosim.runs.archive.elites import Archive
from regents_cosim.runs.attack_run import attacked_headers
from regents_cosim.runs.ledger import read_record
from regents_cosim.runs.merging import merge_shards
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.runs.windows import windows_of

AXES = Axes(("manoeuvre", "closing_speed"))
PLANNER = PlannerUnderTest.of("constant_velocity")
RUN = MadeCrashes(preset(method="king"), PLANNER, verify=False, pictures=False, archive=AXES)
WINDOWS = [window(number) for number in range(5)]


def attack(folder, windows=WINDOWS, *, stop_after=99, shard=WHOLE, run=RUN):
    """A session; returns how many windows it searched."""
    return attack_session(folder, windows_of(windows), run, shard, stop_after=stop_after)


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def kept(folder):
    return {entry.case for entry in load_manifest(folder).cases}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "suite"
    assert attack(folder) == len(WINDOWS)
    return folder


def test_what_is_kept_is_the_best_of_each_cell(whole):
    crashes = [crash_of(case) for cases in RUN.attack(WINDOWS) for case in cases]
    best = {one.case for one in Archive(AXES, crashes).elites.values()}
    assert kept(whole) == best
    assert len(best) < len(crashes)
    headers, _ = attacked_headers(read_record(whole), whole)
    assert {header.id for header in headers} == best


@pytest.mark.slow
def test_stopped_anywhere_it_ends_the_same(whole, tmp_path):
    suite = tmp_path / "suite"
    for stop_after in (1, 0, 2):
        with pytest.raises(StoppedError):
            attack(suite, stop_after=stop_after)
    assert attack(suite) == 2
    assert tree(suite) == tree(whole)
    assert attack(suite) == 0


@pytest.mark.slow
def test_shards_put_together_are_the_run_that_was_not_divided(whole, tmp_path):
    shards = [tmp_path / str(number) for number in (1, 2, 3)]
    for number, folder in enumerate(shards, start=1):
        attack(folder, shard=Shard(number, 3))
    assert sum(len(kept(folder)) for folder in shards) > len(kept(whole))
    assert merge_shards(tmp_path / "suite", shards) == len(kept(whole))
    assert tree(tmp_path / "suite") == tree(whole)


@pytest.mark.slow
def test_an_elite_that_is_lost_is_made_again_and_a_crash_that_was_beaten_stays_away(whole, tmp_path):
    suite = shutil.copytree(whole, tmp_path / "suite")
    lost = random.Random(0).choice(sorted(kept(suite)))
    shutil.rmtree(suite / lost)
    assert attack(suite) == 1
    assert tree(suite) == tree(whole)


@pytest.mark.slow
def test_of_windows_that_are_gone_nothing_stays_and_the_next_best_comes(whole, tmp_path):
    suite, fewer = shutil.copytree(whole, tmp_path / "suite"), WINDOWS[::2]
    attack(suite, fewer)
    attack(tmp_path / "other", fewer)
    assert tree(suite) == tree(tmp_path / "other")
    attack(suite)
    assert tree(suite) == tree(whole)


@pytest.mark.slow
def test_a_folder_that_was_begun_with_another_map_is_refused(whole):
    other = MadeCrashes(RUN.config, RUN.planner, verify=False, pictures=False, archive=Axes(("collision_type",)))
    with pytest.raises(
        CaseError,
        match=r'begun with archive \["manoeuvre", "closing_speed"\], this run has archive \["collision_type"\]',
    ):
        attack(whole, run=other)


@pytest.mark.slow
def test_searches_that_go_on_after_a_crash_end_the_same_stopped_or_divided(tmp_path):
    run = AttackRun(
        REGENTS_FOCUSED, PlannerUnderTest.of("idm"), verify=False, pictures=False, archive=AXES, rollouts=132
    )
    windows = [shipped_window("crossing"), replace(shipped_window("crossing"), id="the_same_by_another_seed")]
    assert attack(tmp_path / "whole", windows, run=run) == 2
    with pytest.raises(StoppedError):
        attack(tmp_path / "stopped", windows, run=run, stop_after=1)
    assert attack(tmp_path / "stopped", windows, run=run) == 1
    shards = [tmp_path / "1", tmp_path / "2"]
    for number, folder in enumerate(shards, start=1):
        attack(folder, windows, run=run, shard=Shard(number, 2))
    merge_shards(tmp_path / "merged", shards)
    assert tree(tmp_path / "stopped") == tree(tmp_path / "merged") == tree(tmp_path / "whole")
