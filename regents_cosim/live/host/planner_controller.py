"""Lets a planner drive one vehicle of a running simulation, among SUMO's own traffic.

Every half a second the planner gets a scene with the current prediction, since lights change and vehicles appear. In
between it drives by what SUMO reports after each step.
"""

from typing import Any

import numpy as np

from regents_cosim.errors import SumoError
from regents_cosim.live.host.frame import Frame
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.host.vehicle_control import SumoVehicleControl
from regents_cosim.live.predict.moments import DT_S, MOST_AGENTS, Moment, Moments
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.planners.controllers import HostController, LoopController
from regents_cosim.planners.interface import Snapshot

_EGO_COLOUR = (0, 114, 178, 255)
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
        """Set the ego's state for the next step. Returns the frame, or None if the ego is gone or has arrived."""
        frame = self._reader.frame(ego, float(self._sumo.simulation.getTime()))
        if frame is None or self._has_arrived(ego):
            self.give_back()
            return None
        if self._control is None:
            self._control = SumoVehicleControl(
                self._sumo, ego, frame.types[0].length, self._reader.road, colour=_EGO_COLOUR
            )
        self._control.confirm()
        if self._moment is None or self._step * DT_S >= _ANOTHER_S - 1e-9:
            traffic = self._reader.traffic(frame, MOST_AGENTS, _HORIZON_S)
            self._moment, self._step = self._moments.of(traffic), 0
            self._driver.start(self._moment.scenario, self._moment.world)
        self._control.place(*self._driver.advance(self._step, _seen(frame, self._moment)))
        self._step += 1
        return frame

    def give_back(self) -> None:
        """Let SUMO drive the ego again."""
        if self._control is not None:
            self._control.give_back()
            self._control, self._moment = None, None

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
