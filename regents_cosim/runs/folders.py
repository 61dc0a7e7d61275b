"""Record traffic, attack, and grow a suite in a folder; a run that was stopped continues there.

The commands `regents record` and `regents attack` are these functions, with a terminal as `progress`.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import require_own
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError, require
from regents_cosim.runs.attack_run import attack_left
from regents_cosim.runs.behaviour_map import NAMES, archive_of
from regents_cosim.runs.growing import Budget, GrowingSuite, Growth, SuiteIntake, open_explored
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import Ledger, LedgerRecord, open_ledger, redo_lost, require_free
from regents_cosim.runs.requests import WantedManoeuvres
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.traffic import SavedCases, Traffic
from regents_cosim.runs.window_job import AttackRun, Still
from regents_cosim.runs.windows import RunWindows, planned, record_once, recorded, windows_in
from regents_cosim.saving import SuiteWriter, make_suite
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.workers import executor_for, local_processes


def record_into(
    folder: Path | str, traffic: Traffic, *, executor: str = "local", progress: Progress = SILENT
) -> list[str]:
    """Record traffic into a folder, unless it is there already; return the names of the cases in order.

    `executor` is "local" or `dask:ADDRESS`. Raises RegentsError.
    """

    def record() -> list[Scenario]:
        with executor_for(executor) as pool:
            return traffic.record(pool, progress)

    mine = identity("record", traffic.settings(), {})
    return record_once(Path(folder), mine, traffic.digest(), traffic.seed, record)


def attack_into(
    folder: Path | str,
    run: AttackRun,
    windows: Traffic | SavedCases,
    *,
    still: Still | None = None,
    shard: Shard = WHOLE,
    retry: bool = False,
    executor: str = "local",
    progress: Progress = SILENT,
) -> LedgerRecord:
    """Do what is missing of an attack in a folder; return the ledger that tells what the folder then holds.

    `still` draws the pictures that `run.pictures` asks for (`reports.picture.still`); without it there are none.
    `retry` tries windows again that failed before. Workers of `executor` ("local" or `dask:ADDRESS`) attack one window
    at a time. Raises RegentsError, also where the folder was begun with other settings.
    """
    folder = Path(folder)
    if run.wanted:
        run.wanted.require_possible(run.config)
    if executor != "local":
        run = replace(run, engine="threads", batch=1)
    if still is None:
        run = replace(run, pictures=False)
    picture = still if run.pictures else None
    if run.wanted and shard.count > 1:
        raise RegentsError(
            "--manoeuvre counts the crashes of a whole run: leave out --shard (--shard 1/1 in a SLURM array)"
        )
    together = run.together()
    mine = run.identity(windows.settings(), together)
    require_free(folder, mine, shard)
    suite, rounds = SuiteWriter(folder, windows.seed), _rounds(windows)
    with (
        open_ledger(folder, mine, shard, together) as ledger,
        executor_for(executor) as cluster,
        local_processes() as sumo,
    ):
        redo_lost(ledger)
        for some in rounds(ledger, run.wanted, retry, cluster or sumo, progress):
            _say_where(ledger, retry, progress)
            attack_left(
                ledger, some, run, suite, still=picture, retry=retry, cluster=cluster, sumo=sumo, progress=progress
            )
        if run.wanted is not None:
            ledger.end()
            progress.say(run.wanted.said(run.wanted.found_in(ledger.record, folder), ledger.record, ended=True))
        ledger.finish()
        return ledger.record


def grow_suite(
    suite: Path | str,
    run: AttackRun,
    windows: Traffic | SavedCases,
    *,
    minutes: float | None = None,
    output: Path | str | None = None,
    still: Still | None = None,
    progress: Progress = SILENT,
) -> Growth:
    """Add to a suite the crashes that are new on the map of behaviours; a missing suite is made.

    A run attacks one round of windows: `windows.count` that no run before attacked, or all saved cases. With `minutes`
    further rounds follow until then; attacks that have begun by then are finished. Windows in the least explored
    surroundings come first. New cases are also saved in the suite `output` where one is given. Raises RegentsError.
    """
    budget, suite = Budget.of(minutes), Path(suite)
    require(run.judge, "--into chooses by the judgement: leave out --no-judge", RegentsError)
    require_own(suite, "--into")
    traffic = _digest(windows)  # raises before a suite is made
    make_suite(suite, windows.seed)
    copy = None if output is None else SuiteWriter(Path(output), windows.seed).add
    key = run.identity({}, run.together()).key(*NAMES)
    explored = open_explored(suite, key, run.planner.name, run.config.method)
    picture = still if run.pictures else None
    intake = SuiteIntake(suite, archive_of(find_cases(suite)), picture, run.verify, copy)
    growing = GrowingSuite(intake, explored, run, progress)
    return growing.grow(traffic, partial(_windows_of_round, windows, progress), budget)


def _rounds(windows: Traffic | SavedCases) -> Callable[..., Iterator[RunWindows]]:
    """The rounds of windows that a run attacks; what cannot be read raises RegentsError here, before it begins."""
    if isinstance(windows, SavedCases):
        return partial(_saved, windows_in(windows.path))
    return partial(_recorded, windows, windows.digest())


def _saved(windows: RunWindows, ledger: Ledger, *_: object) -> Iterator[RunWindows]:
    planned(ledger, windows)
    yield windows


def _recorded(
    traffic: Traffic, digest: str, ledger: Ledger, wanted: WantedManoeuvres | None, retry: bool, pool: Executor,
    progress: Progress,
) -> Iterator[RunWindows]:  # fmt: skip
    """One round; where crashes are asked for more rounds follow, as long as there are too few."""
    counts = [traffic.count] if wanted is None else list(wanted.windows())
    keys = {count: ledger.record.begun.identity.key(digest, str(count)) for count in counts}
    begun = next((count for count, key in keys.items() if ledger.record.plan and ledger.record.plan.key == key), 0)
    for count in (count for count in counts if count >= begun):
        before = len(ledger.record.own)
        record = partial(replace(traffic, count=count).record, pool, progress)
        yield recorded(ledger, keys[count], record, retry, more=count > counts[0])
        assert ledger.record.plan is not None
        used_up = ledger.record.plan.ended or (count != begun and len(ledger.record.own) == before)
        if wanted is None or used_up:
            return
        found = wanted.found_in(ledger.record, ledger.folder)
        if wanted.is_met(found):
            return
        progress.say(wanted.said(found, ledger.record, ended=False))


def _windows_of_round(windows: Traffic | SavedCases, progress: Progress, number: int) -> Sequence[Scenario]:
    """The windows of a round: of traffic with the next seed; the only round of cases has all of them."""
    if isinstance(windows, SavedCases):
        return load_suite(windows.path) if number == 0 else []
    return replace(windows, seed=windows.seed + number).record(None, progress)


def _digest(windows: Traffic | SavedCases) -> str:
    """What windows are recorded from, and how; of cases, their hashes."""
    cases = isinstance(windows, SavedCases)
    said = windows_in(windows.path).hashes if cases else [windows.settings(), windows.digest()]
    return hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()[:20]


def _say_where(ledger: Ledger, retry: bool, progress: Progress) -> None:
    """Say what sessions before have done, if anything."""
    own, left = len(ledger.record.own), len(ledger.left(retry))
    if ledger.changed:
        progress.say(f"changed since: {', '.join(ledger.changed)}; what depends on them is done again")
    failed = sum(bool(one.error) for one in ledger.record.finished)
    if own > left or failed:
        hint = f", {failed} failed before (--retry tries them again)" if failed and not retry else ""
        progress.say(f"{own - left} of {own} windows are done already{hint}")
