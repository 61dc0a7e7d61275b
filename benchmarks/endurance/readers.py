"""Every reader of the package, with small files that it accepts: what `fuzz` mutates.

A reader keeps its promise where it returns a value or raises RegentsError with one line of at most 500 characters,
within 2 s and 500 MB, whatever the file holds.
"""

import dataclasses
import gzip
import io
import json
import pickle
import sys
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "tests/support"))  # as a program, pytest's path is missing
import log_files
import scenes

from benchmarks.endurance.products import is_product, products_of
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import Suite, SuiteEntry, load_manifest, save_suite
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, load_baseline, save_baseline
from regents_cosim.evaluation.regression.thresholds import parse_thresholds
from regents_cosim.maps.levels import has_levels
from regents_cosim.planners.aim_bev.weights_file import load_weights
from regents_cosim.saving import save_unlisted
from regents_cosim.simulators.sumo.config import SumoInput, read_input, write_config
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.types import read_types
from regents_cosim.sources import fcd
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.files.protobuf import columns, grouped
from regents_cosim.sources.logs.files.unpickle import unpickle
from regents_cosim.sources.logs.formats import CompanionFiles, formats, read_log
from regents_cosim.sources.logs.readers.waymo import records
from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.logs.roads.lanelet2 import UtmOrigin, read_lanelet2
from regents_cosim.sources.logs.roads.road import drivable_area
from regents_cosim.sources.windows import RecordingOrigin, Windows

_PROCESS = 150  # cost of a reader that starts a process
_WITH_POLARS = {"argoverse2_motion": "scenario_abc.parquet", "argoverse2_sensor": "annotations.feather"}
_SECONDS = 1.2  # of every log: a reader is asked thousands of times


@dataclass(frozen=True)
class Reader:
    """A function of the package that reads files from outside."""

    name: str
    file: str  # name of the file that is mutated
    seeds: tuple[bytes, ...]  # that it accepts
    read: Callable[[Path], object]
    beside: Mapping[str, bytes] = field(default_factory=dict)  # files that it needs as well
    wrap: Callable[[bytes], bytes] = bytes  # what makes a file of mutated content: checks, compression
    hostile: Callable[[], tuple[bytes, ...]] = tuple  # whole files, made when they are asked for
    cost: int = 1  # how many inputs of a usual reader one of this takes the time of


def readers() -> dict[str, Reader]:
    """All of them by name."""
    found = [*_sumo(), *_logs(), *_parts(), *_cases(), *_small()]
    return {one.name: replace(one, hostile=partial(_all_hostile, one)) for one in found}


def _all_hostile(one: Reader) -> tuple[bytes, ...]:
    return (*one.hostile(), *map(one.wrap, products_of(one.name)))


# --- SUMO -----------------------------------------------------------------------------------------

_NET = b"""<net version="1.20" junctionCornerDetail="5" limitTurnSpeed="5.50">
<location netOffset="0.00,0.00" convBoundary="0.00,0.00,200.00,0.00" origBoundary="0,0,1,1" projParameter="!"/>
<edge id=":b_0" function="internal"><lane id=":b_0_0" index="0" speed="13.89" length="0.20" width="3.2"
 shape="100.00,-1.60,0.0 100.20,-1.60,0.5"/></edge>
<edge id="ab" from="a" to="b" priority="-1"><lane id="ab_0" index="0" speed="13.89" length="100.00"
 shape="0.00,-4.80 100.00,-4.80"/><lane id="ab_1" index="1" speed="13.89" length="100.00" disallow="tram"
 shape="0.00,-1.60 100.00,-1.60"><param key="k" value="v"/></lane></edge>
<edge id="bc" from="b" to="c" priority="-1"><lane id="bc_0" index="0" speed="13.89" length="99.80"
 disallow="tram" shape="100.20,-1.60 200.00,-1.60"/></edge>
<tlLogic id="b" type="static" programID="0" offset="0"><phase duration="42" state="Gr"/></tlLogic>
<junction id="a" type="dead_end" x="0.00" y="0.00" incLanes="" intLanes="" shape="0.00,0.00 0.00,-6.40 0.0,-1"/>
<junction id="b" type="traffic_light" x="100.00" y="0.00" incLanes="ab_0 ab_1" intLanes=":b_0_0"
 shape="100.00,0.00 100.00,-6.40 100.20,-3.2 100.2,0"><request index="0" response="0" foes="0" cont="0"/></junction>
<junction id="c" type="dead_end" x="200.00" y="0.00" incLanes="bc_0" intLanes="" shape="200.00,-3.20 200.00,0.00"/>
<connection from="ab" to="bc" fromLane="1" toLane="0" via=":b_0_0" tl="b" linkIndex="0" dir="s" state="O"/>
<connection from=":b_0" to="bc" fromLane="0" toLane="0" dir="s" state="M"/>
<roundabout nodes="a b" edges="ab bc"/>
</net>"""

