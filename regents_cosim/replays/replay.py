"""`replay`: plays a case in a simulator, and checks whether the same crash happens there."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext
from dataclasses import replace
from itertools import tee
from pathlib import Path
from typing import Literal, get_args

from regents_cosim.cases.files import load_case
from regents_cosim.checks.arguments import as_path, require_one_of
from regents_cosim.errors import DriveError, MissingDependencyError, RegentsError
from regents_cosim.planners.controllers import PlannerControllers
from regents_cosim.planners.interface import Debug
from regents_cosim.planners.time_limits import ACT_TIMEOUT, ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.sumo.drive import SumoRun, compared_from_here, compared_in_sumo
from regents_cosim.replays.sumo.session import SumoSession
from regents_cosim.replays.verify import Replay, before_crash, compare, failed
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.sumo.drivers import background_drivers
from regents_cosim.simulators.sumo.process import require_display
from regents_cosim.system.progress import Progress, ShowProgress, logs_items, progress_for
from regents_cosim.system.workers import run_each

Simulator = Literal["sumo", "highway", "mirror"]
Mode = Literal["track", "actions"]
Background = Literal["log", "reactive"]
_AGENT = "highway:"  # prefix of highway-env's agents, which need no bridge there


def replay(
    scenario: Scenario | Path | str,
    where: Simulator = "sumo",
    planner: AnyPlanner | None = None,
    gui: bool = False,
    mode: Mode = "track",
    background: Background = "log",
    *,
    progress: ShowProgress = True,
) -> Replay:
    """Replay a case, given as a value or as its folder; the ego follows its track, or `planner` drives it in closed
    loop.

    In highway-env the others follow their tracks; with `mode` actions its own physics moves them. In SUMO they follow
    their tracks; with `background` reactive only the adversary does, and SUMO drives the rest. `gui` opens
    sumo-gui, which stays open until the user closes it.

    A simulator that refuses or dies gives a Replay that is not verified and states the reason. A progress bar is shown
    on terminals and in notebooks unless `progress` is False. Raises PlannerError for a planner that cannot be found,
    RegentsError for a window of another simulator than SUMO, and without a display.
    """
    case = scenario if isinstance(scenario, Scenario) else load_case(as_path(scenario, "scenario"))
    with progress_for(progress).waiting(f"replaying in {where}"):
        return next(replay_each([case], where, planner, gui, mode=mode, background=background))


def replay_row(found: Replay) -> str:
    """The outcome of a replay as one line."""
    return f"{found.case}: {'as expected' if found.verified else found.reason}"


@logs_items(lambda found: f"replayed {replay_row(found)}")
def replay_each(
    scenarios: Iterable[Scenario],
    where: Simulator = "sumo",
    planner: AnyPlanner | None = None,
    gui: bool = False,
    executor: Executor | None = None,
    mode: Mode = "track",
    background: Background = "log",
    act_timeout_s: float = ACT_TIMEOUT_S,
    drivers: PlannerControllers | None = None,
) -> Iterator[Replay]:
    """Replay many cases, in order; SUMO runs in separate processes, or those of `executor`.

    Cases are read when it is their turn. A planner that takes longer than `act_timeout_s` for a decision fails that
    case. `drivers` are the planner's drivers for highway-env, where the caller already has them.
    """
    check(where, gui, background, act_timeout_s, mode)
    given = None if planner is None else PlannerUnderTest.of(planner)
    if where == "highway":
        with nullcontext(drivers) if drivers else controllers_of(given, act_timeout_s) or nullcontext() as those:
            yield from (_or_failed(s, lambda s: _in_highway(s, given, those, mode)) for s in scenarios)
        return
    if where == "mirror":
        with MirrorController(given, act_timeout_s) if given else nullcontext() as driver:
            yield from (_or_failed(s, lambda s: _in_mirror(s, driver)) for s in scenarios)
        return
    ticket = given and given.ticket
    scenarios, taken = tee(scenarios)
    runs = (
        SumoRun(
            scenario,
            background_drivers(scenario) if background == "reactive" else (),
            gui=gui,
            planner=ticket,
            act_timeout_s=act_timeout_s,
        )
        for scenario in taken
    )
    ended = (
        run_each(compared_in_sumo, runs, executor) if ticket or not given else _from_here(runs, given, act_timeout_s)
    )
    for scenario, found in zip(scenarios, ended, strict=True):
        yield failed(scenario, found) if isinstance(found, RegentsError) else found


def _from_here(
    runs: Iterable[SumoRun], planner: PlannerUnderTest, act_timeout_s: float
) -> Iterator[Replay | RegentsError]:
    """The replays with a planner that cannot leave this process, or the errors, as `run_each` gives them."""
    with PlannerControllers(planner, act_timeout_s) as drivers, closing(SumoSession()) as session:
        for run in runs:
            try:
                with drivers.lend() as driver:
                    yield compared_from_here(run, session, driver)
            except MissingDependencyError:
                raise
            except RegentsError as error:
                yield error


def verify_in_sumo(attacked: Sequence[Scenario], progress: Progress) -> dict[str, Replay]:
    """Replay the crashes among `attacked` in SUMO, and return the replays by case id."""
    crashes = [case for case in attacked if case.crash]
    replays = replay_each(crashes, "sumo")
    return {replay.case: replay for replay in progress.each(replays, "verifying in SUMO", len(crashes))}


def check(
    where: Simulator,
    gui: bool = False,
    background: Background = "log",
    act_timeout_s: float = ACT_TIMEOUT_S,
    mode: Mode = "track",
) -> None:
    """Raise RegentsError for options that do not exist or that a simulator does not support, once for all cases."""
    require_one_of(where, get_args(Simulator), "where")
    require_one_of(mode, get_args(Mode), "mode")
    require_one_of(background, get_args(Background), "background")
    if gui and where == "sumo":
        require_display()
    if background == "reactive" and where != "sumo":
        raise RegentsError(f"--background reactive is SUMO's own traffic; expected --in sumo, found --in {where}")
    if gui and where != "sumo":
        raise RegentsError(f"--gui shows sumo-gui; expected --in sumo, found --in {where} (or use --record)")
    ACT_TIMEOUT.check("act-timeout", act_timeout_s)


def _or_failed(scenario: Scenario, replay_it: Callable[[Scenario], Replay]) -> Replay:
    """Replay a case; a failing planner gives a failed replay of that case only."""
    try:
        return replay_it(scenario)
    except DriveError as failure:
        return failed(scenario, failure)


def controllers_of(planner: PlannerUnderTest | None, act_timeout_s: float) -> PlannerControllers | None:
    """Drivers of a planner in highway-env; None for highway-env's own agents, which need none."""
    return PlannerControllers(planner, act_timeout_s) if planner and _agent(planner) is None else None


