"""A Scenario replayed in SUMO: agents are placed at every step, or left to SUMO; signals show what they showed.

`moveToXY` with keepRoute=2 reproduces poses exactly, also off the road, in SUMO's plain mode only:
with `--lanechange.duration` or `--lateral-resolution` it crashes SUMO 1.28.0 (4 to 7 of 16 random
drives on a grid). Runs in a worker process (`workers`).
"""

import re
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from traceback import format_exception
from types import ModuleType
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from regents_cosim.errors import DriveError, PlannerError, RegentsError, ScenarioError, SumoError
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import Pose, SumoPose, from_sumo, to_sumo
from regents_cosim.planners.interface import AgentState, Seen
from regents_cosim.replays.sumo.bare_network import BARE_EDGE, network_of
from regents_cosim.replays.sumo.drivers import DriverParameters, driven_type, type_file
from regents_cosim.replays.sumo.routes import edge_of, route_of
from regents_cosim.replays.verify import ReportedCollision
from regents_cosim.scenario import Agent, Scenario, Signal, Tracks
from regents_cosim.simulators.sumo_process import running_sumo
from regents_cosim.system.scratch import scratch_folder

_R = TypeVar("_R")

EXACT = 2  # keepRoute of moveToXY: this very position, on any edge or on none
_EXACT_ON_ROUTE = 3  # the same, and the route is kept
_AS_SUMO_LIKES = -1.0  # speed
_COLOURS = {"ego": (0, 114, 178, 255), "adversary": (213, 94, 0, 255), "background": (150, 150, 150, 255)}
_LETTERS = "rygGuosOY"
_IN_SIGHT_M = 40.0  # around the ego, in sumo-gui
_SHAPES = {
    "car": "passenger/sedan",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "other": "passenger",
}


class EgoState(NamedTuple):
    """The ego at one step: box centre in the map's frame."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad] counter-clockwise from +x
    speed: float  # [m/s] never negative


@runtime_checkable
class Driver(Protocol):
    """Who drives the ego in closed loop. Sent to a worker process, so picklable until `start`."""

    def start(self, scenario: Scenario) -> None:
        """Prepare to drive through `scenario`."""
        ...

    def advance(self, step: int, seen: Seen) -> tuple[float, float, float, float]:
        """An EgoState for `step` + 1 from what SUMO reports at `step`: box centres in the map's frame, 0 if absent."""
        ...


@dataclass(frozen=True, eq=False)
class SumoReplay:
    """What SUMO reports after each step, in the order of the scenario's agents and signals."""

    tracks: Tracks  # box centres in the map's frame; speeds of the placed as SUMO was told them
    collisions: tuple[ReportedCollision, ...]  # its own list, which never holds side-swipes
    signals: tuple[Signal, ...]
    driven: frozenset[int] = frozenset()  # agents that SUMO drove


def replay_in_sumo(
    scenario: Scenario,
    driver: Driver | None = None,
    gui: bool = False,
    released: Mapping[int, DriverParameters] | None = None,
    seed: int = 0,
) -> SumoReplay:
    """Replay `scenario`, the ego by its track or by `driver`. Call it in a worker process.

    What is placed before step k is what SUMO reports after it, and that is step k of the
    scenario; at step 0 the ego is always at its track. Agents that are `released` (by index) are
    placed once, where and as fast as they first are, and then driven by SUMO until their route
    ends; those for whom no route is found stay on their tracks. `seed` is for SUMO's dice.

    A map that does not come from SUMO is a network of bare lanes there, without lights (`bare_network`).
    Raises ScenarioError where SUMO is to drive in such a one, SumoError with SUMO's own words where it
    refuses, PlannerError where the driver fails.
    """
    if released and scenario.road.sumo_net is None:
        raise ScenarioError(
            f"case {scenario.id}: its map has no SUMO network (source: {scenario.provenance.source}) for SUMO to drive "
            "in; expected a case recorded in SUMO, or --background log"
        )
    if driver is not None:
        ask(lambda: driver.start(scenario), "before the first step")
    routes = {index: route for index in released or {} if (route := route_of(scenario, index)) is not None}
    drivers = {index: (released or {})[index] for index in routes}
    with _files(scenario, drivers) as files, running_sumo(_options(scenario, files, gui, seed), gui) as sumo:
        stage = _Stage(sumo, scenario, routes, drivers)
        for step in range(scenario.tracks.steps):
            stage.play(step)
            if gui:
                stage.show(step)
            if driver is not None and step + 1 < scenario.tracks.steps:
                stage.move_ego(step + 1, _decision(driver, step, stage.seen))
        return stage.finish()