_ROUTES = b"""<routes><vType id="truck" vClass="truck" length="12.0" width="2.5" sigma="0.5"/>
<vTypeDistribution id="mixed"><vType id="slow" vClass="passenger" maxSpeed="8" probability="0.5"/>
<vType id="bus" vClass="bus" probability="0.5"/></vTypeDistribution>
<route id="r" edges="ab bc"/><vehicle id="0" type="truck" depart="0.00" route="r"/>
<flow id="f" type="mixed" begin="0" end="20" period="2" from="ab" to="bc"/></routes>"""

_CONFIG = b"""<configuration><input><net-file value="a.net.xml"/><route-files value="a.rou.xml"/>
<additional-files value="a.add.xml"/></input><time><begin value="0"/><end value="30"/></time>
<output><summary value="s.xml"/></output><processing><lateral-resolution value="0.8"/></processing></configuration>"""

_ADDITIONAL = b"""<additional><e1Detector id="d" lane="ab_0" pos="10" file="d.xml"/>
<edgeData id="e" file="e.xml"/><timedEvent dest="t.xml"/><calibrator id="c" output="c.xml"/></additional>"""

_SUMO_FILES = {"a.net.xml": _NET, "a.rou.xml": _ROUTES, "a.add.xml": _ADDITIONAL, "a.sumocfg": _CONFIG}


def _fcd_xml() -> bytes:
    steps = []
    for step in range(12):
        cars = "".join(
            f'<vehicle id="{name}" x="{x + step:.3f}" y="-1.60" angle="90.00" type="truck" speed="10.0" pos="{x}"/>'
            for name, x in (("a", 20.0), ("b", 40.0), ("c", 60.0))
        )
        person = '<person id="p" x="1.00" y="1.00" angle="0.00" speed="1.0" pos="1" edge="ab" slope="0"/>'
        steps.append(f'<timestep time="{step / 10:.2f}">{cars}{person}</timestep>')
    return f"<fcd-export>{''.join(steps)}</fcd-export>".encode()


def _fcd_csv() -> bytes:
    rows = ["timestep_time;vehicle_id;vehicle_type;vehicle_x;vehicle_y;vehicle_angle;person_id"]
    for step in range(12):
        rows += [f"{step / 10:.2f};{name};truck;{x + step:.3f};-1.60;90.00;" for name, x in (("a", 20.0), ("b", 40.0))]
        rows.append(f"{step / 10:.2f};;;;;;p")
    return "\n".join(rows).encode()


def _sumo() -> list[Reader]:
    deep = {**_SUMO_FILES}
    return [
        Reader(
            "sumo_net",
            "a.net.xml",
            (_NET,),
            lambda path: has_levels(read_road_map(path)),
            hostile=partial(_xml_bombs, "net"),
        ),
        Reader(
            "sumo_types",
            "a.rou.xml",
            (_ROUTES,),
            lambda path: read_types((path,)),
            hostile=partial(_xml_bombs, "routes"),
        ),
        Reader("sumocfg", "a.sumocfg", (_CONFIG,), _configuration, deep, hostile=partial(_xml_bombs, "configuration")),
        Reader("sumo_routes", "a.rou.xml", (_ROUTES,), _configuration, deep, hostile=partial(_xml_bombs, "routes")),
        Reader(
            "sumo_additional",
            "a.add.xml",
            (_ADDITIONAL,),
            _configuration,
            deep,
            hostile=partial(_xml_bombs, "additional"),
        ),
        Reader("fcd_xml", "log.xml", (_fcd_xml(),), _fcd, deep, hostile=partial(_xml_bombs, "fcd-export")),
        Reader("fcd_csv", "log.csv", (_fcd_csv(),), _fcd, deep, hostile=_gzip_bombs),
        Reader("sumo_itself", "a.rou.xml", (_ROUTES,), _run_sumo, deep, cost=_PROCESS),
        Reader("sumo_itself_net", "a.net.xml", (_NET,), _run_sumo, deep, cost=_PROCESS),
    ]


