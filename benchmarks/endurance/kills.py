"""Commands killed at random moments: what was whole before stays whole, and nothing keeps running.

    python -m benchmarks.endurance.kills --count 1000 --seed 0

Half of the moments are spread over the command's whole run, half follow within milliseconds upon a change in
the folder that it writes to, where a rename may be half done. SIGKILL and SIGTERM go to the command alone, as
`timeout` and `docker stop` send them; SIGINT to the command alone or to its whole group, as Ctrl-C does.
"""

import argparse
import json
import math
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from benchmarks.endurance.processes import REGENTS, Marked, start
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import network_config, shipped
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, load_baseline
from regents_cosim.evaluation.suites.folders import write_suite
from regents_cosim.scenario.scenario import Scenario

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LEAVES_WITHIN_S = 2.0  # after SIGINT and SIGTERM, promised
_HANGS_S = 30.0
_ORPHANS_S = 3.0  # children may take so long to notice that their parent is gone
_NOTES = "notes.md"  # a file of the user's own, in the folder that is written to


@dataclass(frozen=True)
class Job:
    """A command, the folder that it writes to, and what has to hold there whenever it is killed."""

    name: str
    words: Callable[[Path], Sequence[object]]
    output: str
    check: Callable[[Path, Path], list[str]]  # (folder as it was, folder as it is): what is wrong
    ours: str = r"bin/regents|regents_cosim/"  # files in a traceback that must not be shown; Python's own start is not


@dataclass(frozen=True)
class Outcome:
    """The state after one kill."""

    signal: str
    finished_first: bool  # the command had ended before the signal
    exit_code: int | None  # None: it did not end within 30 s
    exit_s: float
    wrong: tuple[str, ...]  # what is lost or damaged
    orphans: tuple[str, ...]
    said: str  # on stderr
    traceback: bool  # the user was shown one

    @property
    def wrong_exit_code(self) -> bool:
        """Neither that of the signal nor that of a run that ended by itself."""
        return self.exit_code is not None and self.exit_code not in _CODES[self.signal]

    @property
    def problems(self) -> tuple[str, ...]:
        """The broken promises in words; empty where all were kept."""
        found = [*self.wrong, *(f"still running: {one}" for one in self.orphans)]
        if self.traceback or self.wrong_exit_code or self.exit_code is None:
            found.append(f"exit code {self.exit_code}, said: {self.said[-1500:]}")
        return tuple(f"{self.signal}: {problem}" for problem in found)


@dataclass
class Tally:
    """The results of killing one command."""

    job: str
    kills: int = 0
    finished_first: int = 0
    lost_or_damaged: int = 0
    orphans: int = 0
    tracebacks: int = 0
    hangs: int = 0
    wrong_exit_codes: int = 0
    slow_exits: int = 0  # SIGINT or SIGTERM: more than 2 s
    slowest_exit_s: float = 0.0
    signals: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        """Count one kill."""
        self.kills += 1
        self.signals[outcome.signal] = self.signals.get(outcome.signal, 0) + 1
        self.finished_first += outcome.finished_first
        self.lost_or_damaged += bool(outcome.wrong)
        self.orphans += len(outcome.orphans)
        self.tracebacks += outcome.traceback
        self.hangs += outcome.exit_code is None
        self.wrong_exit_codes += outcome.wrong_exit_code
        if outcome.signal != signal.SIGKILL.name and not outcome.finished_first:
            self.slow_exits += outcome.exit_s > LEAVES_WITHIN_S
            self.slowest_exit_s = max(self.slowest_exit_s, round(outcome.exit_s, 2))
        self.problems += outcome.problems

    @property
    def failures(self) -> int:
        """Broken promises, slow exits left out: they depend on what else the machine does."""
        return self.lost_or_damaged + self.orphans + self.tracebacks + self.hangs + self.wrong_exit_codes


# --- what has to hold ---------------------------------------------------------------------------


def _suite_whole(before: Path, now: Path) -> list[str]:
    """All cases from before are listed, all listed cases load, the user's notes and the baseline are there."""
    wrong = [] if (now / _NOTES).is_file() else ["the user's notes are gone"]
    try:
        entries = load_manifest(now).cases
        wrong += [f"{e.case} was listed before" for e in load_manifest(before).cases if e.case not in _names(entries)]
        for entry in entries:
            load_case(now / entry.case)
        load_baseline(now / "baseline.json")
    except RegentsError as error:
        wrong.append(str(error))
    if (before / "baseline.json").exists() and not (now / "baseline.json").exists():
        wrong.append("the baseline is gone")
    return wrong + _stray(now)