@contextmanager
def _files(scenario: Scenario, drivers: Mapping[int, DriverParameters]) -> Iterator[dict[str, str]]:
    """Input files by SUMO's options for them."""
    with network_file(network_of(scenario.road)) as path:
        types = path.with_name("types.add.xml")
        types.write_bytes(type_file(scenario.agents, drivers))
        yield {"net-file": str(path), "additional-files": str(types)}


@contextmanager
def network_file(net: bytes) -> Iterator[Path]:
    """A network (gzip) where SUMO can read it."""
    with scratch_folder() as folder:
        path = folder / "replay.net.xml.gz"
        path.write_bytes(net)
        yield path


def _options(scenario: Scenario, files: dict[str, str], gui: bool, seed: int) -> list[str]:
    """The network alone, without traffic of its own; SUMO reports collisions and lets everyone go on."""
    options = files | {
        "step-length": repr(scenario.dt),
        "seed": str(seed),
        "time-to-teleport": "-1",
        "collision.action": "warn",
        "collision.mingap-factor": "0",
        "collision.check-junctions": "true",
        "no-step-log": "true",
        "no-warnings": "true",
    }
    if gui:
        options |= {"start": "true", "quit-on-end": "true", "window-size": "1200,900"}
    return [word for name, value in options.items() for word in (f"--{name}", value)]


# --- the driver -------------------------------------------------------------------------------


def _decision(driver: Driver, step: int, seen: Seen) -> EgoState:
    found = ask(lambda: driver.advance(step, Seen(*(np.copy(values) for values in seen))), f"at step {step}")
    try:
        ego = EgoState(*(float(value) for value in found))
    except (TypeError, ValueError) as error:
        raise PlannerError(
            f"the planner answered {found!r} at step {step}, expected four numbers: x, y, yaw, speed"
        ) from error
    if not np.isfinite(ego).all() or ego.speed < 0:
        raise PlannerError(
            f"the planner put the ego at {ego} after step {step}, expected finite numbers and speed >= 0"
        )
    return ego


def ask(question: Callable[[], _R], when: str) -> _R:
    """The answer of somebody else's code. Raises DriveError where it fails."""
    try:
        return question()
    except RegentsError:
        raise
    except Exception as error:  # somebody else's code: whatever it raises is an answer
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise DriveError(f"the planner failed {when} ({said})", "".join(format_exception(error))) from error


# --- SUMO -------------------------------------------------------------------------------------


