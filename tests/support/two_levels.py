"""Two one-way roads of two lanes that cross without a junction, one of them on a bridge 8 m above the other."""

import subprocess
from pathlib import Path

BRIDGE_M = 8.0

_NODES = """<nodes>
 <node id="w" x="-300" y="0" z="0" type="priority"/><node id="e" x="300" y="0" z="0" type="priority"/>
 <node id="s" x="0" y="-300" z="0" type="priority"/><node id="n" x="0" y="300" z="0" type="priority"/>
</nodes>"""
_EDGE = '<edge id="{}" from="{}" to="{}" numLanes="2" speed="14" {}/>'
_CROSSING = (("east", "w", "e", ()), ("north", "s", "n", (-1, 1)))
_FLOWS = """<routes>
 <vType id="car" sigma="0.5"/>
 {}
</routes>"""
_FLOW = '<flow id="{0}" type="{1}" begin="0" end="120" period="{2}" departLane="random" departSpeed="max">\
<route edges="{0}"/></flow>'


def build(folder: Path) -> Path:
    """Write the network, its traffic and a configuration of 120 s; return the configuration."""
    import sumo

    edges = []
    for name, source, target, ways in _CROSSING:
        points = " ".join(f"0,{300 * way if far else 100 * way},{0 if far else BRIDGE_M}" for way, far in _bridge(ways))
        edges.append(_EDGE.format(name, source, target, f'shape="{points}"' if points else ""))
    (folder / "levels.nod.xml").write_text(_NODES)
    (folder / "levels.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    net = folder / "levels.net.xml"
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    files = ("-n", folder / "levels.nod.xml", "-e", folder / "levels.edg.xml", "-o", net)
    subprocess.run([program, *files, "--no-turnarounds"], check=True, capture_output=True)
    flows = [_FLOW.format(name, *kind) for name, kind in zip(("east", "north"), _TRAFFIC, strict=True)]
    (folder / "levels.rou.xml").write_text(_FLOWS.format("\n ".join(flows)))
    config = folder / "levels.sumocfg"
    config.write_text(
        '<configuration><input><net-file value="levels.net.xml"/><route-files value="levels.rou.xml"/></input>'
        '<time><begin value="0"/><end value="120"/></time></configuration>'
    )
    return config


_TRAFFIC = (("car", 1.2), ("car", 1.5))


def _bridge(ways: tuple[int, ...]) -> list[tuple[int, bool]]:
    """The deck is level over 200 m; from its ends the road slopes down to the border of the network."""
    return [(ways[0], True), (ways[0], False), (ways[1], False), (ways[1], True)] if ways else []