def _suite_old_or_new(before: Path, now: Path) -> list[str]:
    """A suite that is replaced at once: one of the two, whole."""
    try:
        names = _names(load_manifest(now).cases)
        for name in names:
            load_case(now / name)
    except RegentsError as error:
        return [str(error)]
    kept = [] if (now / _NOTES).is_file() else ["the user's notes are gone"]
    return kept + [f"{p.name} is not listed" for p in _case_folders(now) if p.name not in names] + _stray(now)


def _baseline_whole(before: Path, now: Path) -> list[str]:
    """Accepted outcomes are those from before, or with what was accepted now."""
    try:
        old, new = load_baseline(before / "baseline.json"), load_baseline(now / "baseline.json")
    except RegentsError as error:
        return [str(error)]
    lost = set(old.of("idm", "mirror")) - set(new.of("idm", "mirror"))
    return [f"accepted outcomes are lost: {sorted(lost)}"] if lost else _suite_whole(before, now)


def _page_whole(_: Path, now: Path) -> list[str]:
    page, table = now / "report.html", now / "report.report.json"
    wrong = []
    if page.exists() and not page.read_text().rstrip().endswith("</html>"):
        wrong.append("the page is cut off")
    if table.exists():
        try:
            json.loads(table.read_text())
        except ValueError as error:
            wrong.append(f"the report's JSON is cut off: {error}")
    return wrong + _stray(now)


def _export_whole(_: Path, now: Path) -> list[str]:
    out = now / "exported"
    if not out.exists():
        return []
    missing = {"case.sumocfg"} - {path.name for path in out.iterdir()}
    return [f"exported without {sorted(missing)}"] if missing else []


def _weights_whole(_: Path, now: Path) -> list[str]:
    from safetensors import SafetensorError, safe_open

    weights = now / "weights.safetensors"
    try:
        if weights.exists():
            with safe_open(weights, "numpy") as file:
                for name in file.keys():  # noqa: SIM118  it is no mapping
                    file.get_tensor(name)
    except SafetensorError as error:
        return [f"the weights are damaged: {error}"]
    return []


def _stray(now: Path) -> list[str]:
    """Case folders that are not whole. Hidden leftovers are the next writer's to remove."""
    wrong = []
    for folder in _case_folders(now):
        try:
            load_case(folder)
        except RegentsError as error:
            wrong.append(str(error))
    return wrong


def _case_folders(suite: Path) -> Iterator[Path]:
    for path in suite.iterdir():
        if path.is_dir() and not path.name.startswith(".") and path.name != "maps":
            yield path


def _names(entries: Sequence[object]) -> set[str]:
    return {entry.case for entry in entries}  # type: ignore[attr-defined]


# --- the commands -------------------------------------------------------------------------------

_PYTEST = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", ".")

JOBS = (
    Job("record", lambda at: [REGENTS, "record", "-c", network_config("merge"), "--count", 3, "-o", at / "suite"],
        "suite", _suite_whole),
    Job("attack", lambda at: [REGENTS, "attack", at / "cases", "--method", "regents", "-o", at / "suite"],
        "suite", _suite_whole),
    Job("attack focused, own planner",
        lambda at: [REGENTS, "attack", at / "cases", "--method", "focused", "--iterations", 30,
                    "--planner", at / "slow.py:Slow",
                    "-o", at / "suite"],
        "suite", _suite_whole),
    Job("evaluate --update in SUMO",
        lambda at: [REGENTS, "evaluate", at / "suite", "--planner", "log_replay", "--in", "sumo", "--update"],
        "suite", _baseline_whole),
    Job("suite build",
        lambda at: [REGENTS, "suite", "build", "--nets", "merge", "--windows", 2, "--adversarial", 1,
                    "--not-preventable", 0, "--ordinary", 1, "-o", at / "suite"],
        "suite", _suite_old_or_new),
    Job("suite merge", lambda at: [REGENTS, "suite", "merge", at / "cases", at / "attacked", "-o", at / "suite"],
        "suite", _suite_old_or_new),
    Job("report",
        lambda at: [REGENTS, "report", at / "attacked", "--planner", "idm", "-o", at / "suite" / "report.html"],
        "suite", _page_whole),
    Job("export",
        lambda at: [REGENTS, "export", _first(at / "attacked"), "--to", "fcd", "-o", at / "suite" / "exported"],
        "suite", _export_whole),
    Job("train aim-bev",
        lambda at: [REGENTS, "train", "aim-bev", at / "cases", "--epochs", 2, "--lessons", 128, "--drives", 0,
                    "-o", at / "suite" / "weights.safetensors"],
        "suite", _weights_whole),
    Job("pytest --regents-update",
        lambda at: [*_PYTEST, "--regents-suite", at / "suite", "--regents-planner", "idm", "--regents-update",
                    at / "empty"],
        "suite", _baseline_whole, ours="regents_cosim/pytest_plugin/"),
)  # fmt: skip