class _Stage:
    """The running simulation, and what has been seen of it."""

    def __init__(
        self,
        sumo: ModuleType,
        scenario: Scenario,
        routes: Mapping[int, list[str]],
        drivers: Mapping[int, DriverParameters],
    ) -> None:
        self._sumo = sumo
        self._scenario = scenario
        self._drivers = drivers
        self._waiting = set(routes)  # to be driven by SUMO, once they are there
        self._driven: set[int] = set()
        track = scenario.tracks
        self._size = np.array([[agent.length, agent.width] for agent in scenario.agents]).T  # [2, agent]
        self._pose = np.stack(to_sumo(Pose(track.x, track.y, track.yaw), self._size[0, :, None]))  # [3, agent, time]
        self._speed = track.speed.copy()
        self._names: dict[int, str] = {}  # SUMO's name of every agent on the road
        self._agent: dict[str, int] = {}  # and back; names are never used twice
        self._seen: list[Seen] = []
        self._collisions: list[ReportedCollision] = []
        self._signals = scenario.signals if scenario.road.sumo_net else ()  # bare lanes have no lights
        self._letters: dict[str, list[str]] = {signal.id: [] for signal in self._signals}
        self._check_signals()
        sumo.route.add("replay", [_some_edge(scenario)])
        for index, edges in routes.items():
            sumo.route.add(driven_type(index), edges)
        for index, agent in enumerate(scenario.agents):
            add_type(sumo, _type_name(index), agent)

    @property
    def seen(self) -> Seen:
        """The agents after the last step."""
        return self._seen[-1]

    def play(self, step: int) -> None:
        """Place everything, let SUMO make one step, read everything."""
        self._show_signals(step)
        entering = [index for index in sorted(self._waiting) if self._may_enter(index, step)]
        for index in entering:
            self._place(index, step)
        for index in range(len(self._scenario.agents)):
            if index in self._drivers:
                continue
            if self._scenario.tracks.valid[index, step]:
                self._place(index, step)
            elif index in self._names:
                self._remove(index)
        self._sumo.simulationStep()
        self._read(step)
        for index in entering:
            self._release(index, step)

    def show(self, step: int) -> None:
        """Keep sumo-gui on the ego, in real time."""
        if step == 0:
            window, ego = self._sumo.gui, self.seen
            (view,) = window.getIDList()
            low, high = (np.array([ego.x[0], ego.y[0]]) + side * _IN_SIGHT_M for side in (-1, 1))
            window.setSchema(view, "real world")
            window.setBoundary(view, *low.tolist(), *high.tolist())
            window.trackVehicle(view, self._names[0])
        time.sleep(self._scenario.dt)

    def move_ego(self, step: int, ego: EgoState) -> None:
        """Let the ego be at `ego` at `step`."""
        self._pose[:, 0, step] = to_sumo(Pose(ego.x, ego.y, ego.yaw), self._scenario.ego.length)
        self._speed[0, step] = ego.speed

    def finish(self) -> SumoReplay:
        """All that was seen."""
        columns = (np.stack(values, axis=1) for values in zip(*self._seen, strict=True))
        tracks = Tracks(**dict(zip(Seen._fields, columns, strict=True)))
        signals = tuple(Signal(name, _changes(letters)) for name, letters in self._letters.items())
        return SumoReplay(tracks, tuple(self._collisions), signals, frozenset(self._drivers))

    def _place(self, index: int, step: int) -> None:
        vehicle = self._sumo.vehicle
        if index not in self._names:
            self._enter(index)
        name = self._names[index]
        x, y, angle = self._pose[:, index, step].tolist()
        vehicle.moveToXY(name, "", -1, x, y, angle, _EXACT_ON_ROUTE if index in self._drivers else EXACT)
        vehicle.setSpeed(name, float(self._speed[index, step]))

    def _may_enter(self, index: int, step: int) -> bool:
        """Whether an agent is there that SUMO is to drive, and its place is free: others may have come differently."""
        if not self._scenario.tracks.valid[index, step]:
            return False
        if step == 0:
            return True
        seen, track = self.seen, self._scenario.tracks
        x, y, yaw, z = (float(values[index, step]) for values in (track.x, track.y, track.yaw, track.z))
        own = Boxes(x, y, yaw, *self._size[:, index].tolist(), z=z)
        taken = overlap(own, Boxes(seen.x, seen.y, seen.yaw, *self._size, z=seen.z))
        return not (taken & seen.valid).any()

    def _release(self, index: int, step: int) -> None:
        """From here on SUMO drives; above the limit only who was so from the beginning."""
        vehicle, name, driver = self._sumo.vehicle, self._names[index], self._drivers[index]
        if name not in vehicle.getIDList():
            return  # SUMO did not take it; it is asked again
        vehicle.setSpeed(name, _AS_SUMO_LIKES)
        vehicle.setSpeedMode(name, driver.speed_mode)
        vehicle.setLaneChangeMode(name, driver.lane_change_mode)
        limit = vehicle.getAllowedSpeed(name)
        if self._speed[index, step] > limit > 0.0:
            vehicle.setSpeedFactor(name, vehicle.getSpeedFactor(name) * float(self._speed[index, step]) / limit)
        self._waiting.discard(index)
        self._driven.add(index)

    def _enter(self, index: int) -> None:
        vehicle, agent = self._sumo.vehicle, self._scenario.agents[index]
        name = free_name(agent.id, self._agent)
        if index in self._drivers:
            vehicle.add(name, driven_type(index), driven_type(index))
        else:
            vehicle.add(name, "replay", _type_name(index))
        vehicle.setSpeedMode(name, 0)
        vehicle.setLaneChangeMode(name, 0)
        vehicle.setColor(name, _COLOURS[agent.role])
        self._names[index], self._agent[name] = name, index

    def _remove(self, index: int) -> None:
        name = self._names.pop(index)
        if name in self._sumo.vehicle.getIDList():
            self._sumo.vehicle.remove(name)

    def _read(self, step: int) -> None:
        vehicle, agents = self._sumo.vehicle, self._scenario.agents
        states, valid = np.zeros((4, len(agents))), np.zeros(len(agents), bool)
        there = set(vehicle.getIDList())
        for index, name in self._names.items():
            if name in there:
                if index not in self._driven:
                    # SUMO keeps the old speed, or says 0, where an agent enters or comes onto another lane:
                    # at 1.5 % of the steps of random drives around a crossing
                    vehicle.setPreviousSpeed(name, float(self._speed[index, step]))
                front_x, front_y = vehicle.getPosition(name)
                pose = from_sumo(SumoPose(front_x, front_y, vehicle.getAngle(name)), agents[index].length)
                states[:, index] = *pose, vehicle.getSpeed(name)
                valid[index] = True
        x, y, yaw, speed = states
        z = np.where(valid, self._scenario.heights(x, y), 0.0)
        self._seen.append(Seen(x, y, yaw, speed, valid, z))
        for found in self._sumo.simulation.getCollisions():
            collider, victim = (agents[self._agent[name]].id for name in (found.collider, found.victim))
            self._collisions.append(ReportedCollision(step, collider, victim, found.type))
        for name, letters in self._letters.items():
            letters.append(self._sumo.trafficlight.getRedYellowGreenState(name))

    def _check_signals(self) -> None:
        light = self._sumo.trafficlight
        known = set(light.getIDList())
        for signal in self._signals:
            if signal.id not in known:
                raise SumoError(
                    f"case {self._scenario.id}: signal {signal.id!r} is not in its SUMO network, which has "
                    f"{', '.join(sorted(known)) or 'no signals'}; the case and its map do not belong together"
                )
            links, shown = len(light.getControlledLinks(signal.id)), len(signal.letters(0))
            if links != shown:
                raise SumoError(
                    f"case {self._scenario.id}: signal {signal.id!r} shows {shown} letters, SUMO's has {links} links; "
                    "the case and its map do not belong together"
                )
            _check_letters(signal)

    def _show_signals(self, step: int) -> None:
        for signal in self._signals:
            for since, letters in signal.changes:
                if since == step:
                    self._sumo.trafficlight.setRedYellowGreenState(signal.id, letters)


