"""The rival without a search: SUMO's own drivers, told to be as dangerous as SUMO lets them, around the planner."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from regents_cosim.attack_record import AttackRecord
from regents_cosim.checks.names import file_name
from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.scores import Results, collides_before
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.replay import at_hand, drive_in_sumo_each
from regents_cosim.replays.sumo.drive import SumoRun
from regents_cosim.replays.sumo.stage import SumoReplay
from regents_cosim.scenario import VEHICLE_KINDS, Scenario, Tracks
from regents_cosim.simulators.sumo.drivers import AGGRESSIVE_DRIVER, DriverParameters

METHOD = "sumo-aggressive"


def drive_aggressively(
    windows: Sequence[Scenario], before: Sequence[Results], planner: AnyPlanner
) -> Iterator[Results]:
    """One result for each window: the planner in closed loop in SUMO among aggressive drivers, from the log's start.

    `before` are results of an attack on the same windows: where the planner collides before it, so it is noted here.
    """
    colliding = [next(filter(collides_before, results), None) for results in before]
    pairs = zip(windows, colliding, strict=True)
    given = PlannerUnderTest.of(planner)
    with at_hand(given) as driver:
        drives = [SumoRun(window, driver, _drivers(window)) for window, known in pairs if known is None]
        seen = drive_in_sumo_each(drives)
        for window, known in zip(windows, colliding, strict=True):
            yield [known if known is not None else _case(window, next(seen), given.name)]


def _case(window: Scenario, seen: SumoReplay | RegentsError, planner: str) -> Scenario:
    if not isinstance(seen, RegentsError):
        return _attacked(window, seen.tracks, planner)
    record = AttackRecord(window.id, METHOD, planner, "planner_error", 0, planner_error=str(seen))
    return replace(window, id=file_name(window.id, METHOD), attack=record, log=window.tracks)


def _drivers(window: Scenario) -> dict[int, DriverParameters]:
    """All but the ego drive aggressively."""
    return {
        index: AGGRESSIVE_DRIVER
        for index, agent in enumerate(window.agents)
        if index > 0 and agent.kind in VEHICLE_KINDS
    }


def _attacked(window: Scenario, tracks: Tracks, planner: str) -> Scenario:
    """What SUMO made of it, as a case."""
    contact = first_contact(window.agents, tracks)
    hit = None
    agents = window.agents
    if contact is not None:
        hit = collision_at(agents, tracks, contact, window.dt, attributed=True)
        agents = tuple(replace(a, role="adversary") if i == contact[0] else a for i, a in enumerate(agents))
    names = tuple(agent.id for agent in agents[1:] if agent.kind in VEHICLE_KINDS)
    outcome = "no_collision" if hit is None else "collision"
    record = AttackRecord(window.id, METHOD, planner, outcome, 1, hit, names)
    return replace(
        window, id=file_name(window.id, METHOD), agents=agents, tracks=tracks, attack=record, log=window.tracks
    )