def _configuration(path: Path) -> object:
    options = read_input(SumoInput(path.parent / "a.sumocfg"))
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        return write_config(options, Path(folder), {}, {})


def _fcd(path: Path) -> object:
    net = path.parent / "a.net.xml"
    if _is_deep(path):
        return fcd.record_fcd(path, net, Windows(horizon_s=1.0), routes_or_types=(path.parent / "a.rou.xml",))
    return sum(len(rows) for _, rows, _ in islice(fcd.logged_instants(path), 10_000))


def _run_sumo(path: Path) -> object:
    from regents_cosim.sources.sumo import record_sumo

    return record_sumo(SumoInput(net=path.parent / "a.net.xml", routes=(path.parent / "a.rou.xml",), end_s=20.0))


# --- logs -----------------------------------------------------------------------------------------


def _logs() -> list[Reader]:
    kept, log_files.SECONDS = log_files.SECONDS, _SECONDS
    try:
        found = [*_binary_logs(), *_tables(), *_text_logs(), *_argoverse2()]
        plain = log_files.FORMATS.keys() - {one.name for one in found} - _WITH_POLARS.keys()
        return [*found, *(_of(name, hostile=_gzip_bombs) for name in sorted(plain))]
    finally:
        log_files.SECONDS = kept


def _log(format: str, path: Path, mutated: Path) -> object:
    """Read a log, and cut a window out of every sixteenth."""
    scenes_ = list(islice(read_log(path, formats()[format], CompanionFiles()), 2))
    if _is_deep(mutated):
        asked = LogWindows(Windows(horizon_s=1.0))
        for scene in scenes_:
            list(islice(cut(scene, asked, RecordingOrigin("x", "x", "x"), Counter()), 1))
    return len(scenes_)


def _is_deep(path: Path) -> bool:
    """Whether an input is also used: costly, so only one of sixteen, the same ones every time; and every product."""
    data = path.read_bytes()
    return zlib.crc32(data) % 16 == 0 or is_product(data)


def _of(format: str, file: str = "", wrap: Callable[[bytes], bytes] = bytes, name: str = "", **more) -> Reader:
    """A reader of the log that `log_files` writes; `file` is the one that is mutated, the others stay."""
    with tempfile.TemporaryDirectory() as folder:
        path = log_files.write(format, Path(folder))
        root = path if path.is_dir() else path.parent
        files = {str(one.relative_to(root)): one.read_bytes() for one in root.rglob("*") if one.is_file()}
        whole = path.is_dir()
    file = file or path.name
    seeds = more.pop("seeds", None) or (files[file],)

    def read(mutated: Path) -> object:
        return _log(format, mutated.parent if whole else mutated.parent / path.name, mutated)

    return Reader(name or format, file, seeds, read, files, wrap, **more)


def _binary_logs() -> list[Reader]:
    payload = log_files.waymo_scenario(sizes_vary=False)
    with tempfile.TemporaryDirectory() as folder:
        example = next(records(log_files.write_waymo_example(Path(folder))))
    return [
        _of("waymo", seeds=(log_files.record(payload),), cost=3),
        _of("waymo", wrap=log_files.record, seeds=(payload,), name="waymo_payload", cost=10),
        _of("waymo", wrap=log_files.record, seeds=(example,), name="waymo_example_payload", cost=20),
        _of("scenarionet", seeds=(pickle.dumps(log_files.scenarionet(), protocol=4),)),
    ]


def _text_logs() -> list[Reader]:
    plain = tuple(json.dumps(log_files.gpudrive(generation)).encode() for generation in (1, 2, 3))
    old, new = (log_files.commonroad(version).encode() for version in ("2018b", "2020a"))
    return [
        _of("gpudrive", seeds=plain, hostile=lambda: (*_gzip_bombs(), b'{"objects": ' + b"[" * 3_000_000)),
        _of("gpudrive", seeds=plain, wrap=_packed, name="gpudrive_gz"),
        _of("commonroad", seeds=(old, new), hostile=partial(_xml_bombs, "commonRoad")),
    ]


