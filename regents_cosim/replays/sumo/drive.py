"""One run of SUMO for a case, in a worker process. A worker without a planner imports neither planners nor JAX."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.replays.sumo.replay import CaseToPlay, driven, replay_in_sumo
from regents_cosim.replays.sumo.session import SumoSession
from regents_cosim.replays.sumo.stage import SumoReplay
from regents_cosim.replays.verify import Replay, before_crash, compare
from regents_cosim.simulators.sumo.drivers import on_foot

if TYPE_CHECKING:
    from regents_cosim.planners.controllers import HostController, LoopController, PlannerControllers
    from regents_cosim.planners.under_test import PlannerTicket

_RUN = secrets.token_hex(8)  # identifies this process
_KEPT: dict[tuple[str, PlannerTicket, float], PlannerControllers] = {}  # in a worker: the drivers of the current run


@dataclass(frozen=True)
class SumoRun(CaseToPlay):
    """One run of SUMO, with the ego's planner."""

    planner: PlannerTicket | None = None  # None: the ego follows its track, or is released
    act_timeout_s: float = ACT_TIMEOUT_S
    run: str = _RUN  # the caller: while it is the same, the worker keeps the planner's process


def drive_in_sumo(drive: SumoRun) -> SumoReplay:
    """Replay a drive. Runs in a worker process."""
    with _driver_of(drive) as driver:
        seen = replay_in_sumo(drive, driver)
        return replace(seen, thoughts=driver.thoughts()) if driver else seen


def compared_in_sumo(drive: SumoRun) -> Replay:
    """Replay a drive and compare it with its case. Runs in a worker process."""
    return _compared(drive, drive_in_sumo(drive), ego_is_free=drive.planner is not None)


def compared_from_here(drive: SumoRun, session: SumoSession, driver: LoopController | HostController) -> Replay:
    """Replay a drive and compare it with its case: a driver of this process moves the ego in another's SUMO."""
    seen = driven(session.play(drive), drive.scenario, driver)
    return _compared(drive, replace(seen, thoughts=driver.thoughts()), ego_is_free=True)


def _compared(drive: SumoRun, seen: SumoReplay, ego_is_free: bool) -> Replay:
    scenario = drive.scenario
    found = compare(scenario, seen.tracks, seen.collisions, ego_is_free, seen.driven)
    return replace(
        found,
        unmatched=tuple(scenario.agents[index].id for index in sorted(set(drive.released) - seen.driven)),
        as_vehicles=tuple(scenario.agents[index].id for index in sorted(on_foot(scenario) - seen.persons)),
        debug=before_crash(scenario, seen.tracks, seen.thoughts),
    )


@contextmanager
def _driver_of(drive: SumoRun) -> Iterator[LoopController | HostController | None]:
    """The driver of the ego, from those that this worker keeps between the drives of one run."""
    if drive.planner is None:
        yield None
        return
    # imports JAX, which takes longer than SUMO's replay
    from regents_cosim.planners.controllers import PlannerControllers

    key = drive.run, drive.planner, drive.act_timeout_s
    if key not in _KEPT:
        for drivers in _KEPT.values():
            drivers.__exit__()
        _KEPT.clear()
        _KEPT[key] = PlannerControllers(drive.planner.planner(), drive.act_timeout_s)
    with _KEPT[key].lend() as driver:
        yield driver
