"""Writes OpenSCENARIO 1.2 with the road as OpenDRIVE: every agent follows its timed trajectory.

According to the standard the position of a vehicle is that of its rear axle, here 0.3 of its length behind the box
centre, and its bounding box lies that far ahead of it; pedestrians and other objects are placed by their centre. Agents
are added and deleted at the times when they appear and leave. Each traffic light is a controller of the signals that
netconvert puts into the road, lamp by lamp: red, yellow, green.

Source of the format: ASAM OpenSCENARIO XML 1.2.0, FollowTrajectoryAction, Vehicle, Axles, BoundingBox,
TrafficSignalController.
"""

import subprocess
import xml.etree.ElementTree as ET
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from regents_cosim.errors import MissingDependencyError, RegentsError, install_hint
from regents_cosim.exports.lights import without_place
from regents_cosim.exports.stays import Presence, poses, stays
from regents_cosim.scenario.scenario import Agent, Scenario
from regents_cosim.simulators.sumo.bare_network import network_of

_REAR_AXLE = 0.3  # of the length, behind the centre: half a wheelbase of 0.6
_CATEGORIES = {"car": "car", "truck": "truck", "bus": "bus", "motorcycle": "motorbike", "bicycle": "bicycle"}
_HEIGHTS_M = {"truck": 3.4, "bus": 3.2}
_HEIGHT_M = 1.6
_MASS_KG = 80.0  # of pedestrians and other objects; the schema requires a mass
_WHEEL_M = 0.6
_STEER_RAD = 0.6
_SPEED_M_S, _ACCEL_M_S2 = 70.0, 10.0  # a vehicle's limits, which trajectories ignore
_LAMPS = {
    **dict.fromkeys("rs", "on;off;off"), "u": "on;on;off", **dict.fromkeys("yY", "off;on;off"),
    **dict.fromkeys("gG", "off;off;on"),
}  # fmt: skip
_DARK = "off;off;off"
_NET, _ROAD, _CASE = "case.net.xml.gz", "case.xodr", "case.xosc"


def write_openscenario(scenario: Scenario, folder: Path) -> list[str]:
    """Write `case.xosc`, `case.xodr` and its network into `folder`; returns what is left out, as messages.

    Raises RegentsError where the packages of the extra `openscenario` are missing.
    """
    xosc = _package("scenariogeneration.xosc")
    (folder / _NET).write_bytes(network_of(scenario.road))
    _write_road(folder)
    links = _signals_of(scenario, folder / _ROAD)
    left_out = without_place(scenario, ((signal, link) for signal, found in links.items() for link in found))
    _Storyboard(xosc, scenario, links).scenario("; ".join([scenario.id, *left_out])).write_xml(str(folder / _CASE))
    return left_out


def _signals_of(scenario: Scenario, road: Path) -> dict[str, dict[int, str]]:
    """For every traffic light of the OpenDRIVE road, the ids of its signals there, by link."""
    there = {element.get("id", "") for element in ET.parse(road).getroot().iter("signal")}
    found = dict[str, dict[int, str]]()
    for signal in scenario.signals:
        names = {link: f"{signal.id}_{link}" for link in range(len(signal.letters(0)))}
        found[signal.id] = {link: name for link, name in names.items() if name in there}
    return {signal: links for signal, links in found.items() if links}


def rear_axle(agent: Agent) -> float:
    """The distance of the reference point behind the box centre [m]."""
    return 0.0 if agent.kind in ("pedestrian", "other") else _REAR_AXLE * agent.length


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingDependencyError(
            f"OpenSCENARIO needs scenariogeneration and eclipse-sumo ({error}); install them with "
            f"{install_hint('openscenario')}"
        ) from error


def _write_road(folder: Path) -> None:
    """Write the road as OpenDRIVE in the network's coordinates, which netconvert does not shift."""
    program = Path(_package("sumo").SUMO_HOME) / "bin" / "netconvert"
    words = ["--sumo-net-file", _NET, "--opendrive-output", _ROAD, "--offset.disable-normalization", "--no-warnings"]
    # Run inside the folder, since netconvert writes its arguments into the file.
    done = subprocess.run([str(program), *words], capture_output=True, text=True, cwd=folder)
    if done.returncode or not (folder / _ROAD).is_file():
        raise RegentsError(f"netconvert made no OpenDRIVE of the network: {' '.join(done.stderr.split())[-500:]}")