_SLOW = """
import time
from regents_cosim.planners.interface import Control


class Slow:
    def reset(self, scene):
        pass

    def act(self, observation):
        time.sleep(0.002)
        return Control(accel=0.0, curvature=0.0)
"""


def prepare(at: Path, cases: int = 3) -> Path:
    """Shipped cases before and after their attack, a suite with a baseline, and a planner of the user's own."""
    home = shipped("scenarios") / "quickstart"
    attacked = [load_case(home / entry.case) for entry in load_manifest(home).cases[:cases]]
    ordinary = [replace(case.before_attack(), id=f"ordinary-{index}") for index, case in enumerate(attacked)]
    write_suite(at / "cases", ordinary, 0)
    write_suite(at / "attacked", attacked, 0)
    write_suite(at / "suite", attacked, 0, _accepted(attacked))
    (at / "suite" / _NOTES).write_text("mine\n")
    (at / "slow.py").write_text(_SLOW)
    (at / "empty").mkdir()
    return at


def _accepted(cases: Sequence[Scenario]) -> Baseline:
    outcomes = {case.id: _outcome(case) for case in cases}
    return Baseline().accepting("idm", "mirror", outcomes, outcomes)


def _outcome(case: Scenario) -> DriveOutcome:
    hit = case.collision
    if hit is None:
        return DriveOutcome(content_hash(case), "no_collision")
    return DriveOutcome(content_hash(case), "collision", hit.agent, hit.step, hit.time_s, hit.collision_type)


def _first(suite: Path) -> Path:
    """A case of a suite that ends in a collision."""
    for entry in load_manifest(suite).cases:
        attack = load_case(suite / entry.case).attack
        if attack and attack.collision:
            return suite / entry.case
    raise RuntimeError(f"no crash in {suite}")


# --- one kill -----------------------------------------------------------------------------------


def kill_once(job: Job, template: Path, lasts_s: float, dice: random.Random, work: Path, keep: Path | None) -> Outcome:
    """Run `job` on a copy of `template`, kill it, and look at what is left."""
    at = work / f"{dice.getrandbits(48):012x}"
    shutil.copytree(template, at)
    running = start(job.words(at), at, at / "errors.txt")
    number = dice.choice(SIGNALS)
    if dice.random() < 0.5:
        _wait(running, dice.uniform(0.0, 1.05 * lasts_s))
    else:
        _wait_for_writing(running, at / job.output, dice.randint(1, 12), dice.uniform(0.0, 0.004), 1.05 * lasts_s)
    finished_first = running.process.poll() is not None
    if not finished_first:
        running.send(number, number == signal.SIGINT and dice.random() < 0.5)
    sent = time.monotonic()
    code = _exit_code(running)
    said = (at / "errors.txt").read_text(errors="replace")
    outcome = Outcome(
        signal=number.name,
        finished_first=finished_first,
        exit_code=code,
        exit_s=time.monotonic() - sent,
        orphans=tuple(running.left_after(_ORPHANS_S)),
        wrong=tuple(job.check(template / job.output, at / job.output)),
        said=said,
        traceback="Traceback" in said and re.search(job.ours, said) is not None,
    )
    if outcome.problems and keep is not None:
        shutil.copytree(at, keep / at.name, symlinks=True)
    shutil.rmtree(at, ignore_errors=True)
    return outcome


