"""The running simulation of a replay: places agents, lets SUMO drive others, and reads the result."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from regents_cosim.errors import SumoError
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import Pose, SumoPose, from_sumo, to_sumo
from regents_cosim.planners.interface import Debug, Placement, Snapshot
from regents_cosim.replays.sumo.vehicle_types import add_type, free_name, type_name
from regents_cosim.replays.verify import ReportedCollision
from regents_cosim.scenario.scenario import Scenario, Signal, Tracks
from regents_cosim.simulators import COLOURS
from regents_cosim.simulators.sumo.bare_network import BARE_EDGE
from regents_cosim.simulators.sumo.drivers import LANE_CHANGE_MODE, SPEED_MODE, Persons, driven_type, moved_as_persons
from regents_cosim.simulators.sumo.routes import edge_of

EXACT = 2  # keepRoute of moveToXY: this exact position, on any edge or on none
_EXACT_ON_ROUTE = 3  # the same, keeping the route
_AS_SUMO_LIKES = -1.0  # a speed: SUMO decides
_LETTERS = "rygGuosOY"
_PROGRAMME, _LASTS_S = "replay", 1e5  # name of the lights' programmes; duration of their last phase
_IN_SIGHT_M = 40.0  # visible radius around the ego in sumo-gui
_LOOKS_S = 0.1  # between two looks whether the user has closed sumo-gui


@dataclass(frozen=True, eq=False)
class SumoReplay:
    """SUMO's report after each step, in the order of the scenario's agents and signals."""

    tracks: Tracks  # box centres in the map's frame; speeds of placed agents as they were set
    collisions: tuple[ReportedCollision, ...]  # SUMO's own list, which never contains side-swipes
    signals: tuple[Signal, ...]
    driven: frozenset[int] = frozenset()  # agents that SUMO drove
    persons: frozenset[int] = frozenset()  # agents that were persons in SUMO; all others were vehicles
    thoughts: Mapping[int, Debug] = field(default_factory=dict)  # of the ego's planner, by step


class Stage:
    """The running simulation, and its states so far."""

    def __init__(
        self, sumo: ModuleType, scenario: Scenario, routes: Mapping[int, list[str]], ego_route: list[str] | None = None
    ) -> None:
        """`ego_route` is the route that others expect of the ego; without it, the route ends with the ego's edge."""
        self._sumo = sumo
        self._scenario = scenario
        self._drivers = frozenset(routes)  # agents that SUMO drives
        self._waiting = set(routes)  # to be driven by SUMO once they are present
        self._on_route = {*routes, *([0] if ego_route else [])}
        self._driven: set[int] = set()
        track = scenario.tracks
        self._size = np.array([[agent.length, agent.width] for agent in scenario.agents]).T  # [2, agent]
        self._pose = np.stack(to_sumo(Pose(track.x, track.y, track.yaw), self._size[0, :, None]))  # [3, agent, time]
        self._speed = track.speed.copy()
        self._names: dict[int, str] = {}  # SUMO's name of every agent on the road
        self._agent: dict[str, int] = {}  # the inverse; names are never used twice
        self._seen: list[Snapshot] = []
        self._collisions: list[ReportedCollision] = []
        self._signals = scenario.signals if scenario.road.sumo_net else ()  # bare lanes have no lights
        self._letters: dict[str, list[str]] = {signal.id: [] for signal in self._signals}
        self._check_signals()
        self._switched = False  # whether SUMO switches the lights by itself
        self._walking = moved_as_persons(scenario, self._drivers)
        self._persons = Persons(sumo, _some_edge(scenario))
        sumo.route.add("replay", [_some_edge(scenario)])
        for index, edges in (dict(routes) | ({0: ego_route} if ego_route else {})).items():
            sumo.route.add(driven_type(index), edges)
        for index, agent in enumerate(scenario.agents):
            add_type(sumo, type_name(index), agent, is_person=index in self._walking)

    @property
    def seen(self) -> Snapshot:
        """The agents after the last step."""
        return self._seen[-1]

    @property
    def ego(self) -> str:
        """SUMO's name of the ego, once it is present."""
        return self._names[0]

    def play(self, step: int) -> None:
        """Place all agents, let SUMO make one step, and read the result."""
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
        """Keep sumo-gui centred on the ego, in real time."""
        if step == 0:
            window, ego = self._sumo.gui, self.seen
            (view,) = window.getIDList()
            low, high = (np.array([ego.x[0], ego.y[0]]) + side * _IN_SIGHT_M for side in (-1, 1))
            window.setSchema(view, "real world")
            window.setBoundary(view, *low.tolist(), *high.tolist())
            window.trackVehicle(view, self._names[0])
        time.sleep(self._scenario.dt)

    def hold(self) -> None:
        """Wait until the user closes sumo-gui's window, which a thread of its own draws."""
        while self._sumo.simulation.isLoaded():
            time.sleep(_LOOKS_S)

    def move_ego(self, step: int, ego: Placement) -> None:
        """Put the ego at the state `ego` at `step`."""
        self._pose[:, 0, step] = to_sumo(Pose(ego.x, ego.y, ego.yaw), self._scenario.ego.length)
        self._speed[0, step] = ego.speed

    def finish(self) -> SumoReplay:
        """The replay with all steps so far."""
        columns = (np.stack(values, axis=1) for values in zip(*self._seen, strict=True))
        tracks = Tracks(**dict(zip(Snapshot._fields, columns, strict=True)))
        signals = tuple(Signal.of(name, letters) for name, letters in self._letters.items())
        return SumoReplay(tracks, tuple(self._collisions), signals, self._drivers, self._walking)

    def _place(self, index: int, step: int) -> None:
        vehicle = self._sumo.vehicle
        if index not in self._names:
            self._enter(index)
        name = self._names[index]
        x, y, angle = self._pose[:, index, step].tolist()
        if index in self._walking:
            self._persons.place(name, x, y, angle)
            return
        vehicle.moveToXY(name, "", -1, x, y, angle, _EXACT_ON_ROUTE if index in self._on_route else EXACT)
        vehicle.setSpeed(name, float(self._speed[index, step]))

    def _may_enter(self, index: int, step: int) -> bool:
        """Whether an agent to be driven by SUMO is present, and its place is free of others."""
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
        """Let SUMO drive an agent from here on; one that is above the limit now may stay that much above it."""
        vehicle, name = self._sumo.vehicle, self._names[index]
        if name not in vehicle.getIDList():
            return  # SUMO has not inserted it yet; it is tried again
        vehicle.setSpeed(name, _AS_SUMO_LIKES)
        vehicle.setSpeedMode(name, SPEED_MODE)
        vehicle.setLaneChangeMode(name, LANE_CHANGE_MODE)
        limit = vehicle.getAllowedSpeed(name)
        if self._speed[index, step] > limit > 0.0:
            vehicle.setSpeedFactor(name, vehicle.getSpeedFactor(name) * float(self._speed[index, step]) / limit)
        self._waiting.discard(index)
        self._driven.add(index)

    def _enter(self, index: int) -> None:
        vehicle, agent = self._sumo.vehicle, self._scenario.agents[index]
        name = free_name(agent.id, self._agent)
        self._names[index], self._agent[name] = name, index
        if index in self._walking:
            self._persons.enter(name, type_name(index), COLOURS[agent.role])
            return
        route = driven_type(index) if index in self._on_route else "replay"
        vehicle.add(name, route, driven_type(index) if index in self._drivers else type_name(index))
        vehicle.setSpeedMode(name, 0)
        vehicle.setLaneChangeMode(name, 0)
        vehicle.setColor(name, COLOURS[agent.role])

    def _remove(self, index: int) -> None:
        name = self._names.pop(index)
        if index in self._walking:
            self._persons.remove(name)
        elif name in self._sumo.vehicle.getIDList():
            self._sumo.vehicle.remove(name)

    def _read(self, step: int) -> None:
        vehicle, agents = self._sumo.vehicle, self._scenario.agents
        states, valid = np.zeros((4, len(agents))), np.zeros(len(agents), bool)
        there, on_foot = set(vehicle.getIDList()), self._persons.there() if self._walking else set()
        for index, name in self._names.items():
            if index in self._walking:
                if name in on_foot:
                    # in the first step SUMO derives a person's speed from where it departed
                    states[:, index] = *self._persons.pose(name, agents[index].length), self._speed[index, step]
                    valid[index] = True
            elif name in there:
                if index not in self._driven:
                    # SUMO reports the old speed, or 0, when an agent enters or changes lanes
                    vehicle.setPreviousSpeed(name, float(self._speed[index, step]))
                front_x, front_y = vehicle.getPosition(name)
                pose = from_sumo(SumoPose(front_x, front_y, vehicle.getAngle(name)), agents[index].length)
                states[:, index] = *pose, vehicle.getSpeed(name)
                valid[index] = True
        x, y, yaw, speed = states
        z = np.where(valid, self._scenario.heights(x, y), 0.0)
        self._seen.append(Snapshot(x, y, yaw, speed, valid, z))
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
            if shown < links:  # programmes may have more letters than links, which SUMO shows too
                raise SumoError(
                    f"case {self._scenario.id}: signal {signal.id!r} shows {shown} letters, SUMO's has {links} links; "
                    "the case and its map do not belong together"
                )
            for step, letter in ((step, letter) for step, shown in signal.changes for letter in shown):
                if letter not in _LETTERS:  # SUMO would accept it silently
                    raise SumoError(
                        f"signal {signal.id!r} shows {letter!r} at step {step}, expected SUMO's: {_LETTERS}"
                    )

    def show_signals_ahead(self) -> None:
        """Give the lights programmes that switch them from now on and can be read. Call it before the first step."""
        light = self._sumo.trafficlight
        for signal in self._signals:
            lasts = [*np.diff([step for step, _ in signal.changes]) * self._scenario.dt, _LASTS_S]
            phases = [light.Phase(float(s), letters) for s, (_, letters) in zip(lasts, signal.changes, strict=True)]
            light.setProgramLogic(signal.id, light.Logic(_PROGRAMME, 0, 0, phases))
            light.setProgram(signal.id, _PROGRAMME)
        self._switched = True

    def _show_signals(self, step: int) -> None:
        for signal in () if self._switched else self._signals:
            for since, letters in signal.changes:
                if since == step:
                    self._sumo.trafficlight.setRedYellowGreenState(signal.id, letters)


def _some_edge(scenario: Scenario) -> str:
    """An edge that cars may use, since SUMO requires a route for every vehicle, wherever it is placed."""
    if scenario.road.sumo_net is None:
        return BARE_EDGE
    return edge_of(next(lane for lane in scenario.road.lanes if not lane.junction))
