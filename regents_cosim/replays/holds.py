"""Whether a crash holds where all but the ego and the adversary move in other ways than in its case.

The ego and the adversary keep to their tracks, so a crash that does not hold is one in which another road user gets
between them, or hits the ego first.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import tee

import numpy as np

from regents_cosim.errors import RegentsError
from regents_cosim.mirror.reacting_traffic import among_reacting, those_who_react
from regents_cosim.replays.replay import replay_row
from regents_cosim.replays.sumo.drive import SumoRun, compared_in_sumo
from regents_cosim.replays.verify import Replay, failed
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.judgement import Holds
from regents_cosim.scenario.scenario import Scenario, Tracks, with_rows
from regents_cosim.simulators.sumo.drivers import background_drivers
from regents_cosim.system.progress import logs_items
from regents_cosim.system.workers import run_each

Verified = tuple[Replay, Holds]


@logs_items(lambda found: f"replayed {replay_row(found[0])}")
def verified_each(crashes: Iterable[Scenario], executor: Executor | None = None) -> Iterator[Verified]:
    """Replay attacked crashes in SUMO, in order, and tell of the judged ones whether they hold.

    SUMO runs in separate processes, or those of `executor`. Crashes are read when it is their turn.
    """
    crashes, taken = tee(crashes)
    found = run_each(compared_in_sumo, (run for case in taken for run in _runs(case)), executor)
    for case in crashes:
        replay, *among = [next(found) for _ in _runs(case)]
        yield (
            failed(case, replay) if isinstance(replay, RegentsError) else replay,
            _holds(case, *among) if case.judgement else Holds(),
        )


def verified_only(crashes: Iterable[Scenario]) -> Iterator[Scenario]:
    """Those attacked crashes that SUMO shows too, in order; judged ones note whether they hold."""
    crashes, replayed = tee(crashes)
    for case, (replay, holds) in zip(crashes, verified_each(replayed), strict=True):
        if replay.verified:
            yield replace(case, judgement=case.judgement and replace(case.judgement, holds=holds))


def _runs(case: Scenario) -> Iterator[SumoRun]:
    """The replay that verifies a case, and the one among SUMO's traffic, where its map lets SUMO drive."""
    yield SumoRun(case)
    if case.judgement and case.road.sumo_net:
        yield SumoRun(case, released=background_drivers(case))


def _holds(case: Scenario, among: Replay | RegentsError | None = None) -> Holds:
    assert case.log is not None
    assert case.attack is not None
    others = np.array([agent.role == "background" for agent in case.agents])
    logged = replace(case, tracks=with_rows(case.tracks, case.log, others))
    if case.attack.settings.get("background") == "reactive":  # the search has already moved them so
        reacted = case.tracks
    else:
        brake = those_who_react(case)
        ego = tuple(values[0] for values in (case.tracks.x, case.tracks.y, case.tracks.yaw, case.tracks.speed))
        before = replace(logged, tracks=with_rows(logged.tracks, case.log, np.arange(len(case.agents)) == 0))
        reacted = with_rows(logged.tracks, among_reacting(before, ego, brake), brake)
    return Holds(
        replayed=_same_contact(case, logged.tracks),
        reactive=_same_contact(case, reacted),
        sumo=among.found == among.expected if isinstance(among, Replay) else None,
    )


def _same_contact(case: Scenario, tracks: Tracks) -> bool:
    return first_contact(case.agents, tracks) == first_contact(case.agents, case.tracks)
