"""A small town of SUMO's with sidewalks, crossings and lights, where persons walk, wait, ride and take a lift."""

import os
import subprocess
from pathlib import Path

import pytest

from regents_cosim.simulators.sumo.config import SumoInput

_OPTIONS = (
    "--grid", "--grid.number", "2", "--grid.length", "80", "--grid.attach-length", "60", "-L", "1", "-j",
    "traffic_light", "--sidewalks.guess", "--crossings.guess", "--no-turnarounds",
)  # fmt: skip
_STOPS = """<additional>
<busStop id="here" lane="A0B0_1" startPos="10" endPos="30"><access lane="A0A1_0" pos="30" length="40"/></busStop>
<busStop id="there" lane="B0right0_1" startPos="10" endPos="30"/></additional>"""
# The passenger is called like the car that it rides in. The lift at the stop saves persons 1, 5 and 9 a crossing.
_TRAFFIC = """<routes><vType id="car" vClass="passenger"/>
<vType id="chair" vClass="wheelchair" length="1.2" width="0.72"/>
{cars}
<person id="taxi" depart="0" departPos="5"><walk from="A0A1" busStop="here"/><ride busStop="there" lines="taxi"/>
<walk edges="B0right0" arrivalPos="55"/></person>
<person id="waits" depart="0" departPos="10"><stop lane="A0B0_0" duration="500"/></person>
{persons}
<vehicle id="taxi" type="car" depart="50" line="taxi" departPos="0"><route edges="left0A0 A0B0 B0right0"/>
<stop busStop="here" duration="10"/><stop busStop="there" duration="5"/></vehicle></routes>"""
_WAYS = (("left0A0", "B0right0"), ("bottom0A0", "A1top0"), ("right1B1", "A1left1"), ("top1B1", "B0bottom1"))


def make_town(folder: Path) -> SumoInput:
    """The network and 90 s of its traffic, in `folder`; the test is skipped without eclipse-sumo."""
    sumo = pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo (the dev extra)")
    net, routes, stops = (folder / f"town.{ending}" for ending in ("net.xml", "rou.xml", "add.xml"))
    program = os.path.join(sumo.SUMO_HOME, "bin", "netgenerate")
    subprocess.run([program, *_OPTIONS, "-o", net], check=True, capture_output=True)
    persons = [
        f'<person id="{n}" depart="{n}" departPos="{30 + n}" type="{"chair" if n == 4 else "DEFAULT_PEDTYPE"}">'
        f'<walk from="{_WAYS[n % 4][0]}" to="{_WAYS[n % 4][1]}"/></person>'
        for n in range(12)
    ]
    cars = [
        f'<flow id="flow{number}" type="car" begin="0" end="90" period="6" departSpeed="max" '
        f'from="{start}" to="{end}"/>'
        for number, (start, end) in enumerate(_WAYS)
    ]
    stops.write_text(_STOPS)
    routes.write_text(_TRAFFIC.format(persons="\n".join(persons), cars="\n".join(cars)))
    return SumoInput(net=net, routes=(routes,), additional=(stops,), end_s=90.0)
