"""Writes, checks and merges whole suites."""

import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import (
    SETTINGS_FILES,
    Suite,
    SuiteEntry,
    has_manifest,
    is_ours,
    load_manifest,
    save_suite,
)
from regents_cosim.cases.provenance import made_by, versions_and_revision
from regents_cosim.cases.suite import CasesOnDisk
from regents_cosim.cases.suite_code import code_for_pytest
from regents_cosim.checks.bounded import kind_in_words
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.evaluation.regression.baseline import FILE, Baseline, load_baseline, save_baseline
from regents_cosim.runs.growing import EXPLORED
from regents_cosim.runs.ledger import FOLDER as RUN
from regents_cosim.runs.ledger import is_written
from regents_cosim.saving import add_case
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import explain_write, is_temporary, new_folder, require_writable
from regents_cosim.system.files.locks import writing
from regents_cosim.system.files.swap import restore
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.verdicts.judge import judge_each


@dataclass(frozen=True)
class CheckRow:
    """The result of checking one case of a suite."""

    case: str
    problem: str  # empty where there is none
    baselines: int  # planners and simulators with an entry
    replayed: str | None = None  # simulator that verified it; None: not replayed
    planner: str | None = None  # the attacked planner


def write_suite(folder: Path, scenarios: Sequence[Scenario], seed: int, baseline: Baseline | None = None) -> None:
    """Let `folder` hold these cases and no others. Other files in the suite stay, including its baseline.

    The complete new suite replaces the old one. Raises RegentsError for a folder that holds something other than a
    suite.
    """
    with _replaced(folder):
        _replace(folder, scenarios, seed, baseline)


def merge_into(folder: Path, suites: Sequence[Path], seed: int) -> int:
    """Let `folder`, which may be one of `suites`, hold the cases and baselines of all; returns the number of cases.

    Raises RegentsError as `merge` and `write_suite` do.
    """
    with _replaced(folder):
        cases, baseline = merge(suites)
        _replace(folder, cases, seed, baseline)
    return len(cases)


def judge_into(folder: Path, suite: Path, progress: Progress = SILENT) -> list[tuple[Scenario, Scenario]]:
    """Let `folder`, which may be `suite` itself, hold its cases with new judgements; returns each before and after.

    Cases without a crash stay as they are. Accepted outcomes stay accepted, since a judgement changes no drive. Raises
    RegentsError as `write_suite` does.
    """
    with _replaced(folder):
        listed = load_manifest(suite)
        before = [load_case(suite / entry.case) for entry in listed.cases]
        after = list(progress.each(judge_each(before), "judging", len(before)))
        old = {entry.case: entry.hash for entry in listed.cases}
        _replace(folder, after, listed.seed, _rehashed(load_baseline(suite / FILE), old, after))
        # The cases are as they were made: by the same command, packages and commit.
        save_suite(folder, replace(load_manifest(folder), command=listed.command, versions=listed.versions))
    return list(zip(before, after, strict=True))


def _rehashed(baseline: Baseline, old: Mapping[str, str], cases: Iterable[Scenario]) -> Baseline:
    """The baseline with the hashes that the cases get when they are saved, for entries of their `old` content."""
    return baseline.rehashed({case.id: (old[case.id], content_hash(case)) for case in cases})


def require_place(folder: Path) -> None:
    """Raise RegentsError where `folder` cannot be written, or holds something other than a suite."""
    require_writable(folder)
    restore(folder.absolute())
    if not folder.exists() or has_manifest(folder):
        return
    if not all(is_temporary(entry.name) or entry.name == RUN for entry in folder.iterdir()):
        raise RegentsError(f"{folder} exists and is not a suite (choose another folder with -o)")


@contextmanager
def _replaced(folder: Path) -> Iterator[None]:
    """Keep other processes from adding to a suite that is being replaced. Raises RegentsError as `require_place`."""
    require_place(folder)
    with explain_write(folder), writing(folder) if folder.exists() else nullcontext():
        yield


def _replace(folder: Path, scenarios: Sequence[Scenario], seed: int, baseline: Baseline | None) -> None:
    target = folder.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    with new_folder(target, is_ours) as fresh:
        notes = Suite((), made_by(), seed, versions_and_revision())
        for scenario in scenarios:
            add_case(scenario, fresh, notes)
        if baseline is not None and baseline.planners:
            save_baseline(fresh / FILE, baseline)


def merge(suites: Sequence[Path]) -> tuple[list[Scenario], Baseline]:
    """The cases of all suites, by name, and their accepted outcomes.

    Raises RegentsError where two suites hold different cases of one name, or different baselines of one case.
    """
    homes: dict[str, tuple[Path, str]] = {}
    cases: dict[str, Scenario] = {}
    for suite in suites:
        for entry in load_manifest(suite).cases:
            other, digest = homes.setdefault(entry.case, (suite, entry.hash))
            if digest != entry.hash:
                raise RegentsError(
                    f"case {entry.case} is in {other} ({digest[:8]}) and in {suite} ({entry.hash[:8]}) "
                    "with different content: rename or remove one of them"
                )
            if entry.case not in cases:
                cases[entry.case] = load_case(suite / entry.case)
    merged = [cases[name] for name in sorted(cases)]
    old = {name: digest for name, (_, digest) in homes.items()}
    return merged, _rehashed(_merged_baselines(suites), old, merged)


