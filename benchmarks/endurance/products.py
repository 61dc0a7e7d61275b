"""Small files that ask for much: a product of counts, or a number that stands for one, for every reader.

Each is some ten to some hundred kilobytes, and well-formed. Reading one, and cutting a window out of what it holds,
takes as much as its bytes do, or it is refused in one line.
"""

import gzip
import json
import pickle
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.support import log_files

_LATE_S = 1e10  # of a last row, 300 years after the others


def products_of(reader: str) -> tuple[bytes, ...]:
    """The files for a reader, by the name that it has in `readers`."""
    late = (_late(reader),) if reader in _TIMED else ()
    return (*late, *map(_made, _PRODUCTS.get(reader, ())))


def is_product(data: bytes) -> bool:
    """Whether a file is one that was made here."""
    return any(mark in data for mark in _marks)


_marks: set[bytes] = set()


def _made(make: Callable[[], bytes]) -> bytes:
    """A file, of which some bytes in the middle are remembered: what wraps it leaves them as they are."""
    data = make()
    _marks.add(data[len(data) // 2 :][:64])
    return data


_TIMED = tuple(name for name, one in log_files.FORMATS.items() if one.time)


def _late(format: str) -> bytes:
    """A table of that format whose last row is there once more, much later."""
    with tempfile.TemporaryDirectory() as folder:
        path = log_files.write(format, Path(folder))
        _marks.add(log_files.add_late_row(path, format, _LATE_S).encode())
        return path.read_bytes()


# --- SUMO -----------------------------------------------------------------------------------------


def _net(edges: str, connections: str = "") -> bytes:
    location = '<location netOffset="0,0" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>'
    ends = "".join(f'<junction id="{n}" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape=""/>' for n in "ab")
    ends += '<junction id="c" type="priority" x="0" y="0" incLanes="" intLanes="" shape="0,0 1,0 1,1"/>'
    return f'<net version="1.20">{location}{edges}{ends}{connections}</net>'.encode()


def _edge(name: str, shape: str, internal: bool = False) -> str:
    kind = 'function="internal"' if internal else 'from="a" to="b" priority="1"'
    lane = f'<lane id="{name}_0" index="0" speed="13.9" length="10" shape="{shape}"/>'
    return f'<edge id="{name}" {kind}>{lane}</edge>'


def _net_shared_way() -> bytes:
    """Every lane leads through the same chain of ways through a junction."""
    chain, many = 2000, 1500
    edges = "".join(_edge(f":c_{i}", f"{i},0 {i + 1},0", internal=True) for i in range(chain))
    edges += "".join(_edge(f"e{i}", f"0,{4 * i} 10,{4 * i}") for i in range(many + 1))
    links = "".join(
        f'<connection from=":c_{i}" to="e0" fromLane="0" toLane="0" via=":c_{i + 1}_0" dir="s" state="M"/>'
        for i in range(chain - 1)
    )
    links += f'<connection from=":c_{chain - 1}" to="e0" fromLane="0" toLane="0" dir="s" state="M"/>'
    links += "".join(
        f'<connection from="e{i + 1}" to="e0" fromLane="0" toLane="0" via=":c_0_0" dir="s" state="M"/>'
        for i in range(many)
    )
    return _net(edges, links)


def _net_long_hills() -> bytes:
    """Lanes of 50 km that have heights: a point a metre."""
    lanes = (_edge(f"e{i}", f"0,{10 * i},0 50000,{10 * i},10") for i in range(1500))
    return _net("".join(lanes))


def _net_crossing() -> bytes:
    """Lanes that all cross each other."""
    return _net("".join(_crossing_lines(lambda i, a, b: _edge(f"e{i}", f"{a[0]},{a[1]} {b[0]},{b[1]}"), 1600)))


def _crossing_lines(write: Callable[[int, tuple, tuple], str], count: int) -> list[str]:
    half = count // 2
    across = [write(i, (0, 8 * i), (8 * half, 8 * i)) for i in range(half)]
    return across + [write(half + i, (8 * i, 0), (8 * i, 8 * half)) for i in range(half)]


def _fcd_late() -> bytes:
    steps = [(0.1 * i, i) for i in range(12)] + [(_LATE_S, 12)]
    rows = (f'<timestep time="{t:.2f}"><vehicle id="a" x="{i}" y="-1.6" angle="90"/></timestep>' for t, i in steps)
    return f"<fcd-export>{''.join(rows)}</fcd-export>".encode()


def _fcd_fine(mark: str = "xml") -> bytes:
    """A millisecond between two instants, and thousands who are there at one of them."""
    ids, steps = 8000, 500
    if mark == "csv":
        head = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle"
        rows = (f"{2 * (i * steps // ids) / 1000:.3f};{i};9;-1;90" for i in range(ids))
        return "\n".join([head, *rows]).encode()
    rows = "".join(
        f'<timestep time="{s / 1000:.3f}">'
        + "".join(f'<vehicle id="{s}_{i}" x="9" y="-1" angle="90"/>' for i in range(ids // 50))
        + "</timestep>"
        for s in range(0, steps + 1, 10)
    )
    return f'<fcd-export>{rows}<timestep time="{steps / 1000 + 0.001:.3f}"/></fcd-export>'.encode()


# --- logs -----------------------------------------------------------------------------------------


def _commonroad(more: str, last: int | float = 50) -> bytes:
    text = log_files.commonroad()
    moving = (
        '<dynamicObstacle id="9999"><type>car</type><shape><rectangle><length>4</length><width>2</width></rectangle>'
        f"</shape>{_cr_state('initialState', 0)}<trajectory>{_cr_state('state', last)}</trajectory></dynamicObstacle>"
    )
    return text.replace("<planningProblem", more + moving + "<planningProblem", 1).encode()


def _cr_state(tag: str, step: int | float) -> str:
    return (
        f"<{tag}><time><exact>{step:.0f}</exact></time><position><point><x>1</x><y>2</y></point></position>"
        f"<orientation><exact>0</exact></orientation></{tag}>"
    )


def _commonroad_parked(last: float = 99_999) -> bytes:
    """Parked cars, and one who is there much later."""
    shape = "<shape><circle><radius>1</radius></circle></shape>"
    parked = "".join(
        f'<staticObstacle id="{1000 + i}"><type>car</type>{shape}{_cr_state("initialState", 0)}</staticObstacle>'
        for i in range(600)
    )
    return _commonroad(parked, last)


def _commonroad_lights(last: float = 99_999) -> bytes:
    cycle = "<cycle><cycleElement><duration>1</duration><color>red</color></cycleElement></cycle>"
    lights = "".join(f'<trafficLight id="{i}">{cycle}</trafficLight>' for i in range(5000, 8000))
    refs = "".join(f'<trafficLightRef ref="{i}"/>' for i in range(5000, 8000))
    return _commonroad(lights, last).replace(b"</lanelet>", refs.encode() + b"</lanelet>", 1)


def _commonroad_arms() -> bytes:
    """Thousands of arms of an intersection, a light for each, and thousands of signs on one of them."""
    many = range(5000, 9000)
    sign = "<trafficSignElement><trafficSignID>205</trafficSignID></trafficSignElement>"
    cycle = "<cycle><cycleElement><duration>1</duration><color>red</color></cycleElement></cycle>"
    made = "".join(
        f'<trafficSign id="1{i}">{sign}</trafficSign><trafficLight id="{i}">{cycle}</trafficLight>' for i in many
    )
    arms = "".join(f'<incoming><incomingLanelet ref="{i}"/></incoming>' for i in (1, *many))
    refs = "".join(f'<trafficSignRef ref="1{i}"/><trafficLightRef ref="{i}"/>' for i in many)
    more = f"{made}<intersection>{arms}</intersection>"
    return _commonroad(more).replace(b"</lanelet>", refs.encode() + b"</lanelet>", 1)


def _commonroad_crossing() -> bytes:
    def lanelet(i: int, a: tuple, b: tuple) -> str:
        sides = zip(("leftBound", "rightBound"), (2, -2), strict=True)
        bounds = "".join(
            f"<{side}>" + "".join(f"<point><x>{p[0] + d}</x><y>{p[1] + d}</y></point>" for p in (a, b)) + f"</{side}>"
            for side, d in sides
        )
        return f'<lanelet id="{10_000 + i}">{bounds}</lanelet>'

    return _commonroad("").replace(b"<lanelet", "".join(_crossing_lines(lanelet, 1200)).encode() + b"<lanelet", 1)


def _gpudrive_points() -> bytes:
    """Gzip makes a thousand points of a hundred bytes."""
    content = log_files.gpudrive(3)
    content["roads"] += [{"type": "lane", "geometry": []}]
    points = '{"x":0,"y":0},' * 1_150_000 + '{"x":1,"y":0}'
    text = json.dumps(content).replace('"geometry": []', f'"geometry": [{points}]')
    return gzip.compress(text.encode(), 9, mtime=0)


def _gpudrive_lights() -> bytes:
    steps, lights = 6000, 4000
    one = {"position": [{"x": 0, "y": 0}] * steps, "heading": [0] * steps, "valid": [1] * steps, "length": 4,
           "width": 2, "type": "vehicle"}  # fmt: skip
    content = {"objects": [one], "roads": [], "tl_states": {str(i): {} for i in range(lights)}}
    return json.dumps(content, separators=(",", ":")).encode()


def _gpudrive_rings() -> bytes:
    """Every lane begins where every lane ends."""
    ring = {"type": "lane", "geometry": [{"x": x, "y": y} for x, y in ((0, 0), (9, 0), (9, 9), (0, 0))]}
    content = log_files.gpudrive(3)
    content["roads"] += [ring] * 4000
    return json.dumps(content, separators=(",", ":")).encode()


def _waymo_lights() -> bytes:
    """Thousands of instants, and thousands of lights that are seen at one of them."""
    steps, lights = 6000, 6000
    times = b"".join(log_files.double(1, 0.1 * i) for i in range(steps))
    seen = b"".join(log_files.nested(1, log_files.whole(1, i)) for i in range(lights))
    return times + log_files.nested(7, seen)


def _example(change: Callable[[dict[str, tuple]], dict[str, tuple]]) -> bytes:
    """A tf.Example of one car that stands, with other features."""
    full = {key: np.full((128, 3), 1.0) for key in ("x", "y", "z", "bbox_yaw", "length", "width")}
    full["valid"] = np.zeros((128, 3))
    full["valid"][0] = 1
    features = {f"state/{part}/{key}": values[:, i] for i, part in enumerate(("past", "current", "future"))
                for key, values in full.items()}  # fmt: skip
    features |= {"state/id": np.arange(128), "state/type": np.ones(128), "state/is_sdc": np.zeros(128)}
    empty = {f"roadgraph_samples/{key}": np.zeros(0) for key in ("xyz", "type", "id", "valid")}
    content = b""
    for name, values in change(features | empty).items():
        packed = np.asarray(values, "<f4").tobytes()
        value = log_files.nested(2, log_files.nested(1, packed))
        content += log_files.nested(1, log_files.nested(1, name) + log_files.nested(2, value))
    return log_files.nested(1, content)


def _example_lights() -> bytes:
    steps = 2500
    count = 16 * steps
    keys = {"id": np.arange(count), "state": np.zeros(count), "valid": np.ones(count), "x": np.ones(count),
            "y": np.ones(count)}  # fmt: skip
    return _example(lambda features: features | {f"traffic_light_state/past/{k}": v for k, v in keys.items()})


def _example_points() -> bytes:
    """A file with as many lines as points."""
    count = 60_000
    more = {"xyz": np.ones(3 * count), "type": np.full(count, 2), "id": np.arange(count), "valid": np.ones(count)}
    return _example(lambda features: features | {f"roadgraph_samples/{k}": v for k, v in more.items()})


def doubled(levels: int, width: int = 10) -> list:
    """A list of the same list over and over: ten to the power of `levels` values in a few bytes."""
    value: list = [1.0]
    for _ in range(levels):
        value = [value] * width
    return value


def _scenarionet(change: Callable[[dict], object]) -> bytes:
    content = log_files.scenarionet()
    change(content)
    return pickle.dumps(content, protocol=4)


def _set(*path: str) -> Callable[[], bytes]:
    """A shared list in place of what lies at `path` in a ScenarioNet file."""

    def change(content: dict) -> None:
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = doubled(8)

    return lambda: _scenarionet(change)


def _scenarionet_exits() -> bytes:
    """Every lane has the same thousands of exits."""
    exits, line = ["1"] * 20_000, [[0.0, 0.0], [9.0, 0.0]]

    def change(content: dict) -> None:
        lane = {"type": "LANE_SURFACE_STREET", "polyline": line, "exit_lanes": exits}
        content["map_features"] |= {f"l{i}": lane for i in range(8000)}

    return _scenarionet(change)


def _scenarionet_rows() -> bytes:
    """A line of a list of numbers over and over."""
    row = [0.0] * 30_000

    def change(content: dict) -> None:
        content["map_features"]["e101"]["polyline"] = [row] * 30_000

    return _scenarionet(change)


def _scenarionet_states() -> bytes:
    """Lights that share what they show."""

    def change(content: dict) -> None:
        light = next(iter(content["dynamic_map_states"].values()))
        state = light["state"]
        content["dynamic_map_states"] = {str(i): {"lane": str(i), "state": state} for i in range(30_000)}

    return _scenarionet(change)


def _scenarionet_tracks() -> bytes:
    """Tracks that share their arrays."""

    def change(content: dict) -> None:
        content["tracks"] |= {f"t{i}": content["tracks"]["12"] for i in range(30_000)}

    return _scenarionet(change)


def _twice(levels: int) -> bytes:
    """Instructions for a tuple of the same tuple twice, so many levels deep."""
    return b"K\x01" + b"".join(b"q%ch%c\x86" % (level, level) for level in range(levels))


def _unpickle_name() -> bytes:
    """A class and its module are such tuples: hashing one takes 2^40 steps."""
    return b"\x80\x04" + _twice(40) + b"qah" + b"a\x93."


def _unpickle_type() -> bytes:
    return b"\x80\x04cnumpy\ndtype\n" + _twice(28) + b"\x85R."


def _unpickle_text() -> bytes:
    """One long text, turned into bytes over and over."""
    text = struct.pack("<I", 1 << 20) + b"a" * (1 << 20)
    begin = b"\x80\x02(c_codecs\nencode\nq\x00X" + text + b"q\x01X\x06\x00\x00\x00latin1q\x02"
    return begin + b"h\x00h\x01h\x02\x86R" * 30_000 + b"l."


def _unpickle_keys() -> bytes:
    """Whole numbers that all have one hash."""
    many = b"".join(
        b"\x8a" + bytes([len(one)]) + one + b"K\x01"
        for one in (((2**61 - 1) * (i + 1)).to_bytes(11, "little", signed=True) for i in range(30_000))
    )
    return b"\x80\x04}(" + many + b"u."


def _interaction_cases() -> bytes:
    """Every row is a case of its own."""
    head = "case_id,track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    rows = (f"{i},1,1,{100 * (i % 2 + 1)},car,0,0,0,0,0,4,2" for i in range(12_000))
    return "\n".join([head, *rows]).encode()


def _osm(ways: list[list[int]], lanelets: list[tuple[int, int]], nodes: np.ndarray) -> bytes:
    text = [f"<node id='{i}' x='{x:g}' y='{y:g}'/>" for i, (x, y) in enumerate(nodes.tolist())]
    text += [f"<way id='w{i}'>{''.join(f'<nd ref={chr(39)}{n}{chr(39)}/>' for n in way)}</way>"
             for i, way in enumerate(ways)]  # fmt: skip
    tags = "<tag k='type' v='lanelet'/>"
    text += [
        f"<relation id='{i}'><member role='left' ref='w{a}'/><member role='right' ref='w{b}'/>{tags}</relation>"
        for i, (a, b) in enumerate(lanelets)
    ]
    return f"<osm>{''.join(text)}</osm>".encode()


def _osm_shared_ways() -> bytes:
    """Thousands of lanelets between the same two long lines."""
    x = np.arange(4000.0)
    nodes = np.concatenate([np.column_stack([x, 0 * x]), np.column_stack([x, 0 * x + 4])])
    lines = [list(range(4000, 8000)), list(range(4000))]
    return _osm(lines, [(0, 1)] * 3000, nodes)


def _osm_one_place() -> bytes:
    """Thousands of lanelets that end where thousands begin: each leads into each."""
    nodes = np.array([(0, 0), (0, 4), (9, 0), (9, 4), (18, 0), (18, 4)], float)
    lines = [[1, 3], [0, 2], [3, 5], [2, 4]]
    return _osm(lines, [(0, 1)] * 2500 + [(2, 3)] * 2500, nodes)


def _osm_crossing() -> bytes:
    """Lanelets that all cross each other."""
    count = 1200
    pairs = _crossing_lines(lambda i, a, b: (a, b), count)  # type: ignore[arg-type, return-value]
    nodes, ways, lanelets = [], [], []
    for a, b in pairs:
        for shift in (2.0, -2.0):
            ways.append([len(nodes), len(nodes) + 1])
            nodes += [(p[0] + shift, p[1] + shift) for p in (a, b)]
        lanelets.append((len(ways) - 2, len(ways) - 1))
    return _osm(ways, lanelets, np.array(nodes))


def _table_crowd() -> bytes:
    """Thousands who are there one after the other, each for as long as a window."""
    head = "name,stamp,east,north,course,long,wide,what"
    rows = (f"{who},{1000 * who + 100 * i},{who},-6,90,14,6,1" for who in range(1500) for i in range(9))
    return "\n".join([head, *rows]).encode()


def _table_one_place() -> bytes:
    """Thousands at one place and one time."""
    head = "name,stamp,east,north,course,long,wide,what"
    rows = (f"{who},{100 * i},0,-6,90,14,6,1" for who in range(4000) for i in range(2))
    return "\n".join([head, *rows]).encode()


def _table_twice() -> bytes:
    """Thousands who are at two places at once, as seldom as a table may have it."""
    head = "name,stamp,east,north,course,long,wide,what"
    rows = (f"{who},{100 * max(i - 1, 0)},{50 * (i > 0)},-6,90,14,6,1" for who in range(5000) for i in range(12))
    return "\n".join([head, *rows]).encode()


def _table_crossing() -> bytes:
    """Thousands of ways that all cross: where they drove is the road."""
    head = "name,stamp,east,north,course,long,wide,what"
    half = 1500
    rows = []
    for i in range(half):
        for k in range(9):
            rows += [
                f"{i},{100 * k},{3 * half * k},{24 * i},90,14,6,1",
                f"{i + half},{100 * k},{24 * i},{3 * half * k},0,14,6,1",
            ]
    return "\n".join([head, *rows]).encode()


def _argoverse(segments: dict[str, dict], areas: dict[str, dict] | None = None) -> bytes:
    area = {"area_boundary": [{"x": x, "y": y} for x, y in ((0, 0), (9, 0), (9, 9), (0, 9))]}
    return json.dumps({"lane_segments": segments, "drivable_areas": areas or {"1": area}}).encode()


def _argoverse_neighbour() -> bytes:
    """Thousands of lanes beside one of thousands of points."""
    long = [{"x": x, "y": 0} for x in range(6000)]
    short = [{"x": 0, "y": 0}, {"x": 9, "y": 0}]

    def segment(name: int, left: list) -> dict:
        return {"id": name, "lane_type": "VEHICLE", "left_lane_boundary": left, "right_lane_boundary": short,
                "left_neighbor_id": 0}  # fmt: skip

    return _argoverse({"0": segment(0, long)} | {str(i): segment(i, short) for i in range(1, 2000)})


def _argoverse_crossing() -> bytes:
    areas = _crossing_lines(
        lambda i, a, b: {
            "area_boundary": [{"x": p[0] + d, "y": p[1] + d} for p, d in ((a, 0), (b, 0), (b, 2), (a, 2))]
        },
        1200,
    )
    lane = {"id": 1, "lane_type": "VEHICLE", "left_lane_boundary": [{"x": 0, "y": 0}, {"x": 9, "y": 0}],
            "right_lane_boundary": [{"x": 0, "y": 4}, {"x": 9, "y": 4}]}  # fmt: skip
    return _argoverse({"1": lane}, {str(i): area for i, area in enumerate(areas)})


def _parquet_rows() -> bytes:
    """Millions of equal rows, which take next to no bytes."""
    import io

    import polars as pl

    count = 5_000_000
    numbers = {name: pl.repeat(1.0, count, eager=True) for name in ("timestep", "position_x", "position_y", "heading")}
    texts = {name: pl.repeat("vehicle", count, eager=True) for name in ("track_id", "object_type")}
    buffer = io.BytesIO()
    pl.DataFrame(numbers | texts).write_parquet(buffer, compression="zstd", compression_level=22)
    return buffer.getvalue()


# --- cases on disk --------------------------------------------------------------------------------


def _npz_small_numbers() -> bytes:
    """Bytes that become numbers eight times as large."""
    import io

    buffer = io.BytesIO()
    zeros = np.zeros((2, 25_000_000), np.int8)
    np.savez_compressed(buffer, **dict.fromkeys(("x", "y", "yaw", "speed", "valid"), zeros))
    return buffer.getvalue()


_PRODUCTS: dict[str, tuple[Callable[[], bytes], ...]] = {
    "sumo_net": (_net_shared_way, _net_long_hills, _net_crossing),
    "fcd_xml": (_fcd_late, _fcd_fine),
    "fcd_csv": (lambda: _fcd_fine("csv"),),
    "commonroad": (
        _commonroad_parked, lambda: _commonroad_parked(_LATE_S), _commonroad_lights,
        lambda: _commonroad_lights(_LATE_S),
        _commonroad_crossing, _commonroad_arms,
    ),
    "gpudrive": (_gpudrive_points, _gpudrive_lights, _gpudrive_rings),
    "waymo_payload": (_waymo_lights,),
    "waymo_example_payload": (_example_lights, _example_points),
    "scenarionet": (
        _set("id"), _set("metadata", "scenario_id"), _set("metadata", "sdc_id"), _set("metadata", "ts"),
        _set("tracks", "12", "type"), _set("tracks", "12", "state", "position"),
        _set("tracks", "12", "state", "length"),
        _set("map_features", "1", "type"), _set("map_features", "1", "polyline"), _set("map_features", "1", "polygon"),
        _set("map_features", "1", "exit_lanes"), _set("map_features", "1", "speed_limit_kmh"),
        _set("map_features", "1", "left_neighbor"), _set("dynamic_map_states", "1", "lane"),
        _set("dynamic_map_states", "1", "state", "object_state"), _scenarionet_exits, _scenarionet_rows,
        _scenarionet_states, _scenarionet_tracks,
    ),
    "unpickle": (_unpickle_name, _unpickle_type, _unpickle_text, _unpickle_keys),
    "interaction": (_interaction_cases,),
    "interaction_map": (_osm_shared_ways, _osm_one_place, _osm_crossing),
    "table": (_table_crowd, _table_one_place, _table_twice, _table_crossing),
    "argoverse2_map": (_argoverse_neighbour, _argoverse_crossing),
    "argoverse2_motion": (_parquet_rows,),
    "tracks_npz": (_npz_small_numbers,),
}  # fmt: skip

READERS = tuple(dict.fromkeys((*_PRODUCTS, *_TIMED)))  # that there are such files for
