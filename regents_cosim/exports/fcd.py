"""Writes a folder that plain `sumo-gui` opens: the network, vehicle types, the case as FCD, and a configuration.

SUMO's own replayer (`--device.fcd-replay.files`, since 1.28) places every vehicle and person according to the FCD, so
that this package is not needed to watch it. The replay starts at time 0, and the lights follow the case.
"""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import shapely
import sumolib
from jaxtyping import Float

from regents_cosim.errors import require
from regents_cosim.exports.lights import without_place
from regents_cosim.exports.stays import lanes_along, poses, stays
from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.replays.sumo.vehicle_types import free_name
from regents_cosim.scenario.scenario import Agent, Kind, Role, Scenario, Signal
from regents_cosim.simulators.sumo.bare_network import lane_names, network_of
from regents_cosim.sources.fcd_rides import ALL_OF_A_CASE


class PermittedLanes:
    """The lanes of a network file (.net.xml.gz) that a vehicle class may use: SUMO inserts none on a closed lane."""

    def __init__(self, network: Path) -> None:
        self._net = sumolib.net.readNet(str(network), withInternal=True)
        self.nearest = cache(self._nearest)
        self.line = cache(lambda lane: shapely.LineString(self._net.getLane(lane).getShape()))  # [m], of the centre

    def _nearest(self, lane: str, vehicle_class: str) -> str:
        """The lane if it is open to a SUMO vehicle class, else the next open one of its edge, else the lane itself."""
        given = self._net.getLane(lane)
        beside = sorted(given.getEdge().getLanes(), key=lambda one: abs(one.getIndex() - given.getIndex()))
        return next((one.getID() for one in beside if one.allows(vehicle_class)), lane)


_CLASSES: dict[Kind, str] = {
    "car": "passenger", "truck": "truck", "bus": "bus", "motorcycle": "motorcycle", "bicycle": "bicycle",
    "pedestrian": "pedestrian", "other": "container",
}  # fmt: skip
_COLOURS: dict[Role, str] = {"ego": "8,104,201", "adversary": "226,84,10", "background": "146,154,165"}
_DIGITS = 6  # SUMO's default of two decimals means 1 cm
_GUI_DELAY_MS = 100.0


def write_fcd(scenario: Scenario, folder: Path) -> list[str]:
    """Write `case.net.xml.gz`, `types.add.xml`, `fcd.xml.gz`, `view.xml` and `case.sumocfg` into `folder`.

    Returns what is left out, as messages.

    A map that does not come from SUMO becomes a network of bare lanes, without lights. Raises ScenarioError where it
    has no lanes.
    """
    require(
        bool(scenario.road.lanes),
        f"case {scenario.id}: its map has no lanes, on which SUMO's replayer places vehicles (export it --to csv)",
    )
    (folder / "case.net.xml.gz").write_bytes(network_of(scenario.road))
    _write(folder / "types.add.xml", _additional(scenario))
    lanes = PermittedLanes(folder / "case.net.xml.gz")
    (folder / "fcd.xml.gz").write_bytes(gzip.compress(_bytes(_log(scenario, lanes)), mtime=0))
    _write(folder / "view.xml", _view(scenario))
    left_out = [] if scenario.road.sumo_net else without_place(scenario, ())
    _write(folder / "case.sumocfg", _configuration(scenario), *left_out)
    return left_out


def _write(path: Path, root: ET.Element, *said: str) -> None:
    for line in said:
        root.insert(0, ET.Comment(f" {line.replace('--', '__')} "))
    path.write_bytes(_bytes(root))


