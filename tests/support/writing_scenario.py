"""A scenario that lets SUMO write in every way that we know of, and what lies in a folder."""

import hashlib
import shutil
from pathlib import Path

from regents_cosim.cases.shipped import network_config
from regents_cosim.simulators.sumo.process import running_sumo

GREEN = 'minDur="5" maxDur="20"'
STATES = ("GGGgrrrrGGGgrrrr", "yyyyrrrryyyyrrrr", "rrrrGGGgrrrrGGGg", "rrrryyyyrrrryyyy")
LOOPS = {
    "e1Detector": "e1", "inductionLoop": "loop", "e2Detector": "e2", "laneAreaDetector": "area",
    "instantInductionLoop": "instant",
}  # fmt: skip


def listing(*folders: Path) -> dict[str, str]:
    """Every file below, and what it holds."""
    files = (path for folder in folders for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def make_scenario(folder: Path, options: str = "") -> Path:
    """The network `signals` with outputs at all levels: its configuration."""
    there = network_config("signals").parent
    (folder / "sub" / "deep").mkdir(parents=True)
    shutil.copy(there / "signals.net.xml", folder)
    routes = (there / "signals.rou.xml").read_text()
    device = '<param key="has.ssm.device" value="true"/>'
    (folder / "signals.rou.xml").write_text(routes.replace("<routes>", '<routes><include href="sub/more.rou.xml"/>'))
    (folder / "sub" / "more.rou.xml").write_text(
        f'<routes><vType id="own">{device}</vType><route id="way" edges="west_in west_stop east_out"/>'
        '<vType id="told"/><flow id="f" type="own" route="way" begin="0" end="50" period="9">'
        '<param key="device.ssm.file" value="flow.xml"/></flow>'
        '<flow id="g" type="own" route="way" begin="4" end="50" period="9"/>'
        '<vehicle id="taken" type="told" route="way" depart="1"><param key="has.toc.device" value="true"/>'
        '<param key="device.toc.manualType" value="told"/><param key="device.toc.automatedType" value="told"/>'
        '<param key="device.toc.file" value="toc.xml"/></vehicle></routes>'
    )
    (folder / "more.add.xml").write_text(
        '<additional><include href="sub/detectors.add.xml"/>'
        '<variableSpeedSign id="v" lanes="west_in_0" file="sub/speeds.xml"/>'
        '<calibrator id="c" edge="east_in" pos="1" freq="10" output="calibrator.xml" file="sub/flows.xml"/>'
        '<timedEvent type="SaveTLSStates" source="centre" dest="tls.xml"/>'
        '<timedEvent type="SaveTLSSwitchTimes" source="centre" dest="switches.xml"/></additional>'
    )
    (folder / "sub" / "speeds.xml").write_text('<vss><step time="0" speed="12"/></vss>')
    (folder / "sub" / "flows.xml").write_text(
        f'<calibrators><vType id="cal">{device}<param key="device.ssm.file" value="calibrated.xml"/></vType>'
        '<route id="calibrated" edges="east_in east_stop west_out"/>'
        '<flow begin="0" end="50" route="calibrated" type="cal" vehsPerHour="900" speed="12"/></calibrators>'
    )
    loops = "".join(
        f'<{tag} id="{name}" lane="west_in_0" pos="{5 + 10 * at}" endPos="{9 + 10 * at}" freq="10" file="{name}.xml"/>'
        for at, (tag, name) in enumerate(LOOPS.items())
    )
    ends = '<detEntry lane="west_in_0" pos="1"/><detExit lane="west_in_0" pos="60"/>'
    (folder / "sub" / "detectors.add.xml").write_text(
        f'<additional>{loops}<include href="deep/means.add.xml"/>'
        f'<e3Detector id="e3" freq="10" file="e3.xml">{ends}</e3Detector>'
        f'<entryExitDetector id="ee" freq="10" file="../ee.xml">{ends}</entryExitDetector></additional>'
    )
    phases = "".join(
        f'<phase duration="{9 if "G" in one else 3}" {GREEN * ("G" in one)} state="{one}"/>' for one in STATES
    )
    (folder / "sub" / "deep" / "means.add.xml").write_text(
        '<additional><edgeData id="ed" file="edges.xml" freq="10"/><laneData id="ld" file="lanes.xml" freq="10"/>'
        '<routeProbe id="rp" edge="west_in" freq="10" file="probe.xml"/><vTypeProbe id="vp" freq="1" file="types.xml"/>'
        '<tlLogic id="centre" type="actuated" programID="ours" offset="0"><param key="file" value="light.xml"/>'
        f'<param key="freq" value="10"/>{phases}</tlLogic></additional>'
    )
    config = folder / "x.sumocfg"
    config.write_text(
        '<configuration><report><net-file value="signals.net.xml"/><begin>0</begin></report>'
        '<r value="signals.rou.xml"/><output><a v="more.add.xml"/><end value="40"/></output>'
        "<processing><tripinfo>trips%2exml</tripinfo><summary v=' sub/summary.xml'/></processing>"
        '<input><fcd-output value="${NAMED}.xml"/><message-log value="log.txt"/><save-state.period value="10"/>'
        f'<device.rerouting.output value="rerouting.xml"/></input>{options}</configuration>'
    )
    return config


# By SUMO itself, in the folder; more beside these in the working directory.
WRITTEN = [
    *(f"{name}.xml" for name in ("tls", "switches", "ee", "trips", "seen")),
    *(f"sub/{name}.xml" for name in (*LOOPS.values(), "e3", "summary", "flow", "calibrated")),
    *(f"sub/deep/{name}.xml" for name in ("edges", "lanes", "probe", "types", "light")),
    "log.txt",
    "state_10.00.xml.gz",
]


def states_of_run(command: list[str], steps: int) -> list[tuple]:
    """The vehicles on the road after each step, and the lights. Call this in a worker process."""
    with running_sumo(command) as sumo:
        return [_state(sumo) for _ in range(steps)]


def _state(sumo) -> tuple:
    sumo.simulationStep()
    vehicle, person, light = sumo.vehicle, sumo.person, sumo.trafficlight
    return (
        tuple((name, vehicle.getPosition3D(name), vehicle.getAngle(name), vehicle.getSpeed(name))
              for name in sorted(vehicle.getIDList())),
        tuple((name, person.getPosition3D(name), person.getAngle(name)) for name in sorted(person.getIDList())),
        tuple((name, light.getRedYellowGreenState(name)) for name in light.getIDList()),
    )  # fmt: skip
