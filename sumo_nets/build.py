"""Rebuild the SUMO networks of this folder, byte for byte.

    python sumo_nets/build.py                  all of them
    python sumo_nets/build.py merge grid       some of them
    python sumo_nets/build.py --out DIR        somewhere else (the tests compare)

`NETWORKS` at the end holds one entry per network: the exact netconvert or netgenerate arguments, who drives there and
how many. The hand-written nodes, edges and connections lie in the network's own folder.
"""

import argparse
import re
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import sumo  # SUMO_HOME of this wheel; the environment variable may point at another installation

HERE = Path(__file__).parent
BIN = Path(sumo.SUMO_HOME) / "bin"
DURATION = 600  # [s]


@dataclass(frozen=True)
class Vehicle:
    """One kind of vehicle and how often it comes."""

    share: float
    length: float  # [m]
    width: float  # [m]
    speed_factor: str  # desired speed over the limit: normc(mean, deviation, least, most)
    accel: float = 2.6  # [m/s^2]
    decel: float = 4.5  # [m/s^2] what a driver brakes with at most, short of an emergency


@dataclass(frozen=True)
class Walker:
    """One kind of person on foot and how often it comes; sizes are SUMO's."""

    share: float
    speed: float  # [m/s]
    speed_factor: str = "normc(1,0.12,0.75,1.25)"


@dataclass(frozen=True)
class Train:
    """Vehicles of one kind that depart one after the other, always as far apart: what meets whom is planned."""

    kind: str
    ends: str  # "from to" (edges)
    first_s: float
    every_s: float


@dataclass(frozen=True)
class Network:
    """How one network is made and what drives and walks on it."""

    tool: str  # netconvert or netgenerate
    options: str
    vehicles: dict[str, Vehicle]  # by SUMO vehicle class
    flows: dict[str, float]  # "from to" (edges) -> vehicles per hour
    rides: dict[str, float] = field(default_factory=dict)  # "from to" (edges) -> bicycles per hour
    walks: dict[str, float] = field(default_factory=dict)  # "from to" (edges) -> persons per hour
    trains: tuple[Train, ...] = ()

    def command(self, name: str) -> list[str]:
        """Say what to run inside the network's folder; the output file is left to the caller."""
        words = f"{self.options} {ALWAYS}"
        if self.tool == "netconvert":
            words = f"-n {name}.nod.xml -e {name}.edg.xml {words}"
        return [self.tool, *words.split()]


def build(name: str, out: Path) -> None:
    """Write `<name>.net.xml`, `.rou.xml` and `.sumocfg` into `out/<name>/`."""
    network, folder = NETWORKS[name], out / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.net.xml").write_text(net_xml(network.command(name), HERE / name))
    (folder / f"{name}.rou.xml").write_text("\n".join(route_lines(network)) + "\n")
    (folder / f"{name}.sumocfg").write_text(CONFIGURATION.format(name=name, duration=DURATION))