def _tables() -> list[Reader]:
    bomb = _gzip_bombs
    return [
        _of("interaction", "vehicle_tracks_000.csv", hostile=bomb),
        _of("interaction", "DR_TEST.osm", name="interaction_map"),
        _of("sind", "Veh_smoothed_tracks.csv", hostile=bomb),
        _of("levelx", "00_recordingMeta.csv", name="levelx_recording"),
        _of("levelx", "00_tracksMeta.csv", name="levelx_about"),
        _of("highd", "01_recordingMeta.csv", name="highd_recording"),
        _of("highd", "01_tracksMeta.csv", name="highd_about"),
        _of("table", "mine.toml", name="table_columns"),
    ]


def _argoverse2() -> list[Reader]:
    file = "log_map_archive_x.json"
    with tempfile.TemporaryDirectory() as folder:
        log_files.argoverse2_map(Path(folder))
        map_ = (Path(folder) / file).read_bytes()
    found = [Reader("argoverse2_map", file, (map_,), _argoverse2_road)]
    with suppress(ImportError):  # polars is an extra
        found += [_of(name, file, cost=_PROCESS) for name, file in _WITH_POLARS.items()]
    return found


def _argoverse2_road(path: Path) -> object:
    road = _quiet(read_map, path.parent)
    return drivable_area(road, ()) if _is_deep(path) else road


def _quiet(read: Callable[[Path], Any], path: Path) -> Any:
    """Call a reader as `read_log` does."""
    from regents_cosim.sources.logs.formats import explained

    with explained(path, "a log"), np.errstate(all="ignore"):
        return read(path)


# --- parts of readers -----------------------------------------------------------------------------


def _parts() -> list[Reader]:
    point = log_files.point(1.0, 2.0) + log_files.single(4, 0.5) + log_files.whole(5, 300)
    message = b"".join(log_files.nested(k, point * 2) for k in (1, 2, 15, 16)) + log_files.whole(3, -1)
    values = {"a": np.arange(6.0).reshape(2, 3), "b": [1, 2.5, "x", None], "c": (True, b"y"), "d": {"e": {1}}}
    osm = log_files.osm().encode()
    metres = log_files.osm(lambda x, y: (x, y)).replace("lat=", "y=").replace("lon=", "x=").encode()
    origin = UtmOrigin(31, 0.0, 0.0)
    return [
        Reader("unpickle", "a.pkl", (pickle.dumps(values, 4),),
               lambda path: unpickle(path.read_bytes()), hostile=lambda: _PICKLES),
        Reader("protobuf", "a.bin", (message,), partial(_quiet, _protobuf)),
        Reader("tfrecord", "a.bin", (log_files.record(b"abc") + log_files.record(b"d" * 200),),
               lambda path: list(records(path))),
        Reader("lanelet2", "a.osm", (osm, metres), partial(_quiet, lambda path: read_lanelet2(path, origin)),
               hostile=partial(_xml_bombs, "osm")),
    ]  # fmt: skip


def _protobuf(path: Path) -> object:
    top = grouped(memoryview(path.read_bytes()))
    nested = [value for values in top.values() for value in values if not isinstance(value, int)]
    return columns(nested, (1, 2, 3))


_PICKLES = (
    b"\x80\x04" + b"(" * 300_000 + b".",
    b"\x80\x04)" + b"\x85" * 1_000_000 + b"K\x01\x86.",
    b"\x80\x04]r\xff\xff\xff\x7f.",
    b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0f.",
    b"\x80\x02cos\nsystem\n\x8c\x04true\x85R.",
)

# --- cases on disk --------------------------------------------------------------------------------