def _agent(planner: PlannerUnderTest | None) -> str | None:
    """The name of highway-env's agent if the planner is one; else None."""
    source = planner.source if planner else None
    return source.removeprefix(_AGENT) if isinstance(source, str) and source.startswith(_AGENT) else None


def _in_highway(
    scenario: Scenario, planner: PlannerUnderTest | None, drivers: PlannerControllers | None, mode: Mode
) -> Replay:
    from regents_cosim.replays.highway.replay import drive_in_highway, replay_in_highway

    thoughts = dict[int, Debug]()
    if (agent := _agent(planner)) is not None:
        seen = drive_in_highway(scenario, agent, mode)
    else:
        with drivers.lend() if drivers else nullcontext() as driver:
            seen = replay_in_highway(scenario, driver, mode)
            thoughts = driver.thoughts() if driver else {}
    found = compare(scenario, seen.tracks, seen.collisions, ego_is_free=planner is not None)
    return replace(found, debug=before_crash(scenario, seen.tracks, thoughts))


def _in_mirror(scenario: Scenario, driver: MirrorController | None) -> Replay:
    if driver is None:
        return compare(scenario, scenario.tracks)
    driven = driver.drive(scenario)
    found = compare(scenario, driven.tracks, ego_is_free=True, driven=driven.reacted)
    return replace(found, debug=driven.debug)
