import gzip
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from params import slow
from places import NETS

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.errors import NoWindowError, RegentsError
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.sources.fcd import LogError, logged_instants, record_fcd
from regents_cosim.sources.record import record as record_any
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated

FOLDER = NETS / "merge"
NET, ROUTES = FOLDER / "merge.net.xml", FOLDER / "merge.rou.xml"
END_S = 80.0


def write_log(path: Path, *options: str) -> None:
    command = ["-c", str(FOLDER / "merge.sumocfg"), "--lanechange.duration", "3", "--seed", "0", "--precision", "6"]
    with running_sumo([*command, "--no-step-log", "--fcd-output", str(path), *options]) as sumo:
        while sumo.simulation.getTime() < END_S - 0.05:
            sumo.simulationStep()


def write_empty_log(path: Path) -> None:
    with running_sumo(["-n", str(NET), "--step-length", "0.1", "--no-step-log", "--fcd-output", str(path)]) as sumo:
        sumo.simulationStep(10.0)


@dataclass(frozen=True)
class Logs:
    folder: Path

    def __getitem__(self, name: str) -> Path:
        return self.folder / name


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name in ("a.xml", "a.csv"):
        run_isolated(write_log, folder / name)
    (folder / "a.xml.gz").write_bytes(gzip.compress((folder / "a.xml").read_bytes()))
    (folder / "a.csv.gz").write_bytes(gzip.compress((folder / "a.csv").read_bytes()))
    return Logs(folder)


def record(log: Path, **asked):
    return record_fcd(log, NET, Windows(**({"count": 3} | asked)), routes_or_types=(ROUTES,))