def _some_edge(scenario: Scenario) -> str:
    """An edge that cars may use: SUMO wants a route for every vehicle, wherever it is placed."""
    if scenario.road.sumo_net is None:
        return BARE_EDGE
    return edge_of(next(lane for lane in scenario.road.lanes if not lane.junction))


def add_type(sumo: ModuleType, name: str, agent: Agent | AgentState) -> None:
    """A type of vehicle of the size and looks of `agent`."""
    kinds = sumo.vehicletype
    kinds.copy("DEFAULT_VEHTYPE", name)
    kinds.setLength(name, agent.length)
    kinds.setWidth(name, agent.width)
    kinds.setShapeClass(name, _SHAPES[agent.kind])


def _check_letters(signal: Signal) -> None:
    """SUMO itself takes any letter without a word."""
    for step, letters in signal.changes:
        for letter in letters:
            if letter not in _LETTERS:
                raise SumoError(f"signal {signal.id!r} shows {letter!r} at step {step}, expected SUMO's: {_LETTERS}")


def _type_name(index: int) -> str:
    return f"agent{index}"


def free_name(agent_id: str, taken: Collection[str]) -> str:
    """A name that SUMO takes and that nobody had before: logs hold blanks, bars, any character."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", agent_id) or "_"
    name, number = plain, 1
    while name in taken:
        number += 1
        name = f"{plain}#{number}"
    return name


def _changes(letters: list[str]) -> tuple[tuple[int, str], ...]:
    return tuple((k, now) for k, now in enumerate(letters) if k == 0 or now != letters[k - 1])