def _bytes(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


# --- the log ----------------------------------------------------------------------------------


def _log(scenario: Scenario, permitted: PermittedLanes) -> ET.Element:
    root = ET.Element("fcd-export")
    root.append(ET.Comment(ALL_OF_A_CASE))
    instants = [
        ET.SubElement(root, "timestep", time=_number(step * scenario.dt)) for step in range(scenario.tracks.steps)
    ]
    for step, entry in _entries(scenario, permitted):
        instants[step].append(entry)
    return root


def _entries(scenario: Scenario, permitted: PermittedLanes) -> Iterator[tuple[int, ET.Element]]:
    """The FCD entries with their steps: pedestrians as persons, all others as vehicles."""
    lanes_there, names = lane_names(scenario.road), _names(scenario)
    first_lane: dict[int, str] = {}  # by agent
    for stay in stays(scenario):
        x, y, yaw, speed = poses(scenario, stay).T
        front = to_sumo(Pose(x, y, yaw), stay.agent.length)
        points = np.stack([front.x, front.y], axis=-1)
        z = scenario.tracks.z[stay.index, stay.steps]
        lanes = lanes_along(scenario, points, z)
        on_foot = stay.agent.kind == "pedestrian"
        # Bare lanes are not connected, and persons walk beside lanes, but the replayer derives a route from the log.
        if on_foot or not scenario.road.sumo_net:
            first = _lane_beside(scenario, points[0], lanes[0]) if on_foot else lanes[0]
            lanes = [first_lane.setdefault(stay.index, first)] * len(lanes)
        named = [permitted.nearest(lanes_there[lane], _CLASSES[stay.agent.kind]) for lane in lanes]
        lines = [permitted.line(name) for name in named]
        along = shapely.line_locate_point(lines, shapely.points(points))
        values = {"x": front.x, "y": front.y, "angle": front.angle, "speed": speed, "pos": along}
        if not scenario.tracks.flat:
            values["z"] = z
        for k, name in enumerate(named):
            entry = {"id": names[stay.agent.id], "type": _type_of(stay.agent), "slope": "0"}
            entry |= {"edge": name.rpartition("_")[0]} if on_foot else {"lane": name}
            numbers = {key: _number(column[k]) for key, column in values.items()}
            yield stay.first + k, ET.Element("person" if on_foot else "vehicle", entry | numbers)


def _lane_beside(scenario: Scenario, point: Float[np.ndarray, " 2"], lane: str) -> str:
    """The lane, or the nearest one outside of junctions, since the replayer inserts no person within a junction."""
    outside = [one for one in scenario.road.lanes if not one.id.startswith(":")]
    if not lane.startswith(":") or not outside:
        return lane
    away = shapely.distance([one.line for one in outside], shapely.Point(point))
    return outside[int(np.argmin(away))].id


def _names(scenario: Scenario) -> dict[str, str]:
    """SUMO's name of each agent: its id without characters that SUMO does not accept."""
    names: dict[str, str] = {}
    for agent in scenario.agents:
        names[agent.id] = free_name(agent.id, names.values())
    return names


def _number(value: float) -> str:
    return f"{value:.{_DIGITS}f}"


# --- types and lights -------------------------------------------------------------------------


def _type_of(agent: Agent) -> str:
    return f"{agent.role}_{agent.kind}_{agent.length:.6g}x{agent.width:.6g}"


def _additional(scenario: Scenario) -> ET.Element:
    root = ET.Element("additional")
    for name, agent in {_type_of(agent): agent for agent in scenario.agents}.items():
        size = {"length": repr(agent.length), "width": repr(agent.width), "minGap": "0"}
        look = {"vClass": _CLASSES[agent.kind], "color": _COLOURS[agent.role]}
        ET.SubElement(root, "vType", {"id": name} | look | size)
    if scenario.road.sumo_net:
        root.extend(_program(signal, scenario) for signal in scenario.signals)
    return root


def _program(signal: Signal, scenario: Scenario) -> ET.Element:
    """A light programme that follows the case from time 0 on, and then keeps its last state."""
    program = ET.Element("tlLogic", id=signal.id, type="static", programID="case", offset="0")
    ends = [step for step, _ in signal.changes[1:]] + [10 * scenario.tracks.steps]
    for (begin, letters), end in zip(signal.changes, ends, strict=True):
        ET.SubElement(program, "phase", duration=_number((end - begin) * scenario.dt), state=letters)
    return program


# --- configuration ----------------------------------------------------------------------------


def _configuration(scenario: Scenario) -> ET.Element:
    sections = {
        "input": {"net-file": "case.net.xml.gz", "additional-files": "types.add.xml"},
        "time": {"begin": "0", "end": _number(scenario.tracks.steps * scenario.dt), "step-length": repr(scenario.dt)},
        "processing": {"time-to-teleport": "-1", "collision.action": "none", "insertion-checks": "none"},
        "report": {"no-warnings": "true", "no-step-log": "true"},  # vehicles that brake harder than their type allows
        "fcd_replay_device": {"device.fcd-replay.files": "fcd.xml.gz"},
        "gui_only": {"gui-settings-file": "view.xml"},
    }
    root = ET.Element("configuration")
    for section, options in sections.items():
        part = ET.SubElement(root, section)
        for name, value in options.items():
            ET.SubElement(part, name, value=value)
    return root


def _view(scenario: Scenario) -> ET.Element:
    """The view of sumo-gui: centred on the ego's path, in slow motion."""
    root = ET.Element("viewsettings")
    middle = scenario.tracks.steps // 2
    centre = {"x": _number(scenario.tracks.x[0, middle]), "y": _number(scenario.tracks.y[0, middle])}
    ET.SubElement(root, "viewport", {"zoom": "1000"} | centre)
    ET.SubElement(root, "delay", value=_number(_GUI_DELAY_MS))
    return root