class _Storyboard:
    """One Scenario in terms of scenariogeneration's `xosc`."""

    def __init__(self, xosc: Any, scenario: Scenario, links: dict[str, dict[int, str]]) -> None:
        self._xosc, self._case, self._links = xosc, scenario, links

    def scenario(self, description: str) -> Any:
        """The whole file."""
        xosc = self._xosc
        entities = xosc.Entities()
        for agent in self._case.agents:
            entities.add_scenario_object(agent.id, self._entity(agent))
        return xosc.Scenario(
            description, "regents_cosim", xosc.ParameterDeclarations(), entities, self._storyboard(),
            self._road(), xosc.Catalog(), osc_minor_version=2,
        )  # fmt: skip

    def _road(self) -> Any:
        """The road, with a controller for each light, which repeats after the case."""
        xosc, dt, steps = self._xosc, self._case.dt, self._case.tracks.steps
        network = xosc.RoadNetwork(_ROAD)
        for signal in (one for one in self._case.signals if one.id in self._links):
            controller = xosc.TrafficSignalController(signal.id)
            for number, (count, letters) in enumerate(signal.phases(steps)):
                phase = xosc.Phase(str(number), round(count * dt, 9))
                for link, name in self._links[signal.id].items():
                    phase.add_signal_state(name, _LAMPS.get(letters[link], _DARK))
                controller.add_phase(phase)
            network.add_traffic_signal_controller(controller)
        return network

    def _entity(self, agent: Agent) -> Any:
        xosc, height = self._xosc, _HEIGHTS_M.get(agent.kind, _HEIGHT_M)
        back = rear_axle(agent)
        box = xosc.BoundingBox(agent.width, agent.length, height, back, 0.0, 0.5 * height)
        if agent.kind == "pedestrian":
            return xosc.Pedestrian(agent.kind, _MASS_KG, xosc.PedestrianCategory.pedestrian, box)
        if agent.kind == "other":
            return xosc.MiscObject(agent.kind, _MASS_KG, xosc.MiscObjectCategory.obstacle, box)
        front, rear = (
            xosc.Axle(steer, _WHEEL_M, 0.9 * agent.width, at, 0.5 * _WHEEL_M)
            for steer, at in ((_STEER_RAD, 2.0 * back), (0.0, 0.0))
        )
        category = getattr(xosc.VehicleCategory, _CATEGORIES[agent.kind])
        return xosc.Vehicle(agent.kind, category, box, front, rear, _SPEED_M_S, _ACCEL_M_S2, _ACCEL_M_S2)

    def _storyboard(self) -> Any:
        xosc = self._xosc
        board = xosc.StoryBoard(xosc.Init(), self._at((self._case.tracks.steps - 1) * self._case.dt, "end", "stop"))
        act = xosc.Act("replay", self._at(0.0, "begin"))
        for number, stay in enumerate(stays(self._case)):
            places = self._places(stay)
            if stay.first == 0:
                board.init.add_init_action(stay.agent.id, xosc.TeleportAction(places[0]))
            act.add_maneuver_group(self._group(f"{stay.agent.id} {number}", stay, places))
        story = xosc.Story("replay")
        story.add_act(act)
        board.add_story(story)
        return board

    def _group(self, name: str, stay: Presence, places: list[Any]) -> Any:
        """The actions of one agent: appear (unless present from the start), follow the trajectory, leave (unless it
        stays).
        """
        xosc, dt, who = self._xosc, self._case.dt, stay.agent.id
        maneuver = xosc.Maneuver(name)
        if stay.first > 0:
            maneuver.add_event(self._event(f"{name} comes", stay.first * dt, xosc.AddEntityAction(who, places[0])))
        if len(places) > 1:
            maneuver.add_event(self._event(f"{name} drives", stay.first * dt, self._follow(name, stay, places)))
        if stay.last + 1 < self._case.tracks.steps:
            gone = (stay.last + 1) * dt
            maneuver.add_event(self._event(f"{name} leaves", gone, xosc.DeleteEntityAction(who)))
        group = xosc.ManeuverGroup(name)
        group.add_actor(who)
        group.add_maneuver(maneuver)
        return group

    def _follow(self, name: str, stay: Presence, places: list[Any]) -> Any:
        xosc = self._xosc
        times = [round(step * self._case.dt, 9) for step in range(stay.first, stay.last + 1)]
        trajectory = xosc.Trajectory(name, closed=False)
        trajectory.add_shape(xosc.Polyline(times, places))
        timing = (xosc.ReferenceContext.absolute, 1.0, 0.0)
        return xosc.FollowTrajectoryAction(trajectory, xosc.FollowingMode.position, *timing)

    def _places(self, stay: Presence) -> list[Any]:
        x, y, yaw, _ = poses(self._case, stay).T
        back = rear_axle(stay.agent)
        z = self._case.tracks.z[stay.index, stay.steps]
        rows = np.stack([x - back * np.cos(yaw), y - back * np.sin(yaw), z, yaw], axis=-1).tolist()
        return [self._xosc.WorldPosition(x=px, y=py, z=pz, h=h, p=0.0, r=0.0) for px, py, pz, h in rows]

    def _event(self, name: str, time_s: float, action: Any) -> Any:
        event = self._xosc.Event(name, self._xosc.Priority.parallel)
        event.add_action(name, action)
        event.add_trigger(self._at(time_s, name))
        return event

    def _at(self, time_s: float, name: str, point: str = "start") -> Any:
        xosc = self._xosc
        condition = xosc.SimulationTimeCondition(round(time_s, 9), xosc.Rule.greaterOrEqual)
        return xosc.ValueTrigger(f"{name} at", 0, xosc.ConditionEdge.none, condition, triggeringpoint=point)
