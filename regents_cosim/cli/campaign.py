"""Shared parts of commands that can resume: the run, its shards, and its choice of cases."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.cli.groups import ADVANCED, SEARCH, Advanced, OfOutput, OfRun
from regents_cosim.cli.options import MapAxes, TrafficOptions
from regents_cosim.cli.shared import record_traffic, traffic_source
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Executor

    from regents_cosim.archive.axes import Axes
    from regents_cosim.campaign.growing import Budget
    from regents_cosim.campaign.ledger import Ledger, LedgerRecord
    from regents_cosim.campaign.shards import Shard
    from regents_cosim.campaign.window_job import AttackRun
    from regents_cosim.campaign.windows import RunWindows
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.scenario import Scenario


_MINUTES, _MOST_MINUTES = 10.0, 10_000


@Parameter(name="*", group=SEARCH)
@dataclass(frozen=True)
class CampaignOptions:
    """Options of large runs: the part that is done here, and what is done again."""

    shard: Annotated[str, OfRun] = ""
    """NUMBER/COUNT: do only this share of the windows, e.g. 3/64; default in a SLURM job array: the share of the
    task"""
    retry: Annotated[bool, OfRun] = False
    """try windows again that failed before; by default only missing ones are done"""
    manoeuvres: Annotated[tuple[str, ...], Parameter(["--manoeuvre"])] = ()
    """NAME or NAME=NUMBER: keep only crashes with this manoeuvre of the adversary (docs/tags.md, e.g. cut_in=10), and
    record more windows until there are NUMBER crashes (default: --count) or the traffic holds no more; may be
    repeated"""
    archive: bool = False
    """keep only the best crash of each cell of the map of behaviours: telling before avoidable before clean, then by
    the most usual adversary, then by the least deviation (`regents suite coverage` shows the map)"""
    axes: Annotated[MapAxes, Advanced] = ""
    rollouts: Annotated[int | None, Parameter(validator=Number(gte=0, lte=1_000_000), group=ADVANCED)] = None
    """roll-outs per window with --archive; the search goes on after its first crash and looks for different ones
    (CMA-ME, by the rules of focused); default 2000. 0: the search of --method, which ends at its first crash"""
    into: Annotated[Path | None, OfOutput] = None
    """an existing suite that new crashes are added to: those in an empty cell of the map of behaviours, or better than
    the best in theirs; windows in the least explored surroundings are attacked first. With -o the new cases are saved
    there too"""
    minutes: Annotated[float | None, OfOutput] = None
    """time for --into [min]; attacks that have begun by then are finished. Default 10"""

    def map_axes(self) -> "Axes | None":
        """The axes of the map of behaviours for --archive; None without it. Raises RegentsError."""
        from regents_cosim.archive.axes import parse_axes

        if self.axes and not self.archive and self.into is None:
            raise RegentsError("--axes belongs to a map of behaviours: expected --archive or --into as well")
        if self.archive and self.manoeuvres:
            raise RegentsError("--archive and --manoeuvre choose crashes differently: expected one of them")
        return parse_axes(self.axes) if self.archive or self.into is not None else None

    def going_on(self, run: "AttackRun", terminal: "Terminal") -> "AttackRun":
        """The run with the roll-outs for an archive. Raises RegentsError."""
        from regents_cosim.archive.illumination import ROLLOUTS, obstacle, require_possible

        if not self.archive:
            if self.rollouts is not None:
                raise RegentsError("--rollouts belongs to a search for an archive: expected --archive as well")
            return run
        if self.rollouts:
            require_possible(run.config, run.planner, run.planners[1:])
        if self.rollouts is None and (why := obstacle(run.config, run.planner, run.planners[1:])):
            terminal.say(f"every search ends at its first crash ({why})")
            return run
        return replace(run, rollouts=ROLLOUTS if self.rollouts is None else self.rollouts)

    def budget(self, executor: str) -> "Budget | None":
        """The time budget for a growing suite; None without --into. Raises RegentsError."""
        from regents_cosim.campaign.growing import Budget

        if self.into is None:
            if self.minutes is not None:
                raise RegentsError("--minutes is the time for a suite that grows: expected --into SUITE as well")
            return None
        also = {"--archive": self.archive, "--manoeuvre": self.manoeuvres, "--shard": self.shard, "--retry": self.retry}
        also["--executor"] = executor != "local"
        if named := [name for name, given in also.items() if given]:
            raise RegentsError(f"--into chooses and continues by rules of its own: leave out {', '.join(named)}")
        minutes = _MINUTES if self.minutes is None else self.minutes
        if not 0.0 < minutes <= _MOST_MINUTES:
            raise RegentsError(f"--minutes {minutes:g}: expected more than 0 and at most {_MOST_MINUTES}")
        return Budget.of(minutes)


def share(asked: str, terminal: "Terminal") -> "Shard":
    """The share asked for, or that of this task of a SLURM array, with a message. Raises RegentsError."""
    from regents_cosim.campaign.shards import WHOLE, parse_shard, slurm_shard

    if asked:
        return parse_shard(asked)
    found = slurm_shard(os.environ)
    if found is not None:
        terminal.say(f"shard {found}, by SLURM's job array (--shard 1/1 does all of it)")
    return found or WHOLE


@dataclass(frozen=True)
class AttackInput:
    """What is attacked: cases, or windows of traffic to record."""

    cases: Path | None
    traffic: TrafficOptions
    sumo: tuple[str, ...] = ()
    executor: str = "local"

    def settings(self) -> dict[str, Any]:
        """The options that determine the windows; for cases only the seed."""
        if self.cases is not None:
            return {"seed": self.traffic.seed}
        return {**vars(self.traffic), "sumo_options": list(self.sumo)}


def record_into(output: Path, given: AttackInput, terminal: "Terminal") -> list[str]:
    """Record traffic into a folder, unless it is there already; returns the names of the cases, in order.

    Raises RegentsError.
    """
    from regents_cosim.campaign.identity import identity
    from regents_cosim.campaign.recording import record_once
    from regents_cosim.system.workers import executor_for

    def record() -> "list[Scenario]":
        with executor_for(given.executor) as pool:
            return record_traffic(given.traffic, given.sumo, pool, terminal)

    mine = identity("record", given.settings(), {})
    return record_once(output, mine, digest_of(given), given.traffic.seed, record)


def attack_into(
    output: Path, run: "AttackRun", given: AttackInput, options: CampaignOptions, terminal: "Terminal"
) -> "LedgerRecord":
    """Do what is missing of an attack in a folder, and return the record of the folder. Raises RegentsError."""
    from regents_cosim.campaign.attack_run import attack_left
    from regents_cosim.campaign.ledger import forget_lost, open_ledger, require_free
    from regents_cosim.campaign.windows import windows_in
    from regents_cosim.reports.picture import still
    from regents_cosim.saving import SuiteWriter
    from regents_cosim.system.workers import executor_for, local_processes

    if given.executor != "local":  # each worker searches one window at a time
        run = replace(run, engine="threads", batch=1)
    shard, together = share(options.shard, terminal), run.together()
    if run.wanted and shard.count > 1:
        raise RegentsError(
            "--manoeuvre counts the crashes of a whole run: leave out --shard (--shard 1/1 in a SLURM array)"
        )
    mine = run.identity(given.settings(), together)
    require_free(output, mine, shard)
    suite = SuiteWriter(output, given.traffic.seed)
    cases = windows_in(given.cases) if given.cases else None
    digest = "" if given.cases else digest_of(given)

    with (
        open_ledger(output, mine, shard, together) as ledger,
        executor_for(given.executor) as cluster,
        local_processes() as sumo,
    ):
        forget_lost(ledger)
        for windows in _rounds(ledger, run, given, cases, digest, options, cluster or sumo, terminal):
            _say_where(ledger, options.retry, terminal)
            attack_left(
                ledger,
                windows,
                run,
                suite,
                still=still,
                retry=options.retry,
                cluster=cluster,
                sumo=sumo,
                watch=lambda done, of: terminal.each(done, "attacking", of, _row_of),
            )
        if run.wanted is not None:
            ledger.end()
            terminal.say(run.wanted.said(run.wanted.found_in(ledger.record, output), ledger.record, ended=True))
        ledger.finish()
        return ledger.record


def _row_of(window: Any) -> str:
    """The outcome of an attacked window as one line."""
    from regents_cosim.attacks.attack import window_row

    return window_row(window.cases)


def _rounds(
    ledger: "Ledger",
    run: "AttackRun",
    given: AttackInput,
    cases: "RunWindows | None",
    digest: str,
    options: CampaignOptions,
    pool: "Executor",
    terminal: "Terminal",
) -> "Iterator[RunWindows]":
    """The rounds of windows to attack; with --manoeuvre more rounds follow as long as crashes are missing."""
    from regents_cosim.campaign.windows import planned, recorded

    if cases is not None:
        planned(ledger, cases)
        yield cases
        return
    keys = {count: ledger.record.begun.identity.key(digest, str(count)) for count in _window_counts(run, given)}
    begun = next((count for count, key in keys.items() if ledger.record.plan and ledger.record.plan.key == key), 0)
    for count, key in keys.items():
        if count < begun:
            continue
        traffic, before = replace(given.traffic, count=count), len(ledger.record.own)
        yield recorded(
            ledger,
            key,
            lambda traffic=traffic: record_traffic(traffic, given.sumo, pool, terminal),
            options.retry,
            more=count > min(keys),
        )
        assert ledger.record.plan is not None
        used_up = ledger.record.plan.ended or (count != begun and len(ledger.record.own) == before)
        if run.wanted is None or used_up:
            return
        found = run.wanted.found_in(ledger.record, ledger.folder)
        if run.wanted.is_met(found):
            return
        terminal.say(run.wanted.said(found, ledger.record, ended=False))


def _window_counts(run: "AttackRun", given: AttackInput) -> list[int]:
    return [given.traffic.count] if run.wanted is None else list(run.wanted.windows())


def digest_of(given: AttackInput) -> str:
    """A digest of the files that the traffic is recorded from. Raises RegentsError."""
    from regents_cosim.campaign.traffic_files import traffic_digest

    return traffic_digest(traffic_source(given.traffic, given.sumo), given.traffic.fcd, given.traffic.policy)


def _say_where(ledger: "Ledger", retry: bool, terminal: "Terminal") -> None:
    """Report what earlier runs have done in this folder, if anything."""
    own, left = len(ledger.record.own), len(ledger.left(retry))
    if ledger.changed:
        terminal.say(f"changed since: {', '.join(ledger.changed)}; what depends on them is done again")
    failed = sum(bool(one.error) for one in ledger.record.done.values())
    if own > left or failed:
        hint = f", {failed} failed before (--retry tries them again)" if failed and not retry else ""
        terminal.say(f"{own - left} of {own} windows are done already{hint}")
