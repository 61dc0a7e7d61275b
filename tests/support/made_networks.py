"""Networks and traffic that netgenerate and SUMO's own tools make, over a grid of what SUMO can be told."""

import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

GRID = ("--grid", "--grid.number", "3", "--grid.length", "120", "--no-turnarounds")


@dataclass(frozen=True)
class MadeNetwork:
    """The options for netgenerate, randomTrips and SUMO."""

    net: tuple[str, ...] = GRID
    trips: tuple[str, ...] = ("-p", "0.8")
    sumo: tuple[str, ...] = ()  # options of SUMO's, recorded with as well
    types: str = ""  # elements before the trips
    attributes: str = ""  # of every trip
    also: tuple[tuple[str, ...], ...] = field(default=())  # more traffic, as further calls of randomTrips


TRAMS = (
    '<vTypeDistribution id="t"><vType id="car" probability="0.7"/>'
    '<vType id="tram" vClass="tram" probability="0.3"/></vTypeDistribution>'
)
BIKES = (
    '<vTypeDistribution id="t"><vType id="car" probability="0.5"/>'
    '<vType id="bike" vClass="bicycle" probability="0.5"/></vTypeDistribution>'
)
SLOW = (
    '<vTypeDistribution id="t"><vType id="car" probability="0.7"/>'
    '<vType id="slow" maxSpeed="4" probability="0.3"/></vTypeDistribution>'
)
TRUCKS = '<vType id="t" vClass="trailer"/>'

TWO, THREE = (*GRID, "-L", "2"), (*GRID, "-L", "3")
LIGHTS = ("--default-junction-type", "traffic_light")
SHORT = ("--grid", "--grid.number", "5", "--grid.length", "22", "-L", "2", "--no-turnarounds")
SPIDER = (
    "--spider",
    "--spider.arm-number",
    "5",
    "--spider.circle-number",
    "2",
    "--spider.space-radius",
    "80",
    "-L",
    "2",
)
ON_FOOT = ("--sidewalks.guess", "--crossings.guess", "--default.sidewalk-width", "2")
UNEVEN = ("--rand.random-lanenumber", "--perturb-x", "8", "--perturb-y", "8")
MADE = {
    "two lanes, actuated": MadeNetwork((*TWO, *LIGHTS, "--tls.default-type", "actuated")),
    "three lanes, lights": MadeNetwork((*THREE, *LIGHTS)),
    "right before left": MadeNetwork((*GRID, "-j", "right_before_left")),
    "all-way stop": MadeNetwork((*GRID, "-j", "allway_stop")),
    "left-hand": MadeNetwork((*TWO, *LIGHTS, "--lefthand")),
    "no internal links": MadeNetwork((*TWO, "--no-internal-links")),
    "sublane": MadeNetwork(TWO, sumo=("--lateral-resolution", "0.8")),
    "lane changes at once": MadeNetwork(THREE, sumo=("--lanechange.duration", "0")),
    "ballistic": MadeNetwork(TWO, sumo=("--step-method.ballistic",)),
    "teleports": MadeNetwork(TWO, ("-p", "0.3"), ("--time-to-teleport", "8")),
    "very short edges": MadeNetwork(SHORT),
    "spider": MadeNetwork(SPIDER),
    "random": MadeNetwork(("--rand", "--rand.iterations", "40", "-L", "2")),
    "random, bidirectional": MadeNetwork(("--rand", "--rand.iterations", "30", "--bidi-probability", "0.3")),
    "turn lanes": MadeNetwork((*TWO, *LIGHTS, "--turn-lanes", "1")),
    "opposite driving": MadeNetwork((*GRID, "--opposites.guess"), types=SLOW, attributes='type="t"'),
    "random lane numbers": MadeNetwork((*THREE, *UNEVEN)),
    "elevation": MadeNetwork((*TWO, "--perturb-z", "6")),
    "bicycles": MadeNetwork((*GRID, "--bikelanes.guess"), types=BIKES, attributes='type="t"'),
    "lorries with trailers": MadeNetwork(TWO, types=TRUCKS, attributes='type="t"'),
    "cars and trams": MadeNetwork(types=TRAMS, attributes='type="t"'),
    "persons": MadeNetwork((*GRID, *ON_FOOT), also=(("-p", "0.5", "--pedestrians", "--prefix", "w"),)),
    "stops beside the road": MadeNetwork(TWO, ("-p", "0.8", "--intermediate", "1")),
}


def make_network(made: MadeNetwork, folder: Path) -> Path:
    """The configuration of a network and its traffic, made in `folder`."""
    import sumo

    home = Path(sumo.SUMO_HOME)
    net = folder / "net.net.xml"
    _call([str(home / "bin" / "netgenerate"), *made.net, "-o", str(net), "--seed", "7"], folder)
    routes = []
    for index, trips in enumerate((made.trips, *made.also)):
        route = folder / f"trips{index}.rou.xml"
        words = [sys.executable, str(home / "tools" / "randomTrips.py"), "-n", str(net), "-o", str(route)]
        if index == 0 and made.attributes:
            words += ["--trip-attributes", made.attributes]
        _call([*words, *trips, "-b", "0", "-e", "60", "--seed", "4", "--fringe-factor", "3"], folder)
        if index == 0 and made.types:
            route.write_text(route.read_text().replace("<trip ", f"{made.types}<trip ", 1))
        routes.append(route.name)
    config = folder / "made.sumocfg"
    config.write_text(
        f'<configuration><net-file value="net.net.xml"/><route-files value="{",".join(routes)}"/>'
        '<begin value="0"/><end value="70"/><ignore-route-errors value="true"/></configuration>'
    )
    return config


def _call(words: list[str], folder: Path) -> None:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}\n{done.stderr}"
