"""Writers that meet in one folder, and writers that are killed: nothing is lost, nothing half done."""

import gzip
import os
import random
import shutil
import signal
import subprocess
import time
from threading import Thread

import pytest
from disk_writers import add, assert_cleaned_up, assert_survived, assert_well, case, names, started
from params import slow

from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.regression.baseline import load_baseline
from regents_cosim.evaluation.suites.folders import write_suite
from regents_cosim.system.files.atomic import clear_leftovers, is_temporary, new_folder, write_atomic
from regents_cosim.system.files.locks import LOCK, writing


def finish(*writers):
    for writer in writers:
        _, said = writer.communicate(timeout=60)
        assert writer.returncode == 0, said.decode()


# --- writers that meet ------------------------------------------------------------------------


@pytest.mark.slow
def test_all_cases_of_four_writers_into_one_folder_are_listed(tmp_path):
    folder = tmp_path / "suite"
    finish(*(started("add", folder, *range(4 * i, 4 * i + 4), stdout=subprocess.DEVNULL) for i in range(4)))
    assert {entry.case for entry in load_manifest(folder).cases} == {f"case{i}" for i in range(16)}
    assert_well(folder)
    assert names(folder) == sorted([*(f"case{i}" for i in range(16)), "maps", "suite.json"])


@pytest.mark.slow
def test_writers_of_the_same_cases_and_a_suite_that_is_replaced_meanwhile(tmp_path):
    folder = tmp_path / "suite"
    add(folder, 0)
    (folder / "notes.md").write_text("mine")
    quiet = {"stdout": subprocess.DEVNULL}
    finish(
        started("rewrite", folder, 20, **quiet),
        started("rewrite", folder, 21, **quiet),
        started("build", folder, 8, **quiet),
    )
    assert_well(folder)
    assert (folder / "notes.md").read_text() == "mine"
    assert names(tmp_path) == ["suite"]
    assert not [name for name in names(folder) if is_temporary(name)]


@pytest.mark.slow
def test_what_three_runs_accept_at_once_is_all_kept(tmp_path):
    add(tmp_path, 0, 1)
    finish(*(started("accept", tmp_path, f"planner{i}", stdout=subprocess.DEVNULL) for i in range(3)))
    assert sorted(load_baseline(tmp_path / "baseline.json").planners) == ["planner0", "planner1", "planner2"]


@pytest.mark.slow
def test_a_suite_merged_into_itself_keeps_what_is_added_meanwhile(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    add(one, 0)
    add(two, *range(1, 12))
    quiet = {"stdout": subprocess.DEVNULL}
    finish(started("merge", one, two, **quiet), started("add", one, *range(20, 28), **quiet))
    assert len(load_manifest(one).cases) == 20
    assert_well(one)


def test_threads_of_one_process_wait_for_each_other(tmp_path):
    threads = [Thread(target=add, args=(tmp_path, *range(3 * i, 3 * i + 3))) for i in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(load_manifest(tmp_path).cases) == 9


def test_a_folder_that_another_does_not_let_go_of_is_said_in_one_line(tmp_path):
    with (
        writing(tmp_path),
        pytest.raises(RegentsError, match=rf"written by another process for 0.05 s \(process {os.getpid()}\): wait"),
        writing(tmp_path, wait_s=0.05),
    ):
        raise AssertionError
    assert names(tmp_path) == []


def test_the_lock_of_a_writer_that_was_killed_is_free(tmp_path):
    (tmp_path / LOCK).write_text("1")
    add(tmp_path, 0)
    assert names(tmp_path) == ["case0", "maps", "suite.json"]


# --- writers that are killed ------------------------------------------------------------------


def killed(what, folder, after_s):
    writer = started(what, folder, 100000, stdout=subprocess.PIPE)
    writer.stdout.readline()
    time.sleep(after_s)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    writer.stdout.close()
    writer.stderr.close()


@pytest.fixture
def suite(tmp_path):
    folder = tmp_path / "suite"
    add(folder, 0, 1)
    (folder / "notes.md").write_text("mine")
    (folder / "pictures" / "deep").mkdir(parents=True)
    (folder / "pictures" / "deep" / "one.txt").write_text("mine too")
    (folder / "case0" / "remark.txt").write_text("and mine")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("what", "times"), [("rewrite", 2), ("build", 2)])
def test_after_a_kill_a_suite_is_whole_and_the_next_writer_cleans_up(suite, what, times):
    dice = random.Random(times)
    for _ in range(times):
        killed(what, suite, dice.uniform(0.0, 0.3))
        assert_survived(suite)
    assert_cleaned_up(suite)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["rewrite", slow("build")])
@pytest.mark.parametrize("exchange", ["yes", slow("no")])
@pytest.mark.parametrize("stride", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_after_a_kill_before_a_change_to_the_disk_a_suite_is_whole(suite, what, exchange, stride):
    finish(started("die_everywhere", suite, what, exchange, stride, stdout=subprocess.DEVNULL))


def test_a_writer_that_lives_keeps_what_it_works_on(tmp_path):
    with new_folder(tmp_path / "target") as fresh:
        clear_leftovers(tmp_path)
        assert fresh.exists()
        (tmp_path / f".other.{'0' * 8}.tmp").mkdir()
        (tmp_path / f".file.{'1' * 8}.tmp").write_text("")
        clear_leftovers(tmp_path)
        assert names(tmp_path) == [fresh.name]
    assert names(tmp_path) == ["target"]


def test_a_file_is_written_into_the_folder_that_takes_the_place_of_another(tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    real, moved = os.replace, []

    def replace(source, target):
        if not moved:
            moved.append((tmp_path / "folder").rename(tmp_path / "old"))
            (tmp_path / "folder").mkdir()
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    write_atomic(tmp_path / "folder" / "file", b"content")
    assert (tmp_path / "folder" / "file").read_bytes() == b"content"


# --- what a user sees -------------------------------------------------------------------------


def test_leftovers_are_no_problem_of_a_suite(suite):
    for name in (f".case0.{'0' * 8}.tmp", f".case0.{'0' * 8}.tmp.old"):
        shutil.copytree(suite / "case0", suite / name)
    (suite / LOCK).write_text("1")
    assert_well(suite)
    assert len(find_cases(suite)) == 2


def test_a_damaged_map_is_written_again(suite):
    (map_,) = (suite / "maps").iterdir()
    whole = map_.read_bytes()
    map_.write_bytes(gzip.compress(gzip.decompress(whole), 1, mtime=5))  # the same map, packed by another zlib
    other = map_.read_bytes()
    add(suite, 0)
    assert map_.read_bytes() == other
    map_.write_bytes(whole[:-9] + b"damaged..")
    add(suite, 0)
    assert map_.read_bytes() == whole
    assert_well(suite)


@pytest.mark.parametrize(("mask", "folders", "files"), [(0o077, 0o700, 0o600), (0o002, 0o775, 0o664)])
def test_the_umask_decides_who_may_read(tmp_path, mask, folders, files):
    before = os.umask(mask)
    try:
        add(tmp_path / "suite", 0)
        write_suite(tmp_path / "built", [case("case0", 0)], 0)
    finally:
        os.umask(before)
    made = [*(tmp_path / "suite").rglob("*"), *(tmp_path / "built").rglob("*"), tmp_path / "suite", tmp_path / "built"]
    assert {path.stat().st_mode & 0o777 for path in made if path.is_dir()} == {folders}
    assert {path.stat().st_mode & 0o777 for path in made if path.is_file()} == {files}
