"""Episodes of SUMO, one for each seed: a planner drives one vehicle, and an adversary attacks it."""

import math
import random
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import DriveError, SumoError, WorkerError
from regents_cosim.live.adversary import Adversary
from regents_cosim.live.attacked_ego import EgoFinder
from regents_cosim.live.host.interface import Frame, touched
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.host.vehicle_control import SumoVehicleControl
from regents_cosim.live.predict.moments import DT_S, MOST_AGENTS, Moment, Moments
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.live.settings import HORIZON_S
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.planners.controllers import HostController, LoopController, PlannerControllers
from regents_cosim.planners.interface import Snapshot
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario.scenario import VEHICLE_KINDS
from regents_cosim.simulators import ANY_EGO, COLOURS, STEP_S
from regents_cosim.simulators.sumo.config import SumoOptions, write_config
from regents_cosim.simulators.sumo.process import CRASHES_STAY, more_traffic, running_sumo
from regents_cosim.simulators.sumo.types import is_passenger_car, kind_of, vehicle_type_of
from regents_cosim.system.files.atomic import scratch_folder
from regents_cosim.system.workers import local_processes, result_of, submit

# Draws a vehicle by seed that the planner is to drive, where none is named.
_FROM_S = (20.0, 40.0)  # range from which the seed draws the earliest departure
_AMONG = 3  # others within the radius, since most networks are empty at first
_DRAWN = 0.3  # share of the eligible vehicles that is drawn, so that seeds differ where a network fills slowly
_AMONG_WITHIN_S = 180.0  # if no passenger car was drawn for so long, the next vehicle is taken


class DrawnEgo:
    """Draws a vehicle that departs among others. Call `departed` after every step of the simulation."""

    def __init__(self, connection: Any, seed: int, radius_m: float) -> None:
        self._sumo, self._radius_m = connection, radius_m
        self._dice = random.Random(seed)
        self._from_s = float(connection.simulation.getTime()) + self._dice.uniform(*_FROM_S)

    def departed(self) -> str | None:
        """The drawn vehicle in the step in which it departs, else None; once no more vehicles will depart, one on the
        road.

        Passenger cars are preferred.
        """
        now = float(self._sumo.simulation.getTime())
        if now < self._from_s:
            return None
        there = self._sumo.vehicle.getIDList()
        if self._sumo.simulation.getMinExpectedNumber() <= len(there):
            left = [name for name in there if self._is_vehicle(name)]
            left = list(filter(self._is_car, left)) or left
            return self._dice.choice(left) if left else None
        departed = (name for name in self._sumo.simulation.getDepartedIDList() if self._is_vehicle(name))
        anyone = now > self._from_s + _AMONG_WITHIN_S
        return next((name for name in departed if anyone or (self._is_drawn(name, there) and self._is_car(name))), None)

    def _is_drawn(self, name: str, there: Sequence[str]) -> bool:
        """Whether a vehicle is drawn, and has enough of the vehicles in `there` around it."""
        vehicle = self._sumo.vehicle
        at = vehicle.getPosition(name)
        near = sum(math.dist(at, vehicle.getPosition(other)) < self._radius_m for other in there) - 1  # without itself
        return near >= _AMONG and self._dice.random() < _DRAWN

    def _is_car(self, name: str) -> bool:
        return is_passenger_car(vehicle_type_of(self._sumo.vehicle, name))

    def _is_vehicle(self, name: str) -> bool:
        return kind_of(self._sumo.vehicle.getVehicleClass(name)) in VEHICLE_KINDS


How = Literal[
    "crash", "met another", "arrived", "time over", "gone", "never departed", "planner failed", "process died"
]

_WAITED_S = 600.0  # longest time until the ego departs


