"""A suite with something else in place of one of its files or folders, and all that is done with a suite.

A stranger's archive holds links, hard links and pipes as well, and who unpacks it as root even devices.
"""

import os
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes import platoon

from regents_cosim.attacks.methods.presets import KING
from regents_cosim.benchmarks.runs import ComparedMethod, run_once
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import STILL
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.scores import MethodRun
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.evaluation.regression.baseline import FILE, DriveOutcome, update_baseline
from regents_cosim.evaluation.regression.evaluate import drive_once
from regents_cosim.evaluation.suites.folders import check_suite, judge_into, merge_into, write_suite
from regents_cosim.exports.export import export
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.reports.report import report_of, save_report
from regents_cosim.runs.growing import open_explored
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import FOLDER, DoneUnit, WorkUnit, open_ledger
from regents_cosim.runs.status import runs_in
from regents_cosim.runs.steps import Steps
from regents_cosim.runs.windows import planned, record_once, recorded
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.scenario import Scenario

_PATIENCE_S = 40  # a hang is endless; a drive whose program is compiled on a busy machine takes ten seconds
_CASE = "platoon0"
_DEAD = f".{_CASE}.01234567.tmp"  # what a writer that was killed left
MINE = identity("record", {"of": "a test"}, {})


class HangsError(Exception):
    """Raised where code would wait for ever."""


class _StoppedError(Exception):
    """Stands for a kill between two units of work."""


def _case(seed: int = 0) -> Scenario:
    return platoon(3, seed)


# --- what is done with a suite ----------------------------------------------------------------


def _record(suite: Path) -> None:
    record_once(suite, MINE, "traffic", 0, lambda: [_case(), _case(2)])


def _stop_recording(suite: Path) -> None:
    with suppress(_StoppedError), open_ledger(suite, MINE) as ledger:
        recorded(ledger, "key", lambda: [_case(), _case(3)])
        for unit in ledger.left()[:1]:
            ledger.note(DoneUnit(unit))
        raise _StoppedError


def _go_on(suite: Path) -> None:
    with open_ledger(suite, MINE) as ledger:
        windows = recorded(ledger, "key", lambda: [_case(), _case(4)])
        for scenario in [windows.fetch(unit.name) for unit in ledger.left()]:
            SuiteWriter(suite, 0).add(scenario)
            ledger.note(DoneUnit(next(unit for unit in ledger.left() if unit.name == scenario.id)))
        ledger.finish()


def _forget_windows(suite: Path) -> None:
    with open_ledger(suite, MINE) as ledger:
        ledger.plan("", [WorkUnit("traffic", "key")])
        ledger.note(DoneUnit(WorkUnit("traffic", "key"), ((_CASE, "hash"),)))
        planned(ledger, recorded(ledger, "other", lambda: [_case(5)]))
        drop_cases([_CASE], suite)
        ledger.finish()


def _drive(suite: Path) -> None:
    planner = PlannerUnderTest.of("idm")
    list(
        drive_once(
            suite,
            [_case()],
            planner,
            {},
            lambda left: (DriveResult(one.id, "") for one in left),
        )
    )


def _steps(suite: Path) -> None:
    steps = Steps(suite)
    steps.recorded("x", {}, "traffic", lambda: [_case()])
    steps.clear()


def _table(suite: Path) -> None:
    made = MethodRun("method", "idm", 0, [[_case()]], [], 0.0, ())
    run_once(suite, ComparedMethod("method", KING), PlannerUnderTest.of("idm"), [_case()], lambda: made)


def _accept(suite: Path) -> None:
    now = DriveOutcome(content_hash(_case()), "no_collision")
    update_baseline(suite / FILE, lambda before: before.accepting("idm", "mirror", {_CASE: now}, {_CASE}))


def _explore(suite: Path) -> None:
    open_explored(suite, "key", "idm", "king").note("window", "kind")


DEEDS: dict[str, Callable[[Path], Any]] = {
    "add": lambda suite: SuiteWriter(suite, 0).add(_case()),
    "add another": lambda suite: SuiteWriter(suite, 0).add(_case(1)),
    "drop": lambda suite: drop_cases([_CASE], suite),
    "accept": _accept,
    "explore": _explore,
    "record": _record,
    "stop": _stop_recording,
    "go on": _go_on,
    "forget": _forget_windows,
    "drive": _drive,
    "steps": _steps,
    "table": _table,
    "write": lambda suite: write_suite(suite, [_case(6)], 0),
    "merge": lambda suite: merge_into(suite, [suite], 0),
    "judge": lambda suite: judge_into(suite, suite),
    "status": runs_in,
    "check": lambda suite: list(check_suite(suite)),
    "load": load_suite,
    "report": lambda suite: save_report(report_of([_case()], {}, suite), suite / "report.html"),
    "export": lambda suite: export(_case(), "csv", suite / "export"),
}


