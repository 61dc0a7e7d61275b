"""`replay`: a case in a simulator, and whether the same crash happens there."""

import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from itertools import tee
from typing import Literal

from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.planners.driver import Drivers, HostDriver, LoopDriver
from regents_cosim.planners.patience import ACT_TIMEOUT, ACT_TIMEOUT_S
from regents_cosim.planners.relay import Relay, RelayedDriver, relayed
from regents_cosim.planners.under_test import AnyPlanner, PlannerTicket, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorDriver
from regents_cosim.replays.sumo.drivers import DriverParameters, background_drivers
from regents_cosim.replays.sumo.replay import replay_in_sumo
from regents_cosim.replays.sumo.stage import SumoReplay
from regents_cosim.replays.verify import Replay, compare, failed
from regents_cosim.scenario import Scenario
from regents_cosim.simulators.sumo_process import require_display
from regents_cosim.system.logged import logged
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.workers import run_each

Simulator = Literal["sumo", "highway", "mirror"]
Mode = Literal["track", "actions"]
Background = Literal["log", "reactive"]
_RUN = secrets.token_hex(8)  # of this process
_KEPT: dict[tuple[str, PlannerTicket, float], Drivers] = {}  # in a worker: of the run that it works on
_AGENT = "highway:"  # in front of the names of highway-env's agents, which need no bridge there


def replay(
    scenario: Scenario,
    where: Simulator = "sumo",
    planner: AnyPlanner | None = None,
    gui: bool = False,
    mode: Mode = "track",
    background: Background = "log",
) -> Replay:
    """Replay one case; the ego follows its track, or `planner` in closed loop.

    In highway-env the others follow their tracks, or by `mode` actions are moved by its own
    physics. In SUMO they follow their tracks, or by `background` reactive only the adversary does
    and SUMO drives the rest. `gui` opens the simulator's own window.

    A simulator that refuses or dies gives a Replay that is not verified and says why. Raises
    PlannerError for a planner that cannot be found, RegentsError for a window of the mirror, or of
    highway-env without a display.
    """
    return next(replay_each([scenario], where, planner, gui, mode=mode, background=background))


def _ended(found: Replay) -> str:
    """For the log: how a replay ended."""
    return f"replayed {found.case}: {'as expected' if found.verified else found.reason}"


@logged(_ended)
def replay_each(
    scenarios: Iterable[Scenario],
    where: Simulator = "sumo",
    planner: AnyPlanner | None = None,
    gui: bool = False,
    executor: Executor | None = None,
    mode: Mode = "track",
    background: Background = "log",
    act_timeout_s: float = ACT_TIMEOUT_S,
    drivers: Drivers | None = None,
) -> Iterator[Replay]:
    """Replay many cases, in order; SUMO runs in processes of its own, or those of `executor`.

    Cases are taken as their turn comes. A planner that takes longer than `act_timeout_s` over a decision has failed in
    that case. `drivers` are those of the planner for highway-env, where the caller keeps them.
    """
    check(where, gui, background, act_timeout_s)
    given = None if planner is None else PlannerUnderTest.of(planner)
    if where == "highway":
        with nullcontext(drivers) if drivers else drivers_of(given, act_timeout_s) or nullcontext() as those:
            yield from (_or_failed(s, lambda s: _in_highway(s, given, those, mode, gui)) for s in scenarios)
        return
    if where == "mirror":
        with MirrorDriver(given, act_timeout_s) if given else nullcontext() as driver:
            yield from (_or_failed(s, lambda s: _in_mirror(s, driver)) for s in scenarios)
        return
    scenarios, taken = tee(scenarios)
    with at_hand(given, act_timeout_s) as driven_by:
        jobs = (
            SumoDrive(
                scenario,
                driven_by,
                background_drivers(scenario) if background == "reactive" else {},
                gui=gui,
                act_timeout_s=act_timeout_s,
            )
            for scenario in taken
        )
        found_there = run_each(_in_sumo, jobs, executor if not isinstance(driven_by, Relay) else None)
        for scenario, found in zip(scenarios, found_there, strict=True):
            yield failed(scenario, found) if isinstance(found, RegentsError) else found


def verify_in_sumo(
    attacked: Sequence[Scenario], executor: Executor | None = None, progress: Progress = SILENT
) -> dict[str, Replay]:
    """Replays in SUMO of the crashes among `attacked`, by case."""
    crashes = [case for case in attacked if case.attack and case.attack.outcome == "collision"]
    replays = replay_each(crashes, "sumo", executor=executor)
    return {replay.case: replay for replay in progress.each(replays, "verifying in SUMO", len(crashes))}


@dataclass(frozen=True)
class SumoDrive:
    """One run of SUMO: who is at the wheel of the ego, and who SUMO drives, how, by index."""

    scenario: Scenario
    planner: PlannerTicket | Relay | None = None  # `at_hand`; None: the ego follows its track, or is among the released
    released: Mapping[int, DriverParameters] = field(default_factory=dict)
    seed: int = 0
    gui: bool = False
    act_timeout_s: float = ACT_TIMEOUT_S
    run: str = _RUN  # who asks: while that is the same, the planner's process is


