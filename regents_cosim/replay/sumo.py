"""A Scenario in SUMO: every agent placed at every step, signals forced, nothing left to SUMO.

Placing is exact (`moveToXY` with keepRoute=2, 0.0000 m over 100,000 vehicle-steps) in plain mode
only: with `--lanechange.duration` or `--lateral-resolution` libsumo crashes when a vehicle is
driven off its lane. SUMO's own traffic would react to none of this, so there is none: the
network is empty but for our agents.
"""

import gzip
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.errors import SumoError
from regents_cosim.frames import Pose, SumoPose, from_sumo, to_sumo
from regents_cosim.scenario import Agent, Scenario, Tracks
from regents_cosim.sumo_process import running_sumo

_EXACT_ANYWHERE = 2  # keepRoute: the very position, also off the road
_ROUTE = "regents"
_GUI_DELAY_MS = 100  # real time at 10 Hz


class EgoState(NamedTuple):
    """Where a driver puts the ego: box centre in the map frame."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad]
    speed: float  # [m/s]


@runtime_checkable
class Driver(Protocol):
    """Somebody at the ego's wheel in a host simulator. Picklable until `start`."""

    def start(self, scenario: Scenario) -> None:
        """Called once before the first step."""
        ...

    def advance(
        self,
        step: int,
        x: Float[np.ndarray, " agent"],
        y: Float[np.ndarray, " agent"],
        yaw: Float[np.ndarray, " agent"],
        speed: Float[np.ndarray, " agent"],
        valid: Bool[np.ndarray, " agent"],
    ) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as the simulator reports them at `step`."""
        ...


@dataclass(frozen=True)
class SumoCollision:
    """An entry of SUMO's own list of collisions, which is no ground truth: side-swipes are never in it."""

    step: int
    collider: str
    victim: str
    type: str


@dataclass(frozen=True, eq=False)
class SumoReplay:
    """What SUMO reports while it replays."""

    tracks: Tracks  # box centres after each step, present where the scenario has them present
    collisions: tuple[SumoCollision, ...]


def replay_in_sumo(scenario: Scenario, driver: Driver | None = None, gui: bool = False) -> SumoReplay:
    """Replay `scenario`; the ego follows its track, or `driver`. Call it in a worker process.

    Raises SumoError where the scenario has no SUMO network or SUMO refuses.
    """
    if scenario.road.sumo_net is None:
        raise SumoError(f"case {scenario.id} has no SUMO network (it was not recorded from SUMO): use --in mirror")
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "map.net.xml"
        net.write_bytes(gzip.decompress(scenario.road.sumo_net))
        with running_sumo(_options(net, scenario, gui), gui) as sumo:
            return _run(sumo, scenario, driver)


def _options(net: Path, scenario: Scenario, gui: bool) -> list[str]:
    options = {
        "net-file": str(net),
        "step-length": str(scenario.dt),
        "time-to-teleport": "-1",
        "collision.action": "warn",
        "collision.mingap-factor": "0",  # otherwise coming closer than the standstill gap is reported
        "collision.check-junctions": "true",
        "no-step-log": "true",
        "no-warnings": "true",
    }
    if gui:
        options |= {"start": "true", "quit-on-end": "true", "delay": str(_GUI_DELAY_MS)}
    return [word for name, value in options.items() for word in (f"--{name}", value)]


def _run(sumo: ModuleType, scenario: Scenario, driver: Driver | None) -> SumoReplay:
    _check_signals(sumo, scenario)
    stage = _Stage(sumo, scenario)
    wanted = {name: np.array(getattr(scenario.tracks, name)) for name in ("x", "y", "yaw", "speed")}
    seen = {name: np.zeros_like(values) for name, values in wanted.items()}
    collisions: list[SumoCollision] = []
    if driver is not None:
        driver.start(scenario)
    for step in range(scenario.tracks.steps):
        stage.set(step, *(values[:, step] for values in wanted.values()))
        sumo.simulationStep()
        for name, values in zip(seen, stage.read(step), strict=True):
            seen[name][:, step] = values
        collisions += stage.collisions(step)
        if driver is not None and step + 1 < scenario.tracks.steps:
            now = (seen[name][:, step] for name in seen)
            ahead = driver.advance(step, *now, scenario.tracks.valid[:, step])
            for name, value in zip(wanted, ahead, strict=True):
                wanted[name][0, step + 1] = value
    return SumoReplay(Tracks(**seen, valid=scenario.tracks.valid), tuple(collisions))