def _merged_baselines(suites: Sequence[Path]) -> Baseline:
    merged = Baseline()
    for suite in suites:
        found = load_baseline(suite / FILE)
        for planner, simulators in found.planners.items():
            for where, entries in simulators.items():
                before = merged.of(planner, where)
                clash = next((case for case in entries if before.get(case, entries[case]) != entries[case]), None)
                if clash:
                    raise RegentsError(
                        f"the baselines differ on {clash} ({planner} in {where}), {suite} being the second: "
                        "accept one of them again with `regents evaluate --update`"
                    )
                merged = merged.accepting(planner, where, entries, {*before, *entries})
    return merged


def check_suite(suite: Path, replay: bool = False) -> Iterator[CheckRow]:
    """Check every case, and then further files of the suite; with `replay` also every crash in its simulator.

    A case has to load, with its maps, and match its content hash and the manifest. Baselines have to match the current
    content. A planner that is not ours is accepted, since it is never run because a case names it. Raises CaseError
    where the manifest or the baseline cannot be read.
    """
    entries = load_manifest(suite).cases
    baseline = load_baseline(suite / FILE)
    whole: list[Path] = []
    rows: list[CheckRow] = []
    for entry in entries:
        planner = None
        try:
            scenario = load_case(suite / entry.case)
            planner = scenario.attack.planner if scenario.attack else None
            problem = _mismatch(load_header(suite / entry.case).hash, entry, baseline)
            whole.append(suite / entry.case)
        except CaseError as error:
            problem = str(error)
        rows.append(CheckRow(entry.case, problem, len(_accepted(baseline, entry.case)), planner=planner))
    replays = _replayed(whole) if replay else {}
    for row in rows:
        place, reason = replays.get(row.case, (None, ""))
        yield replace(row, problem=row.problem or reason, replayed=place)
    yield from _left_over(suite, {entry.case for entry in entries}, baseline)


def _mismatch(digest: str, entry: SuiteEntry, baseline: Baseline) -> str:
    """What is wrong with a whole case that has this hash, by its entry in the manifest and the baseline."""
    if digest != entry.hash:
        return f"content {digest[:8]}, suite.json says {entry.hash[:8]}"
    stale = [place for place, accepted in _accepted(baseline, entry.case).items() if accepted != digest]
    return f"baseline of another content: {', '.join(stale)}" if stale else ""


def _accepted(baseline: Baseline, case: str) -> dict[str, str]:
    return {
        f"{planner} in {where}": entries[case].hash
        for planner, simulators in baseline.planners.items()
        for where, entries in simulators.items()
        if case in entries
    }


def _replayed(folders: Sequence[Path]) -> dict[str, tuple[str | None, str]]:
    """The simulator in which each case was replayed, and the difference that was found."""
    from regents_cosim.replays.replay import Simulator, replay_each  # imports JAX, which a check does not need

    found: dict[str, tuple[str | None, str]] = {}
    of_highway = {folder for folder in folders if load_header(folder).provenance.source == "highway"}
    places: tuple[tuple[Simulator, list[Path]], ...] = (
        ("sumo", [folder for folder in folders if folder not in of_highway]),
        ("highway", [folder for folder in folders if folder in of_highway]),
    )
    for where, its in places:
        for one in replay_each(CasesOnDisk(its), where):
            found[one.case] = (where, "" if one.verified else f"in {where}: {one.reason}")
    return found


def strangers_in(suite: Path) -> Iterator[Path]:
    """Paths in a suite that do not belong to it: files of the user, or of a stranger."""
    for place, folders, files in os.walk(suite):
        folders.sort()
        inside = Path(place).relative_to(suite)
        linked = [name for name in folders if (suite / inside / name).is_symlink()]
        for path in (inside / name for name in sorted((*files, *linked))):
            if (suite / path).is_symlink() or not (suite / path).is_file() or not _belongs(suite, path):
                yield path


def _belongs(suite: Path, path: Path) -> bool:
    if path.parts[0] == RUN:
        return is_written(path.name)
    return is_temporary(path.name) or str(path) in (FILE, EXPLORED, *SETTINGS_FILES) or is_ours(suite, path)


def _left_over(suite: Path, listed: set[str], baseline: Baseline) -> Iterator[CheckRow]:
    """Rows for code, links and pipes, case folders that the manifest does not list, and baseline entries without a
    case.
    """
    for name in code_for_pytest(suite):
        yield CheckRow(name, "pytest would run or obey it: remove it, or work in the suite's own folder", 0)
    for path in strangers_in(suite):
        mode = os.lstat(suite / path).st_mode
        if not stat.S_ISREG(mode):
            yield CheckRow(str(path), f"is a {kind_in_words(mode)}, expected files and folders alone: remove it", 0)
    folders = {path.parent.name for path in suite.glob(f"*/{HEADER}") if not is_temporary(path.parent.name)}
    for name in sorted(folders - listed):
        yield CheckRow(name, "lies in the suite, but suite.json does not list it", 0)
    for planner, simulators in sorted(baseline.planners.items()):
        for where, entries in sorted(simulators.items()):
            for name in sorted(set(entries) - listed):
                yield CheckRow(name, f"has a baseline ({planner} in {where}), but is not in the suite", 0)