@dataclass(frozen=True)
class Episodes:
    """The settings that all episodes share."""

    options: SumoOptions
    ego: str  # a vehicle, a type or a flow; or auto
    planner: AnyPlanner
    method: AttackConfig | str = "focused-live"
    expected: AnyPlanner = ""  # planner that predicts the ego, if it is not the one that drives
    attack: bool = True
    replan_s: float = 0.5
    horizon_s: float = HORIZON_S
    radius_m: float = 100.0
    most_s: float = 60.0
    output: Path | None = None
    act_timeout_s: float = ACT_TIMEOUT_S
    gui: bool = False

    def __post_init__(self) -> None:
        """The planner becomes the one found, for all episodes. Raises PlannerError."""
        object.__setattr__(self, "planner", PlannerUnderTest.of(self.planner))


@dataclass(frozen=True)
class EpisodeResult:
    """The result of one episode."""

    seed: int
    how: How
    ego: str = ""
    lasted_s: float = 0.0
    adversary: str = ""  # the last adversary
    attacks: int = 0
    cases: tuple[str, ...] = ()
    told: tuple[str, ...] = ()


def run_episodes(episodes: Episodes, seeds: list[int]) -> Iterator[EpisodeResult]:
    """Run all episodes in sequence in one process; if the process dies, only that episode is lost."""
    with local_processes(1) as executor:
        for seed in seeds:
            try:
                yield result_of(submit(executor, run_episode, episodes, seed))
            except WorkerError as died:
                yield EpisodeResult(seed, "process died", told=(str(died),))


def forced_options(seed: int) -> dict[str, str]:
    """Options of SUMO that replace those of the configuration."""
    return {"step-length": str(STEP_S), "seed": str(seed), **CRASHES_STAY}


def run_episode(episodes: Episodes, seed: int) -> EpisodeResult:
    """Run one episode. Call it in a worker process."""
    with scratch_folder() as folder:
        command = ["-c", str(write_config(episodes.options, folder, forced_options(seed), {}))]
        if episodes.gui:
            command += ["--start", "true", "--quit-on-end", "true"]
        with (
            running_sumo(command, episodes.gui) as sumo,
            PlannerControllers(episodes.planner, episodes.act_timeout_s) as drivers,
            drivers.lend() as driver,
        ):
            return _Episode(episodes, seed, sumo, driver).run()


class _Episode:
    """A running episode."""

    def __init__(self, episodes: Episodes, seed: int, sumo: Any, driver: Any) -> None:
        self._of, self._seed, self._sumo, self._driver = episodes, seed, sumo, driver
        self._told: list[str] = []

    def run(self) -> EpisodeResult:
        """Run the episode to its end."""
        ego = self._departed()
        if ego is None:
            return EpisodeResult(self._seed, "never departed", self._of.ego)
        begun_s = self._now
        body = vehicle_type_of(self._sumo.vehicle, ego)
        if self._of.ego == ANY_EGO and not is_passenger_car(body):
            self._told.append(f"no passenger car departed: the ego {ego} is a {body.kind} of {body.length:.3g} m")
        adversary = Adversary(
            self._sumo, ego, self._of.expected or self._of.planner, self._of.method,
            replan_s=self._of.replan_s, horizon_s=self._of.horizon_s, radius_m=self._of.radius_m,
            attack_when=None if self._of.attack else lambda _: False, output=self._of.output,
            source=self._of.options.file.name, seed=self._seed, tell=self._told.append,
        )  # fmt: skip
        how: How = "time over"
        try:
            how = self._drive(ego, adversary, begun_s + self._of.most_s)
        except DriveError as failure:
            self._told.append(str(failure))
            how = "planner failed"
        finally:
            adversary.detach()
        tally = adversary.tally
        last = tally.adversaries[-1] if tally.adversaries else ""
        lasted_s = round(self._now - begun_s, 3)
        return EpisodeResult(self._seed, how, ego, lasted_s, last, tally.attacks, tuple(tally.cases), tuple(self._told))

    def _drive(self, ego: str, adversary: Adversary, until_s: float) -> How:
        wheel = PlannerController(self._sumo, self._driver, self._of.radius_m)
        while self._now < until_s:
            frame = wheel.go(ego)
            if frame is None:
                return "arrived" if ego in self._sumo.vehicle.getIDList() else "gone"
            crashes = adversary.tally.crashes
            adversary.step()
            if touched(frame):
                return "crash" if adversary.tally.crashes > crashes else "met another"
            if self._of.gui:
                time.sleep(0.1)
            self._sumo.simulationStep()
        return "time over"

    @property
    def _now(self) -> float:
        return float(self._sumo.simulation.getTime())

    def _departed(self) -> str | None:
        """The ego, once it is on the road; else None."""
        begun_s = self._now
        if self._of.ego == ANY_EGO:
            find = DrawnEgo(self._sumo, self._seed, self._of.radius_m).departed
        else:
            find = EgoFinder(self._sumo, self._of.ego, is_free=lambda _: True).find
        while self._now < begun_s + _WAITED_S and more_traffic(self._sumo):
            self._sumo.simulationStep()
            if (chosen := find()) is not None:
                return chosen
        return None