def _check_signals(sumo: ModuleType, scenario: Scenario) -> None:
    unknown = {signal.id for signal in scenario.signals} - set(sumo.trafficlight.getIDList())
    if unknown:
        raise SumoError(f"case {scenario.id}: signals {sorted(unknown)[:3]} do not exist in its SUMO network")


class _Stage:
    """The agents of a scenario as vehicles of a running SUMO. Ids of logs may hold any letter, SUMO's may not."""

    def __init__(self, sumo: ModuleType, scenario: Scenario) -> None:
        self._sumo = sumo
        self._scenario = scenario
        self._entries = [0] * len(scenario.agents)  # an agent that comes back is a new vehicle
        sumo.route.add(_ROUTE, [_any_edge(sumo)])
        for index, agent in enumerate(scenario.agents):
            _add_type(sumo, f"type{index}", agent)

    def set(self, step: int, x: np.ndarray, y: np.ndarray, yaw: np.ndarray, speed: np.ndarray) -> None:
        """Command every vehicle and light; it takes effect in the next simulation step."""
        for signal in self._scenario.signals:
            for since, letters in signal.changes:
                if since == step:
                    self._sumo.trafficlight.setRedYellowGreenState(signal.id, letters)
        valid = self._scenario.tracks.valid
        for index, agent in enumerate(self._scenario.agents):
            was_there = step > 0 and valid[index, step - 1]
            if valid[index, step]:
                if not was_there:
                    self._enter(index)
                front = to_sumo(Pose(float(x[index]), float(y[index]), float(yaw[index])), agent.length)
                name = self._name(index)
                self._sumo.vehicle.moveToXY(name, "", -1, front.x, front.y, front.angle, _EXACT_ANYWHERE)
                self._sumo.vehicle.setSpeed(name, float(speed[index]))
            elif was_there:
                self._sumo.vehicle.remove(self._name(index))

    def read(self, step: int) -> tuple[np.ndarray, ...]:
        """x, y, yaw and speed [agent] as SUMO reports them, 0 for absent agents."""
        states = np.zeros((4, len(self._scenario.agents)))
        vehicle = self._sumo.vehicle
        for index in np.flatnonzero(self._scenario.tracks.valid[:, step]):
            name = self._name(index)
            pose = from_sumo(
                SumoPose(*vehicle.getPosition(name), vehicle.getAngle(name)), self._scenario.agents[index].length
            )
            states[:, index] = (*pose, max(vehicle.getSpeed(name), 0.0))
        return tuple(states)

    def collisions(self, step: int) -> Iterator[SumoCollision]:
        """SUMO's own verdict on the last step."""
        for found in self._sumo.simulation.getCollisions():
            pair = (self._agent(name) for name in (found.collider, found.victim))
            yield SumoCollision(step, *pair, found.type)

    def _enter(self, index: int) -> None:
        self._entries[index] += 1
        name = self._name(index)
        self._sumo.vehicle.add(name, _ROUTE, typeID=f"type{index}", depart="now")
        self._sumo.vehicle.setSpeedMode(name, 0)
        self._sumo.vehicle.setLaneChangeMode(name, 0)

    def _name(self, index: int) -> str:
        return f"agent{index}.{self._entries[index]}"

    def _agent(self, name: str) -> str:
        return self._scenario.agents[int(name.removeprefix("agent").partition(".")[0])].id


def _any_edge(sumo: ModuleType) -> str:
    """An edge for cars: a vehicle needs a route, though ours never follow it."""
    for lane in sumo.lane.getIDList():
        allowed = sumo.lane.getAllowed(lane)
        if not lane.startswith(":") and (not allowed or "passenger" in allowed):
            return sumo.lane.getEdgeID(lane)
    raise SumoError("the SUMO network has no lane for cars")


def _add_type(sumo: ModuleType, name: str, agent: Agent) -> None:
    sumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
    sumo.vehicletype.setLength(name, agent.length)
    sumo.vehicletype.setWidth(name, agent.width)
    colour = {"ego": (0, 114, 178, 255), "adversary": (213, 94, 0, 255)}.get(agent.role, (150, 150, 150, 255))
    sumo.vehicletype.setColor(name, colour)
