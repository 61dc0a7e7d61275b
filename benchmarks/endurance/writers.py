"""Processes that write into one suite at once, while another reads it: all that was saved is there.

    python -m benchmarks.endurance.writers --rounds 20 --writers 4 --adds 25

In each round every writer saves cases of its own and one that all of them save, and accepts outcomes of planners of its
own into the baseline; a reader loads the suite again and again meanwhile. Afterwards the suite has to hold every case
and every accepted outcome, and nothing else.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import shipped
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.regression.baseline import FILE, Baseline, DriveOutcome, load_baseline, update_baseline
from regents_cosim.evaluation.suites.folders import check_suite
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.scenario import Scenario

_SHARED = "of-all"  # the case that every writer saves


@dataclass
class Tally:
    """The results of all rounds."""

    rounds: int = 0
    cases_saved: int = 0
    cases_lost: int = 0
    outcomes_accepted: int = 0
    outcomes_lost: int = 0
    reads: int = 0
    problems: list[str] = field(default_factory=list)

    @property
    def failures(self) -> int:
        """Everything that must not happen."""
        return self.cases_lost + self.outcomes_lost + len(self.problems)


def write(suite: Path, name: str, adds: int) -> None:
    """Write cases as one of the writers."""
    case, writer = _case(), SuiteWriter(suite, 0)
    for index in range(adds):
        for own in (replace(case, id=f"{name}-{index}"), replace(case, id=_SHARED)):
            writer.add(own)
        _accept(suite, f"{name}-{index}", own)


def read(suite: Path, until: Path) -> int:
    """Load all that is listed until the file `until` is there; how often. Raises RegentsError."""
    rounds = 0
    while not until.exists():
        if (suite / "suite.json").exists():
            for entry in load_manifest(suite).cases:
                load_case(suite / entry.case)
            load_baseline(suite / FILE)
            rounds += 1
    return rounds


def run(rounds: int, writers: int, adds: int, work: Path) -> Tally:
    """All rounds, each in a suite of its own."""
    tally = Tally()
    for number in range(rounds):
        suite, over = work / f"suite-{number}", work / f"over-{number}"
        names = [f"writer-{index}" for index in range(writers)]
        reader = _start("read", suite, over)
        for process in [_start("write", suite, name, adds) for name in names]:
            _, said = process.communicate()
            if process.returncode:
                tally.problems.append(f"a writer failed: {said[-300:]}")
        over.touch()
        counted, said = reader.communicate()
        tally.problems += [f"the reader failed: {said[-300:]}"] if reader.returncode else []
        tally.reads += int(counted or 0)
        _count(suite, [f"{name}-{index}" for name in names for index in range(adds)], tally)
    return tally


def _count(suite: Path, names: list[str], tally: Tally) -> None:
    listed = {entry.case for entry in load_manifest(suite).cases}
    accepted = load_baseline(suite / FILE).planners
    tally.rounds += 1
    tally.cases_saved += len(names) + 1
    tally.cases_lost += len({*names, _SHARED} - listed)
    tally.outcomes_accepted += len(names)
    tally.outcomes_lost += len(set(names) - set(accepted))
    tally.problems += [f"{row.case}: {row.problem}" for row in check_suite(suite) if row.problem]
    tally.problems += [f"{path.name} is left over" for path in suite.iterdir() if path.name.endswith(".old")]


def _accept(suite: Path, planner: str, case: Scenario) -> None:
    now = DriveOutcome(content_hash(case), "no_collision")

    def accepted(before: Baseline) -> Baseline:
        return before.accepting(planner, "mirror", {case.id: now}, {case.id})

    update_baseline(suite / FILE, accepted)


def _case() -> Scenario:
    suite = shipped("scenarios") / "quickstart"
    return load_case(suite / load_manifest(suite).cases[0].case)


def _start(*words: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "benchmarks.endurance.writers", *map(str, words)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
    )


def main() -> None:
    """Print one JSON line; return exit code 1 where something was lost."""
    if sys.argv[1:2] == ["write"]:
        write(Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
        return
    if sys.argv[1:2] == ["read"]:
        print(read(Path(sys.argv[2]), Path(sys.argv[3])))
        return
    options = argparse.ArgumentParser()
    options.add_argument("--rounds", type=int, default=20)
    options.add_argument("--writers", type=int, default=4)
    options.add_argument("--adds", type=int, default=25)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as work:
        tally = run(given.rounds, given.writers, given.adds, Path(work))
    print(json.dumps(asdict(tally)))
    sys.exit(1 if tally.failures else 0)


if __name__ == "__main__":
    try:
        main()
    except RegentsError as error:
        sys.exit(str(error))