def net_xml(command: list[str], folder: Path) -> str:
    """Run `command`; drop the header comment of what it makes, which tells the time and this machine's paths."""
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "made.net.xml"
        tool, *options = command
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run([BIN / tool, *options, "-o", made], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return re.sub(r"<!-- generated on .*?-->\s*", "", made.read_text(), count=1, flags=re.DOTALL)


def route_lines(network: Network) -> Iterator[str]:
    """Vehicle types and Poisson flows; SUMO finds the routes itself, on departure."""
    yield "<routes>"
    yield from vehicle_lines(network)
    if network.walks:
        yield from person_lines(network)
    yield "</routes>"


def vehicle_lines(network: Network) -> Iterator[str]:
    """Kinds of vehicles and Poisson flows of them, bicycles in flows of their own."""
    yield '    <vTypeDistribution id="traffic">'
    for kind, v in network.vehicles.items():
        yield f'        <vType id="{kind}" vClass="{kind}" probability="{v.share}"{driving(v)}/>'
    yield "    </vTypeDistribution>"
    yield from (flow_line("traffic", "", *one) for one in network.flows.items())
    if network.rides:
        yield f'    <vType id="bicycle" vClass="bicycle"{driving(BICYCLE)}/>'
        yield from (flow_line("bicycle", ".riding", *one) for one in network.rides.items())
    yield from map(train_line, sorted(network.trains, key=lambda train: train.first_s))  # as SUMO reads them


def driving(vehicle: Vehicle) -> str:
    """The attributes of a kind of vehicle."""
    # EIDM accelerates smoothly at 10 Hz; SUMO's default, Krauss, jitters and brakes hard at right-before-left
    return (
        f' length="{vehicle.length}" width="{vehicle.width}" accel="{vehicle.accel}" decel="{vehicle.decel}"'
        f' carFollowModel="EIDM" speedFactor="{vehicle.speed_factor}"'
    )


def flow_line(kind: str, suffix: str, ends: str, per_hour: float) -> str:
    """A Poisson flow."""
    start, end = ends.split()
    return (
        f'    <flow id="{start}.{end}{suffix}" type="{kind}" from="{start}" to="{end}" begin="0" end="{DURATION}"'
        f' period="exp({per_hour / 3600:.4f})" departLane="best" departSpeed="max"/>'
    )


def train_line(train: Train) -> str:
    """Departures in a fixed rhythm."""
    start, end = train.ends.split()
    return (
        f'    <flow id="{start}.{end}.{train.kind}" type="{train.kind}" from="{start}" to="{end}"'
        f' begin="{train.first_s}" end="{DURATION}" period="{train.every_s}" departLane="best" departSpeed="max"/>'
    )


def person_lines(network: Network) -> Iterator[str]:
    """Kinds of persons and Poisson flows of them, each from somewhere along an edge to somewhere along another."""
    yield '    <vTypeDistribution id="persons">'
    for kind, walker in WALKERS.items():
        yield (
            f'        <vType id="{kind}" vClass="pedestrian" probability="{walker.share}"'
            f' desiredMaxSpeed="{walker.speed}" speedFactor="{walker.speed_factor}"/>'
        )
    yield "    </vTypeDistribution>"
    for way, per_hour in network.walks.items():
        start, end = way.split()
        yield (
            f'    <personFlow id="{start}.{end}.on_foot" type="persons" begin="0" end="{DURATION}"'
            f' period="exp({per_hour / 3600:.4f})" departPos="random">'
            f'<walk from="{start}" to="{end}" arrivalPos="random"/></personFlow>'
        )


CONFIGURATION = """\
<configuration>
    <input>
        <net-file value="{name}.net.xml"/>
        <route-files value="{name}.rou.xml"/>
    </input>
    <time>
        <begin value="0"/>
        <end value="{duration}"/>
        <step-length value="0.1"/>
    </time>
    <processing>
        <time-to-teleport value="-1"/>
    </processing>
</configuration>
"""

# Finely sampled curves and wide corners: a bicycle has to follow these lanes with centimetre precision.
ALWAYS = (
    "--no-turnarounds --offset.disable-normalization --default.lanewidth 3.4"
    " --junctions.internal-link-detail 20 --junctions.corner-detail 5"
    " --junctions.limit-turn-speed 3"
)

URBAN = {
    "passenger": Vehicle(0.70, 4.7, 1.8, "normc(1,0.1,0.8,1.2)"),
    "delivery": Vehicle(0.13, 6.0, 2.0, "normc(0.95,0.1,0.8,1.1)", accel=2.2),
    "truck": Vehicle(0.06, 9.5, 2.5, "normc(0.9,0.05,0.8,1)", accel=1.3, decel=4.0),
    "bus": Vehicle(0.04, 12.0, 2.5, "normc(0.9,0.05,0.8,1)", accel=1.2, decel=4.0),
    "motorcycle": Vehicle(0.07, 2.2, 0.9, "normc(1.05,0.1,0.8,1.2)", accel=3.5),
}
TOWN = {kind: URBAN[kind] for kind in ("passenger", "delivery", "motorcycle")}
BICYCLE = Vehicle(1.0, 1.8, 0.65, "normc(1,0.1,0.8,1.2)", accel=1.2, decel=3.0)
WALKERS = {"adult": Walker(0.7, 1.4), "hurried": Walker(0.2, 2.0), "elderly": Walker(0.1, 0.9)}
SLOW_AND_QUICK = {
    "passenger": Vehicle(0.5, 4.8, 1.8, "normc(0.96,0.03,0.85,1.05)"),
    "truck": Vehicle(0.5, 7.5, 2.5, "normc(0.42,0.015,0.35,0.45)", accel=1.0, decel=4.0),
}
MOTORWAY = {
    "passenger": Vehicle(0.70, 4.8, 1.8, "normc(1,0.12,0.75,1.3)"),
    "delivery": Vehicle(0.12, 6.0, 2.0, "normc(0.92,0.08,0.75,1.1)", accel=2.2),
    "truck": Vehicle(0.10, 10.5, 2.5, "normc(0.75,0.05,0.65,0.85)", accel=1.3, decel=4.0),
    "bus": Vehicle(0.03, 12.0, 2.5, "normc(0.85,0.05,0.75,0.95)", accel=1.2, decel=4.0),
    "motorcycle": Vehicle(0.05, 2.2, 0.9, "normc(1.1,0.12,0.8,1.3)", accel=3.5),
}


def turns(arms: str, straight: float, left: float, right: float) -> dict[str, float]:
    """Flows from the given arms of a four-armed junction to the other three."""
    around = ["west", "south", "east", "north"]  # counter-clockwise: who comes in on one finds the next on his right
    return {
        f"{arm}_in {around[(around.index(arm) + k) % 4]}_out": per_hour
        for arm in arms.split()
        for k, per_hour in ((1, right), (2, straight), (3, left))
        if per_hour
    }


def uncovered(begin: str, off: str, onward: str, first_s: float) -> tuple[Train, ...]:
    """A slow one, one that comes up behind it as the exit lane begins, and takes it, and one that follows that one."""
    ways = (("truck", onward, 0.0), ("passenger", off, 15.5), ("passenger", onward, 17.0))
    return tuple(Train(kind, f"{begin} {end}", first_s + after_s, every_s=18.5) for kind, end, after_s in ways)


def along(street: str, side: str, straight: float, turning: float) -> dict[str, float]:
    """Flows along a street from each of its two ends to the other, and between them and side streets."""
    ends, sides = street.split(), side.split()
    flows = {f"{a}_in {b}_out": straight for a in ends for b in ends if a != b}
    flows |= {f"{a}_in {b}_out": turning for a in ends for b in sides}
    return flows | {f"{b}_in {a}_out": turning for a in ends for b in sides}


def across(straight: float, shifted: float) -> dict[str, float]:
    """Flows through the 3 x 3 grid: from each of its twelve gates to the one opposite and to the neighbours of that."""
    rim = ["C0right0", "C1right1", "C2right2", "C2top2", "B2top1", "A2top0"]
    rim += ["A2left2", "A1left1", "A0left0", "A0bottom0", "B0bottom1", "C0bottom2"]
    flows = {}
    for i, gate in enumerate(rim):
        opposite = (2 if "top" in gate or "bottom" in gate else 8) - i
        for k, per_hour in ((0, straight), (1, shifted), (-1, shifted)):
            flows[f"{gate[2:]}{gate[:2]} {rim[(opposite + k) % 12]}"] = per_hour
    return flows


NETWORKS = {
    "merge": Network(
        "netconvert",
        "-x merge.con.xml",
        MOTORWAY,
        {"main exit": 2700, "ramp exit": 600},
    ),
    "crossing": Network(
        "netconvert",
        "-x crossing.con.xml --default.junctions.radius 9",
        URBAN,
        turns("west east", straight=560, left=25, right=50) | turns("south north", straight=25, left=15, right=70),
    ),
    "signals": Network(
        "netconvert",
        "-x signals.con.xml --default.junctions.radius 9 --tls.cycle.time 60 --tls.allred.time 3",
        URBAN,
        turns("west east north south", straight=390, left=45, right=110),
    ),
    "roundabout": Network(
        "netconvert",
        "-x roundabout.con.xml --default.junctions.radius 6",
        URBAN,
        turns("west east north south", straight=170, left=110, right=120),
    ),
    "grid": Network(
        "netgenerate",
        "--grid --grid.number 3 --grid.length 120 --grid.attach-length 70 --default-junction-type right_before_left"
        " --default.speed 8.33 --default.junctions.radius 8",
        {kind: URBAN[kind] for kind in ("passenger", "delivery", "motorcycle")},
        across(straight=105, shifted=30),
    ),
    "multilane": Network(
        "netconvert",
        "-x multilane.con.xml",
        MOTORWAY,
        {"main exit": 2500, "main off": 550, "on exit": 500, "on off": 50},
    ),
    "lane_drop": Network(
        "netconvert",
        "-x lane_drop.con.xml",
        URBAN,
        {"main exit": 1200},
    ),
    "exit_lane": Network(
        "netconvert",
        "-x exit_lane.con.xml",
        SLOW_AND_QUICK,
        {},
        trains=uncovered("road", "off", "onward", first_s=0.0)
        + uncovered("back", "back_off", "back_onward", first_s=9.3),
    ),
    "town": Network(
        "netconvert",
        "-x town.con.xml --walkingareas --default.junctions.radius 6 --tls.cycle.time 70 --tls.allred.time 3",
        TOWN,
        turns("west east north south", straight=130, left=30, right=45),
        turns("west east north south", straight=50, left=0, right=15),
        {
            **dict.fromkeys(("west_in north_out", "west_out south_out", "south_out east_in", "north_in east_out"), 60),
            **dict.fromkeys(("south_in north_out", "north_out south_out"), 60),
            **dict.fromkeys(
                ("west_in west_leave", "west_out west_stop", "east_in east_leave", "east_out east_stop"), 50
            ),
            **dict.fromkeys(
                ("west_in west_stop", "west_leave west_out", "east_in east_stop", "east_leave east_out"), 90
            ),
            **dict.fromkeys(("west_in south_out", "south_in east_out", "east_in north_out", "north_in west_out"), 60),
        },
    ),
    "street": Network(
        "netconvert",
        "-x street.con.xml --walkingareas --default.junctions.radius 5",
        TOWN,
        along("west east", "south north", straight=230, turning=40),
        {"west_in east_out": 70, "east_in west_out": 70, "south_in east_out": 20, "north_in west_out": 20},
        {
            **dict.fromkeys(
                ("west_mid west_back", "west_back west_mid", "east_mid east_back", "east_back east_mid"), 60
            ),
            **dict.fromkeys(("west_in west_back", "west_out south_in", "south_out west_mid"), 40),
            **dict.fromkeys(("east_in east_mid", "east_out north_in", "north_out east_back"), 40),
            **dict.fromkeys(
                ("west_out east_back", "east_back west_out", "west_mid east_out", "east_out west_mid"), 110
            ),
            **dict.fromkeys(("west_in south_out", "south_in west_mid", "north_in east_back", "east_in north_out"), 60),
        },
    ),
}


def main() -> None:
    """Build what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="name", help=f"any of {', '.join(NETWORKS)} (default: all)")
    parser.add_argument("--out", type=Path, default=HERE, help="where to write (default: beside this script)")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(NETWORKS):
        parser.error(f"no such network: {', '.join(sorted(unknown))}; there are {', '.join(NETWORKS)}")
    for name in arguments.names or NETWORKS:
        build(name, arguments.out)


if __name__ == "__main__":
    main()