@pytest.mark.slow
def test_a_log_gives_what_the_run_itself_gives(logs):
    """By chance: where egos with a conflict come first, a run that goes on gives windows that a log no longer holds."""
    run = record_sumo(SumoInput(FOLDER / "merge.sumocfg", end_s=END_S), Windows(count=3, prefer="none"))
    read = record(logs["a.xml"], prefer="none")
    assert [s.id.removeprefix("a-") for s in read] == [s.id.removeprefix("merge-") for s in run]
    for ours, theirs in zip(read, run, strict=True):
        assert ours.agents == theirs.agents
        assert (ours.tracks.valid == theirs.tracks.valid).all()
        for name, tolerance in (("x", 1e-5), ("y", 1e-5), ("yaw", 1e-6), ("speed", 1e-4)):
            np.testing.assert_allclose(getattr(ours.tracks, name), getattr(theirs.tracks, name), atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.csv.gz", slow("a.xml.gz"), slow("a.csv")])
@pytest.mark.filterwarnings("ignore:.*does not say how SUMO wrote it")
def test_formats_agree(logs, name):
    if name.startswith("a.csv") and version("libsumo") < "1.27":
        pytest.skip("SUMO before 1.27 leaves steps without vehicles out of a CSV")
    plain, other = record(logs["a.xml"]), record(logs[name])
    assert [content_hash(s) for s in plain] == [content_hash(s) for s in other]
    assert other[0].provenance.file == name


@pytest.mark.slow
def test_a_coarser_log_is_resampled(logs):
    run_isolated(write_log, logs["slow.xml"], "--device.fcd.period", "0.5")
    fine = {s.provenance.begin_s: s for s in record(logs["a.xml"], count=99)}
    coarse = record(logs["slow.xml"], count=99)
    assert coarse
    for scenario in coarse:
        assert scenario.dt == 0.1
        assert scenario.tracks.steps == 81
        assert scenario.tracks.valid[0].all()
    compared = 0
    for scenario in coarse:
        late = [s for begin, s in fine.items() if abs(begin - scenario.provenance.begin_s) < 4.0]
        for other in late:
            names = [a.id for a in other.agents]
            if scenario.ego.id not in names:
                continue
            shift = round((scenario.provenance.begin_s - other.provenance.begin_s) / 0.1)
            row = names.index(scenario.ego.id)
            steps = [k for k in range(81) if 0 <= k + shift < 81 and other.tracks.valid[row, k + shift]]
            there = [k + shift for k in steps]
            np.testing.assert_allclose(scenario.tracks.x[0, steps], other.tracks.x[row, there], atol=0.2)
            compared += len(steps)
    assert compared > 40


@pytest.mark.slow
def test_unknown_types_are_cars_and_a_warning_says_so(logs):
    with pytest.warns(UserWarning, match=r"no vType for .*truck.* taken as cars of 5.0 m x 1.8 m"):
        scenarios = record_fcd(logs["a.xml"], NET, Windows(count=3))
    assert {(a.kind, a.length, a.width) for s in scenarios for a in s.agents} == {("car", 5.0, 1.8)}


def spoilt(logs) -> dict[str, tuple[bytes, str]]:
    xml, table = logs["a.xml"].read_bytes(), logs["a.csv"].read_bytes()
    return {
        "empty": (b"", "the file is empty"),
        "truncated xml": (xml[: len(xml) // 2], "truncated XML"),
        "truncated gzip": (gzip.compress(xml)[:50_000], "gzip data is damaged or cut off"),
        "truncated csv": (table[: table.rindex(b"main") - 3], "truncated or damaged CSV"),
        "another xml": (NET.read_bytes(), "root element is <net>"),
        "another csv": (b"a;b\n1;2\n", "neither XML nor a CSV header"),
        "no number": (table.replace(b";90.", b";xx."), "could not convert string to float"),
        "no steps": (b"<fcd-export/>", "0 time steps"),
        "no position": (b'<fcd-export><timestep time="0"><vehicle id="a"/></timestep></fcd-export>', "has no x"),
        "backwards": (b'<fcd-export><timestep time="1"/><timestep time="0.5"/></fcd-export>', "does not increase"),
        "coarse": (b'<fcd-export><timestep time="1"/><timestep time="4"/></fcd-export>', "one sample every 3 s"),
        "uneven": (
            b'<fcd-export><timestep time="0"/><timestep time="0.5"/><timestep time="1.2"/></fcd-export>',
            "expected one step length",
        ),
    }


@pytest.mark.slow
def test_damaged_logs_give_one_clear_line(logs, tmp_path):
    for name, (content, message) in spoilt(logs).items():
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(LogError, match=message) as error:
            record(path)
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_other_ways_to_find_nothing(logs, tmp_path):
    with pytest.raises(NoWindowError, match=r"500 s does not fit into a\.xml"):
        record(logs["a.xml"], horizon_s=500.0)
    with pytest.raises(RegentsError, match="FCD log not found"):
        record(tmp_path / "none.xml")
    moved = tmp_path / "moved.xml"
    moved.write_text(logs["a.xml"].read_text().replace(' x="', ' x="77777'))
    with pytest.raises(LogError, match="off the network"):
        record(moved)


def test_degrees_are_told_from_metres_where_the_network_has_its_zero_too(tmp_path):
    """A network of netconvert begins at zero, so the degrees of Munich are metres within it."""
    west, south = read_road_map(NET).drivable.bounds[:2]
    rows = "".join(
        f'<timestep time="{0.1 * t:.1f}">'
        + "".join(
            f'<vehicle id="{one}" x="{west + 11.5 + 0.002 * one + 1e-5 * t}" y="{south + 3.1}" angle="{90 * one}"/>'
            for one in range(4)
        )
        + "</timestep>"
        for t in range(50)
    )
    (tmp_path / "geo.xml").write_text(f"<fcd-export>{rows}</fcd-export>")
    with pytest.raises(LogError, match=r"within 1 m of .*without --fcd-output\.geo"):
        record(tmp_path / "geo.xml", horizon_s=2.0)


@pytest.mark.parametrize("name", ["xml", "csv"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_text_as_windows_writes_it(encoding, name, tmp_path):
    if name == "xml":
        rows = "".join(f'<timestep time="{t}"><vehicle id="a" x="{t}" y="0" angle="90"/></timestep>' for t in range(3))
        text = f'<?xml version="1.0"?>\n<fcd-export>{rows}</fcd-export>'
    else:
        header = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle"
        text = "\n".join([header, *(f"{t};a;{t};0;90" for t in range(3))])
    (tmp_path / "log").write_bytes(text.encode(encoding))
    found = list(logged_instants(tmp_path / "log"))
    assert [(time, [(one.name, one.x) for one in rows]) for time, rows, _ in found] == [
        (time, [("a", time)]) for time in (0.0, 1.0, 2.0)
    ]


def test_an_fcd_output_needs_a_network_of_sumo(tmp_path):
    for source in ("highway:highway-v0", tmp_path / "log.csv"):
        with pytest.raises(RegentsError, match="expected the network of this fcd-output"):
            record_any(source, fcd=tmp_path / "a.xml")


def test_a_log_without_any_vehicle_says_so(tmp_path):
    run_isolated(write_empty_log, tmp_path / "empty.xml")
    run_isolated(write_empty_log, tmp_path / "empty.csv")
    for name in ("empty.xml", "empty.csv"):
        with pytest.raises(NoWindowError, match="no vehicle was on the road"):
            record(tmp_path / name, horizon_s=2.0)