def drive_in_sumo_each(
    drives: Sequence[SumoDrive], executor: Executor | None = None
) -> Iterator[SumoReplay | RegentsError]:
    """What SUMO reports of each drive, in order, in processes of their own; a drive that fails gives its error."""
    return run_each(drive_in_sumo, drives, executor)


def drive_in_sumo(drive: SumoDrive) -> SumoReplay:
    """Run in a worker process."""
    with _driver_of(drive) as driver:
        return replay_in_sumo(drive.scenario, driver, drive.gui, drive.released, drive.seed)


@contextmanager
def at_hand(
    planner: PlannerUnderTest | None, act_timeout_s: float = ACT_TIMEOUT_S
) -> Iterator[PlannerTicket | Relay | None]:
    """The planner for SUMO's processes; one that cannot leave this process is asked here meanwhile."""
    if planner is None or planner.ticket is not None:
        yield planner and planner.ticket
        return
    with Drivers(planner, act_timeout_s) as drivers, relayed(drivers) as relay:
        yield relay


@contextmanager
def _driver_of(drive: SumoDrive) -> Iterator[LoopDriver | HostDriver | RelayedDriver | None]:
    """Who drives the ego, from what this worker keeps between the drives of one run."""
    if drive.planner is None:
        yield None
        return
    if isinstance(drive.planner, Relay):
        with drive.planner.lend() as driver:
            yield driver
        return
    key = drive.run, drive.planner, drive.act_timeout_s
    if key not in _KEPT:
        for drivers in _KEPT.values():
            drivers.__exit__()
        _KEPT.clear()
        _KEPT[key] = Drivers(drive.planner.planner(), drive.act_timeout_s)
    with _KEPT[key].lend() as driver:
        yield driver


def _in_sumo(drive: SumoDrive) -> Replay:
    """Run in a worker process."""
    seen = drive_in_sumo(drive)
    found = compare(drive.scenario, seen.tracks, seen.collisions, drive.planner is not None, seen.driven)
    unmatched = tuple(drive.scenario.agents[index].id for index in sorted(set(drive.released) - seen.driven))
    return replace(found, unmatched=unmatched, as_vehicles=_as_vehicles(drive.scenario, seen))


def _as_vehicles(scenario: Scenario, seen: SumoReplay) -> tuple[str, ...]:
    """The pedestrians that were no persons in SUMO."""
    on_foot = {index for index, agent in enumerate(scenario.agents) if index > 0 and agent.kind == "pedestrian"}
    return tuple(scenario.agents[index].id for index in sorted(on_foot - seen.persons))


def check(
    where: Simulator, gui: bool = False, background: Background = "log", act_timeout_s: float = ACT_TIMEOUT_S
) -> None:
    """Complain here rather than once per case. Raises RegentsError for what a simulator cannot do."""
    if gui and where == "sumo":
        require_display()
    if background == "reactive" and where != "sumo":
        raise RegentsError(f"--background reactive is SUMO's own traffic; expected --in sumo, found --in {where}")
    if gui and where == "mirror":
        raise RegentsError("the mirror has no window; --gui shows that of --in sumo or --in highway, or use --record")
    ACT_TIMEOUT.check("act-timeout", act_timeout_s)


def _or_failed(scenario: Scenario, replay_it: Callable[[Scenario], Replay]) -> Replay:
    """A planner that fails costs its own case only."""
    try:
        return replay_it(scenario)
    except DriveError as failure:
        return failed(scenario, failure)


def drivers_of(planner: PlannerUnderTest | None, act_timeout_s: float) -> Drivers | None:
    """Drivers of a planner in highway-env; None for its own agents, which need none."""
    return Drivers(planner, act_timeout_s) if planner and _agent(planner) is None else None


def _agent(planner: PlannerUnderTest | None) -> str | None:
    """The agent of highway-env's that the planner is."""
    source = planner.source if planner else None
    return source.removeprefix(_AGENT) if isinstance(source, str) and source.startswith(_AGENT) else None


def _in_highway(
    scenario: Scenario, planner: PlannerUnderTest | None, drivers: Drivers | None, mode: Mode, gui: bool
) -> Replay:
    from regents_cosim.replays.highway.replay import drive_in_highway, replay_in_highway

    if (agent := _agent(planner)) is not None:
        seen = drive_in_highway(scenario, agent, mode, gui=gui)
    else:
        with drivers.lend() if drivers else nullcontext() as driver:
            seen = replay_in_highway(scenario, driver, mode, gui)
    return compare(scenario, seen.tracks, seen.collisions, ego_is_free=planner is not None)


def _in_mirror(scenario: Scenario, driver: MirrorDriver | None) -> Replay:
    tracks = driver.drive(scenario).tracks if driver else scenario.tracks
    return compare(scenario, tracks, ego_is_free=driver is not None)
