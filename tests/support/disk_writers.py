"""Writes to a suite from a separate process, for tests of writers that meet and of writers that are killed.

Run as `python disk_writers.py WHAT FOLDER ...`; the longer it runs, the more a kill can hit.
"""

import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

from scenes import platoon

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.evaluation.regression.baseline import DriveOutcome, update_baseline
from regents_cosim.evaluation.suites.folders import check_suite, merge_into, write_suite
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.files import swap

CHANGES = {"rename", "mkdir", "remove", "rmdir", "link", "truncate"}


def case(name, version):
    """A possible content of the case `name`."""
    return replace(platoon(cars=3), id=name, target=(float(version), 0.0))


def add(folder, *numbers):
    """Add a case for each number."""
    writer = SuiteWriter(folder, 0)
    for number in numbers:
        writer.add(case(f"case{number}", 0))


def rewrite(folder, times):
    """Write two cases again and again, each time with another content."""
    writer = SuiteWriter(folder, 0)
    for time in range(int(times)):
        writer.add(case(f"case{time % 2}", time))


def build(folder, times):
    """Replace the suite again and again, by two cases or by three."""
    for time in range(int(times)):
        write_suite(folder, [case(f"case{i}", time) for i in range(2 + time % 2)], 0)


def accept(folder, planner):
    """Accept what a planner does in the cases."""
    driven = {name: DriveOutcome(content_hash(case(name, 0)), "no_collision") for name in ("case0", "case1")}
    update_baseline(folder / "baseline.json", lambda now: now.accepting(planner, "mirror", driven, driven))


def merge(folder, *others):
    """Merge a suite with others into itself."""
    merge_into(folder, [folder, *map(Path, others)], 0)


def die_everywhere(folder, what, exchange, stride):
    """Let copies of this process do it and end before their first change to the disk, one `stride` on, and so on."""
    if exchange == "no":
        swap._renameat2 = lambda: None
    act = {"rewrite": rewrite, "build": build}[what]
    point = 1
    while ended_early(lambda: act(folder, 1), point):
        assert_survived(folder)
        point += int(stride)
    assert point > 20
    assert_cleaned_up(folder)


def ended_early(act, point):
    """Whether a copy of this process, doing `act`, ended at its change number `point` to the disk, before making it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which the copy does not use
        process = os.fork()
    if process:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
    left = [point]

    def count(event, arguments):
        changes = event.startswith("os.") and event.removeprefix("os.") in CHANGES
        if changes or (event == "open" and arguments[2] & os.O_CREAT):
            left[0] -= 1
            if left[0] == 0:
                os._exit(9)

    try:
        sys.addaudithook(count)
        act()
    finally:
        os._exit(0)
    return False


def started(what, *arguments, **options):
    """Do one of these in a process of its own."""
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    command = [sys.executable, __file__, what, *map(str, arguments)]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.PIPE, **options)


# --- what has to hold --------------------------------------------------------------------------


def assert_well(folder):
    """Every case whole and listed, and nothing that a user would not expect."""
    assert not [row for row in check_suite(folder) if row.problem]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def assert_survived(folder):
    assert_well(folder)
    assert {entry.case for entry in load_manifest(folder).cases} in ({"case0", "case1"}, {"case0", "case1", "case2"})
    assert (folder / "notes.md").read_text() == "mine"
    assert (folder / "pictures" / "deep" / "one.txt").read_text() == "mine too"
    assert (folder / "case0" / "remark.txt").read_text() == "and mine"


def assert_cleaned_up(folder):
    build(folder, 1)
    rewrite(folder, 2)
    assert_survived(folder)
    assert names(folder.parent) == [folder.name]
    assert not set(names(folder)) - {"case0", "case1", "maps", "notes.md", "pictures", "suite.json", "baseline.json"}
    assert names(folder / "case0") == ["remark.txt", "scenario.json", "tracks.npz"]


if __name__ == "__main__":
    _, what, folder, *rest = sys.argv
    sys.stdout.write("begun\n")
    sys.stdout.flush()
    globals()[what](Path(folder), *rest)