def _cases() -> list[Reader]:
    made = scenes.scene((0, 0, 10), (20, 0, 10), (40, 3.2, 10), steps=12)
    made = dataclasses.replace(made, road=dataclasses.replace(made.road, sumo_net=gzip.compress(_NET, mtime=0)))
    with tempfile.TemporaryDirectory() as folder:
        case = save_unlisted(made, Path(folder))
        save_suite(Path(folder), Suite((SuiteEntry(case.name, "0" * 64),), "command", 0, {"jax": "1"}))
        driven = {
            "idm": {
                "mirror": {case.name: DriveOutcome("0" * 64, "collision", "car01", 3, 0.3, "t_bone", {"score": 1.0})}
            }
        }
        save_baseline(Path(folder) / "baseline.json", Baseline(driven))
        files = {str(one.relative_to(folder)): one.read_bytes() for one in Path(folder).rglob("*") if one.is_file()}
    road = next(name for name in files if name.endswith(".road.json.gz"))
    net = next(name for name in files if name.endswith(".net.xml.gz"))
    tracks = files[f"{case.name}/tracks.npz"]

    def load(path: Path) -> object:
        root = next(above for above in path.parents if (above / "suite.json").exists())
        return load_case(root / case.name)

    def one(name: str, file: str, read: Callable[[Path], object] = load, **more) -> Reader:
        return Reader(name, file, more.pop("seeds", None) or (files[file],), read, files, **more)

    arrays = np.load(io.BytesIO(tracks))
    return [
        one("scenario_json", f"{case.name}/scenario.json", hostile=_json_bombs),
        one("tracks_npz", f"{case.name}/tracks.npz", seeds=(tracks, _zipped(arrays)), hostile=_zip_bombs),
        one("tracks_npy", f"{case.name}/tracks.npz", seeds=(_npy(arrays["x"]), _npy(np.asfortranarray(arrays["x"]))),
            wrap=lambda data: _npz({**arrays, "x": data})),
        one("road_json", road, seeds=(gzip.decompress(files[road]),), wrap=_packed, hostile=_gzip_bombs),
        one("net_xml_gz", net, hostile=_gzip_bombs),
        one("suite_json", "suite.json", lambda path: load_manifest(path.parent), hostile=_json_bombs),
        one("baseline_json", "baseline.json", load_baseline, hostile=_json_bombs),
    ]  # fmt: skip


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _zipped(arrays: Mapping[str, np.ndarray]) -> bytes:
    return _npz({name: _npy(array) for name, array in arrays.items()})


def _npz(arrays: Mapping[str, np.ndarray | bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, array in arrays.items():
            archive.writestr(f"{name}.npy", array if isinstance(array, bytes) else _npy(array))
    return buffer.getvalue()


def _zip_bombs() -> tuple[bytes, ...]:
    """An array of 400 MB that takes 400 KB, and one that says it has a billion rows."""
    names = ("x", "y", "yaw", "speed", "valid")
    large = _npy(np.zeros((2, 25_000_000)))
    few = _npy(np.zeros((2, 3))).replace(b"(2, 3)", b"(1000000000, 3)".ljust(6))
    return _npz(dict.fromkeys(names[:1], large), zipfile.ZIP_DEFLATED), _npz(dict.fromkeys(names, few))


# --- small ones -----------------------------------------------------------------------------------


def _small() -> list[Reader]:
    from safetensors.numpy import save

    weights = save({"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.zeros(2, np.float16)})
    limits = b"min_ttc_s:-5% collision:+0 max_drac_m_s2:+0.5"
    return [
        Reader("weights", "a.safetensors", (weights,), load_weights),
        Reader("thresholds", "a.txt", (limits,), lambda path: parse_thresholds(path.read_text("latin-1"))),
    ]


# --- bombs ----------------------------------------------------------------------------------------


def _packed(data: bytes) -> bytes:
    return gzip.compress(data, 1, mtime=0)


@lru_cache(maxsize=1)
def _gzip_bombs() -> tuple[bytes, ...]:
    """3 GiB of blanks in 3 MB."""
    return (gzip.compress(b" " * (1 << 26), 9, mtime=0) * 48,)


def _json_bombs() -> tuple[bytes, ...]:
    return b"[" * 5_000_000, b'{"schema":1,"id":' + b"[" * 99_999, b'{"a":' * 200_000


def _xml_bombs(root: str) -> tuple[bytes, ...]:
    """Entities that double, entities from a file, depth, breadth, attributes, and gzip of 3 GiB."""
    doubling = "".join(f'<!ENTITY a{i} "&a{i - 1};&a{i - 1};">' for i in range(1, 40))
    entities = f'<!DOCTYPE {root} [<!ENTITY a0 "aaaaaaaaaa">{doubling}]><{root}>&a39;</{root}>'
    outside = f'<!DOCTYPE {root} [<!ENTITY a SYSTEM "file:///etc/passwd">]><{root}>&a;</{root}>'
    deep = f"<{root}>" + "<a>" * 100_000
    broad = f"<{root}>" + "<a/>" * 300_000 + f"</{root}>"
    many = f"<{root} " + " ".join(f'a{i}=""' for i in range(300_000)) + "/>"
    wide = gzip.compress(f"<{root}>".encode() + b"<a b=''/>" * 2_000_000, 1, mtime=0)
    return (*(text.encode() for text in (entities, outside, deep, broad, many)), wide, *_gzip_bombs())
