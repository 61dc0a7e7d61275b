"""Replays a Scenario in SUMO: agents are placed at every step or driven by SUMO; signals follow their record.

`moveToXY` with keepRoute=2 reproduces poses exactly, also off the road, but only in SUMO's plain mode: with
`--lanechange.duration` or `--lateral-resolution` it crashes SUMO 1.28.0 (4 to 7 of 16 random drives on a grid). Runs in
a worker process (`workers`).
"""

from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from types import ModuleType

from regents_cosim.errors import ScenarioError
from regents_cosim.planners.interface import Placement, Snapshot
from regents_cosim.replays.ego_controller import EgoController, ask, decision
from regents_cosim.replays.sumo.stage import Stage, SumoReplay
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.sumo.bare_network import network_file, network_of
from regents_cosim.simulators.sumo.drivers import type_file
from regents_cosim.simulators.sumo.process import CRASHES_STAY, as_words, running_sumo
from regents_cosim.simulators.sumo.routes import route_of

# Called with SUMO and its name of the ego. The result is called after each step, and ends the replay by False.
Attach = Callable[[ModuleType, str], Callable[[], object]]
# Yields all agents after each step, and is sent the ego's next state, or None: the ego follows its track.
Played = Generator[Snapshot, Placement | None, SumoReplay]


@dataclass(frozen=True)
class CaseToPlay:
    """A case to play.

    Agents that are `released` (by index) are placed once, at their first state, and then driven by SUMO until their
    route ends; those without a route stay on their tracks. The function that `attach` returns is called after every
    step; with `attach` the ego has the route of its track and the lights have programmes equal to their record, so that
    the attached code can read both.
    """

    scenario: Scenario
    released: Collection[int] = ()
    seed: int = 0  # SUMO's random seed
    gui: bool = False
    attach: Attach | None = None


def replay_in_sumo(play: CaseToPlay, driver: EgoController | None = None) -> SumoReplay:
    """Replay a case, as `play_in_sumo`; the ego follows its track, or `driver` drives it.

    Raises PlannerError where the driver fails.
    """
    return driven(play_in_sumo(play), play.scenario, driver)


def driven(played: Played, scenario: Scenario, driver: EgoController | None) -> SumoReplay:
    """The replay of a scenario that is played, with its ego on its track or moved by `driver`."""
    if driver is not None:
        ask(lambda: driver.start(scenario), "before the first step")
    ego, step = None, 0
    with closing(played):
        while True:
            try:
                seen = played.send(ego)
            except StopIteration as over:
                return over.value
            last = step + 1 == scenario.tracks.steps
            ego = None if driver is None or last else decision(driver, step, seen)
            step += 1


def play_in_sumo(play: CaseToPlay) -> Played:
    """Play a case step by step. Call it in a worker process.

    Placements before step k show in SUMO's report after it, which is step k of the scenario; at step 0 the ego is
    always on its track.

    Pedestrians are persons in SUMO, unless SUMO drives others (`persons`). A map that does not come from SUMO becomes a
    network of bare lanes without lights (`bare_network`). Raises ScenarioError where SUMO is to drive on such a
    network, SumoError with SUMO's own words where it refuses.
    """
    scenario, attach = play.scenario, play.attach
    if play.released and scenario.road.sumo_net is None:
        raise ScenarioError(
            f"case {scenario.id}: its map has no SUMO network (source: {scenario.provenance.source}) for SUMO to drive "
            "in; expected a case recorded in SUMO, or --background log"
        )
    routes = {index: route for index in play.released if (route := route_of(scenario, index)) is not None}
    with _files(scenario, routes) as files, running_sumo(_options(play, files), play.gui) as sumo:
        stage = Stage(sumo, scenario, routes, route_of(scenario, 0) if attach is not None else None)
        if attach is not None:
            stage.show_signals_ahead()
        watch: Callable[[], object] | None = None
        for step in range(scenario.tracks.steps):
            stage.play(step)
            if attach is not None and step == 0:
                watch = attach(sumo, stage.ego)
            if watch is not None and watch() is False:
                break
            if play.gui:
                stage.show(step)
            ego = yield stage.seen
            if ego is not None:
                stage.move_ego(step + 1, ego)
        if play.gui:
            stage.hold()
        return stage.finish()


@contextmanager
def _files(scenario: Scenario, driven: Collection[int]) -> Iterator[dict[str, str]]:
    """Input files of a replay, by the option of SUMO that names them."""
    with network_file(network_of(scenario.road)) as path:
        types = path.with_name("types.add.xml")
        types.write_bytes(type_file(scenario.agents, driven))
        yield {"net-file": str(path), "additional-files": str(types)}


def _options(play: CaseToPlay, files: dict[str, str]) -> list[str]:
    """SUMO's options: only the network, no traffic of its own; collisions are reported and vehicles drive on."""
    options = files | {"step-length": repr(play.scenario.dt), "seed": str(play.seed), **CRASHES_STAY}
    if play.gui:
        options |= {"start": "true", "quit-on-end": "true", "window-size": "1200,900"}
    return as_words(options)