def whole_suite(folder: Path) -> Path:
    """A suite with everything that we may write into one, as it is while a run is stopped."""
    for seed in range(2):
        case = SuiteWriter(folder, 0).add(_case(seed))
        (case / STILL).write_bytes(b"made by regents_cosim")
    _accept(folder)
    _explore(folder)
    _stop_recording(folder)
    Steps(folder).recorded("x", {}, "traffic", lambda: [_case()])
    _table(folder)
    for name in ("report.html", "report.report.json"):
        (folder / name).write_bytes(b"made by regents_cosim")
    for place in (folder / _DEAD, folder / f"{_DEAD}.old", folder / "export"):
        shutil.copytree(folder / _CASE, place)
    for place in (folder, folder / FOLDER, folder / FOLDER / "windows", folder / "maps"):
        (place / ".suite.json.01234567.tmp").write_bytes(b"cut off")
        (place / ".lock").write_bytes(b"1")
    return folder


def places(suite: Path) -> list[Path]:
    """All files and folders of a suite, as paths below it: one of those that are alike is enough."""
    found = sorted(path.relative_to(suite) for path in suite.rglob("*"))
    return [path for path in found if "platoon1" not in path.parts and "export" not in path.parts[:-1]]


# --- what is in the place of one --------------------------------------------------------------


def _to_folder(path: Path, precious: Path) -> None:
    path.symlink_to(precious / "folder")


def _to_file(path: Path, precious: Path) -> None:
    path.symlink_to(precious / "file")


def _to_itself_elsewhere(path: Path, precious: Path) -> None:
    """Link a folder to a copy elsewhere that has everything that is looked for."""
    path.symlink_to(precious / "same")


def _to_nothing(path: Path, precious: Path) -> None:
    path.symlink_to(precious / "new")


def _second_name(path: Path, precious: Path) -> None:
    os.link(precious / ("file" if (precious / "same").is_dir() else "same"), path)


def _pipe(path: Path, _: Path) -> None:
    os.mkfifo(path)


def _device(path: Path, _: Path) -> None:
    os.mknod(path, 0o600 | 0o020000, os.makedev(1, 5))  # /dev/zero


KINDS: dict[str, Callable[[Path, Path], None]] = {
    "link to a folder": _to_folder,
    "link to a file": _to_file,
    "link to the same": _to_itself_elsewhere,
    "link to nothing": _to_nothing,
    "second name": _second_name,
    "pipe": _pipe,
    "device": _device,
}


@dataclass(frozen=True)
class Spoilt:
    """A suite in which something else is in the place of something, and what is around it."""

    suite: Path
    precious: Path
    before: dict[str, bytes]

    def harm(self) -> list[str]:
        """The changes outside the suite, or of the user's own files in it."""
        after = _content(self.precious)
        return sorted(name for name in self.before.keys() | after.keys() if self.before.get(name) != after.get(name))


def spoilt(whole: Path, place: Path, kind: str, work: Path) -> Spoilt:
    """A copy of the suite `whole` in `work`, with something else in that place. Raises OSError where it cannot be."""
    shutil.rmtree(work, ignore_errors=True)
    suite = Path(shutil.copytree(whole, work / "suite", symlinks=True))
    precious = work / "precious"
    shutil.copytree(whole, precious / "folder")
    (precious / "file").write_bytes(b"precious")
    same = precious / "same"
    (shutil.copytree if (whole / place).is_dir() else shutil.copy)(whole / place, same)
    there = suite / place
    shutil.rmtree(there) if there.is_dir() else there.unlink()
    KINDS[kind](there, precious)
    return Spoilt(suite, precious, _content(precious))


def _content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


@contextmanager
def in_time(seconds: int = _PATIENCE_S) -> Iterator[None]:
    """Raise HangsError in a block that takes longer."""

    def give_up(*_: object) -> None:
        raise HangsError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def problem(whole: Path, place: Path, kind: str, deed: str, work: Path) -> str:
    """The problem that a deed has with such a suite; empty where all is well."""
    found = spoilt(whole, place, kind, work)
    what = f"{deed!r} with a {kind} in place of {place}"
    try:
        with in_time():
            DEEDS[deed](found.suite)
    except RegentsError as error:
        if "\n" in str(error) or not str(error):
            return f"{what}: said {error}"
    except HangsError:
        return f"{what}: hangs"
    except Exception as error:
        return f"{what}: {type(error).__name__}: {error}"
    if harm := found.harm():
        return f"{what}: changed {', '.join(harm[:3])}"
    return ""


def problems(whole: Path, place: Path, kind: str, work: Path, deeds: Sequence[str] = tuple(DEEDS)) -> list[str]:
    """The problems of many deeds."""
    return [said for deed in deeds if (said := problem(whole, place, kind, deed, work))]