# By the signal, or by itself just before it. pytest has 2 for an interruption.
_CODES = {
    "SIGKILL": {-signal.SIGKILL, 0, 1, 4},
    "SIGTERM": {-signal.SIGTERM, 143, 0, 1, 4},
    "SIGINT": {-signal.SIGINT, 130, 0, 1, 2, 4},
}


def _exit_code(running: Marked) -> int | None:
    try:
        return running.process.wait(_HANGS_S)
    except subprocess.TimeoutExpired:
        running.send(signal.SIGKILL, whole_group=True)
        running.process.wait()
        return None


def _wait(running: Marked, seconds: float) -> None:
    until = time.monotonic() + seconds
    while running.process.poll() is None and time.monotonic() < until:
        time.sleep(min(0.01, max(until - time.monotonic(), 0.0)))


def _wait_for_writing(running: Marked, folder: Path, changes: int, after_s: float, at_most_s: float) -> None:
    """Until the folder has changed so often, and a little longer."""
    until, seen = time.monotonic() + at_most_s, _state(folder)
    while changes and running.process.poll() is None and time.monotonic() < until:
        now = _state(folder)
        changes -= now != seen
        seen = now
        time.sleep(0.0005)
    time.sleep(after_s)


def _state(folder: Path) -> list[tuple[str, int]]:
    found = []
    for place in (folder, folder / "maps", folder.parent):
        try:
            found.append((str(place), place.stat().st_mtime_ns))
        except FileNotFoundError:
            continue
    return found


def run(
    count: int,
    seed: int,
    template: Path,
    work: Path,
    jobs: Sequence[Job] = JOBS,
    workers: int = 1,
    keep: Path | None = None,
    at_most_s: float = math.inf,
) -> list[Tally]:
    """`count` kills of `jobs`, the shorter ones more often; how long each takes undisturbed is measured first.

    None begins later than `at_most_s` after the first.
    """
    lasts = {job.name: _undisturbed(job, template, work) for job in jobs}
    tallies = {job.name: Tally(job.name) for job in jobs}
    dice = random.Random(seed)
    chosen = [*jobs, *dice.choices(jobs, [lasts[job.name] ** -0.5 for job in jobs], k=count)][:count]
    deals = [(job, random.Random(dice.getrandbits(64))) for job in chosen]

    until = time.monotonic() + at_most_s

    def one(deal: tuple[Job, random.Random]) -> Outcome | None:
        job, dice = deal
        return kill_once(job, template, lasts[job.name], dice, work, keep) if time.monotonic() < until else None

    with ThreadPoolExecutor(workers) as pool:
        for (job, _), outcome in zip(deals, pool.map(one, deals), strict=True):
            if outcome is None:
                break
            tallies[job.name].add(outcome)
            for problem in outcome.problems:
                print(f"{job.name}: {problem}", file=sys.stderr)
    return list(tallies.values())


def _undisturbed(job: Job, template: Path, work: Path) -> float:
    at = work / f"whole-{JOBS.index(job)}"
    shutil.copytree(template, at)
    begin = time.monotonic()
    running = start(job.words(at), at, at / "errors.txt")
    code = running.process.wait()
    said = (at / "errors.txt").read_text()
    if code not in (0, 1) or "Traceback" in said:
        raise RuntimeError(f"{job.name}: exit code {code}: {said}")
    seconds = time.monotonic() - begin
    wrong = job.check(template / job.output, at / job.output)
    if wrong:
        raise RuntimeError(f"{job.name}, not killed: {wrong}")
    shutil.rmtree(at)
    return seconds


def main() -> None:
    """Print one JSON line per command; return exit code 1 where a promise was broken."""
    options = argparse.ArgumentParser()
    options.add_argument("--count", type=int, default=1000)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--minutes", type=float, default=math.inf, help="begin no kill later than this")
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--job", action="append", help="only this one; may be given more than once")
    options.add_argument("--keep", type=Path, help="folder for what is left of kills that went wrong")
    given = options.parse_args()
    jobs = [job for job in JOBS if not given.job or job.name in given.job]
    if given.keep:
        given.keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        template = prepare(Path(work) / "template")
        tallies = run(
            given.count, given.seed, template, Path(work), jobs, given.workers, given.keep, 60 * given.minutes
        )
    for tally in tallies:
        print(json.dumps(asdict(tally)))
    sys.exit(1 if any(tally.failures for tally in tallies) else 0)


if __name__ == "__main__":
    main()