# Lets a planner drive one vehicle of a running simulation, among SUMO's own traffic.
# Every half a second the planner gets a scene with the current prediction, since lights change and vehicles appear.
# In between it drives by what SUMO reports after each step.
_HORIZON_S = 5.0  # duration of the scenes
_ANOTHER_S = 0.5  # time between scenes
_ARRIVED_M = 15.0  # distance to the end of the last edge at which the ego has arrived


class PlannerController:
    """Drives the ego; call `go` after every step of the simulation, whose steps are 0.1 s."""

    def __init__(self, connection: Any, driver: LoopController | HostController, radius_m: float = 100.0) -> None:
        """Raises SumoError for a simulation with another step."""
        self._sumo, self._driver = connection, driver
        self._reader = SimulationReader(connection, radius_m)
        if abs(self._reader.step_s - DT_S) > 1e-9:
            raise SumoError(f"steps of {self._reader.step_s:g} s, expected {DT_S} s: a planner drives at that")
        self._moments = Moments(CarFollowingPredictor(), _HORIZON_S)
        self._moment: Moment | None = None
        self._control: SumoVehicleControl | None = None
        self._step = 0

    @in_float32
    def go(self, ego: str) -> Frame | None:
        """Set the ego's state for the next step; return the frame, or None (and let SUMO drive) once it has arrived."""
        frame = self._reader.frame(ego, float(self._sumo.simulation.getTime()))
        if frame is None or self._has_arrived(ego):
            if self._control is not None:
                self._control.give_back()
                self._control, self._moment = None, None
            return None
        if self._control is None:
            self._control = SumoVehicleControl(
                self._sumo, ego, frame.types[0].length, self._reader.road, colour=COLOURS["ego"]
            )
        self._control.confirm()
        if self._moment is None or self._step * DT_S >= _ANOTHER_S - 1e-9:
            traffic = self._reader.traffic(frame, MOST_AGENTS, _HORIZON_S)
            self._moment, self._step = self._moments.of(traffic), 0
            self._driver.start(self._moment.scenario, self._moment.world)
        self._control.place(*self._driver.advance(self._step, _seen(frame, self._moment)))
        self._step += 1
        return frame

    def _has_arrived(self, ego: str) -> bool:
        vehicle = self._sumo.vehicle
        lane, route = vehicle.getLaneID(ego), vehicle.getRoute(ego)
        if not route or lane.rpartition("_")[0] != route[-1]:
            return False
        return self._sumo.lane.getLength(lane) - vehicle.getLanePosition(ego) < _ARRIVED_M


def _seen(frame: Frame, moment: Moment) -> Snapshot:
    """The current states of a moment's agents; vehicles that came later appear in the next moment."""
    boxes, agents = frame.boxes, moment.scenario.agents
    rows = [frame.number.get(agent.id, -1) for agent in agents]
    valid = np.array(rows) >= 0
    x, y, yaw, speed, z = (
        np.where(valid, np.asarray(values)[rows], 0.0) for values in (boxes.x, boxes.y, boxes.yaw, frame.speed, boxes.z)
    )
    return Snapshot(x, y, yaw, np.maximum(speed, 0.0), valid, z)
