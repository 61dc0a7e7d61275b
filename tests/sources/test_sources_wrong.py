"""SUMO's traffic that reads well and would be silently wrong or incomplete; networks that are damaged."""

import contextlib
import gzip
from pathlib import Path

import pytest
from params import slow

from regents_cosim.cases.shipped import network_config
from regents_cosim.errors import LogError, NoWindowError, SumoError
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.types import read_types
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

MERGE = network_config("merge").parent
NET = MERGE / "merge.net.xml"
TYPES = b"""<routes><vType id="car" length="4.5" width="1.8"/>
<vType id="rig" vClass="trailer" length="16.5" width="2.5"/></routes>"""


def log_of(folder: Path, form: str) -> Path:
    """Three cars drive up the main road for 3 s; then the first one's id is a lorry's. A person stands beside."""
    rows = []
    for step in range(70):
        for number in range(3):
            kind = "rig" if number == 0 and step >= 35 else "car"
            rows.append((step, f"v{number}", kind, 20.0 + 15.0 * number + step, -1.6))
    if form == "xml":
        vehicle = '<vehicle id="{1}" type="{2}" x="{3}" y="{4}" angle="90"/>'
        person = '<person id="p" x="1" y="1" angle="0"/>'
        steps = [
            f'<timestep time="{k / 10}">{"".join(vehicle.format(*r) for r in rows if r[0] == k)}{person}</timestep>'
            for k in range(70)
        ]
        text = f"<fcd-export>{''.join(steps)}</fcd-export>"
    else:
        text = (
            "timestep_time;vehicle_id;vehicle_type;vehicle_x;vehicle_y;vehicle_angle;person_id\n0.0;;;;;;p\n"
            + "\n".join([f"{r[0] / 10};{r[1]};{r[2]};{r[3]};{r[4]};90;" for r in rows])
        )
    path = folder / f"log.{form}"
    path.write_text(text)
    return path


@pytest.mark.parametrize("form", ["xml", "csv"])
def test_an_id_that_is_used_again_by_another_type_is_another_vehicle(tmp_path, form):
    (tmp_path / "types.xml").write_bytes(TYPES)
    said = []
    scenarios = record_fcd(
        log_of(tmp_path, form), NET, Windows(horizon_s=6.0), routes_or_types=(tmp_path / "types.xml",), tell=said.append
    )
    sizes = {agent.id: agent.length for scenario in scenarios for agent in scenario.agents}
    assert sizes["v0"] == 4.5
    assert sizes["v0#2"] == 16.5
    assert any("1 person left out" in line for line in said) == (form == "csv")  # whose columns give it no place
    assert "1 articulated vehicle taken as rigid: one box each" in said


PERSON = b"""<routes><vType id="rig" vClass="trailer" guiShape="truck/semitrailer"/>
<person id="p" depart="0"><stop lane="main_in_0" endPos="20" duration="100"/></person>
<flow id="f" type="rig" begin="0" end="60" period="3" from="main_in" to="main_out" departSpeed="max"/></routes>"""


@pytest.mark.slow
def test_trailers_of_a_run_are_told(tmp_path):
    edges = [lane.id.rpartition("_")[0] for lane in read_road_map(NET).lanes if not lane.id.startswith(":")]
    content = PERSON.replace(b"main_in", edges[0].encode()).replace(b"main_out", edges[0].encode())
    (tmp_path / "a.rou.xml").write_bytes(content)
    said = []
    with contextlib.suppress(NoWindowError):
        record_sumo(
            SumoInput(net=NET, routes=(tmp_path / "a.rou.xml",), end_s=60.0), Windows(horizon_s=3.0), tell=said.append
        )
    assert not any("person" in line for line in said)  # it stands beside, and is recorded
    assert any("articulated" in line for line in said)


@pytest.mark.parametrize("length", ["inf", slow("1e9")])
def test_a_vehicle_longer_than_any_road_is_one_line(tmp_path, length):
    edge = next(lane.id.rpartition("_")[0] for lane in read_road_map(NET).lanes if not lane.id.startswith(":"))
    (tmp_path / "a.rou.xml").write_text(
        f'<routes><vType id="t" length="{length}"/>'
        f'<vehicle id="a" type="t" depart="0"><route edges="{edge}"/></vehicle></routes>'
    )
    with pytest.raises(SumoError, match=r"vehicle 'a' has the length (inf|1e\+09) m, expected 0.05 to 1000 m"):
        record_sumo(SumoInput(net=NET, routes=(tmp_path / "a.rou.xml",), end_s=4.0), Windows(horizon_s=2.0))


@pytest.mark.parametrize("extra", [("--mesosim",), ("--mesosim=true",)])
def test_a_mesoscopic_run_is_refused_by_its_name(extra):
    with pytest.raises(SumoError, match="a mesoscopic simulation .* expected a microscopic one"):
        record_sumo(SumoInput(MERGE / "merge.sumocfg", extra=extra))


# --- damaged and hostile networks -----------------------------------------------------------------

EDGE = (
    '<net><edge id="a" from="x" to="y"><lane id="a_0" index="0" speed="13" length="9" shape="{}"/></edge>'
    '<junction id="x" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="{}"/>'
    '<junction id="y" type="dead_end" x="9" y="0" incLanes="a_0" intLanes="" shape="0,0 1,0 1,1"/>{}</net>'
)
GOOD, RING = "0,0 9,0", "0,0 1,0 1,1"
LOOP = (
    '<edge id=":x" function="internal"><lane id=":x_0" index="0" speed="1" length="1" shape="0,0 1,1"/></edge>'
    '<connection from="a" to="a" fromLane="0" toLane="0" via=":x_0"/>'
    '<connection from=":x" to="a" fromLane="0" toLane="0" via=":x_0"/>'
)
DAMAGED = {
    "one point": EDGE.format("0,0", RING, ""),
    "no number": EDGE.format("0,nan 9,0", RING, ""),
    "beyond": EDGE.format("0,0 9e9,0", RING, ""),
    "junction of no number": EDGE.format(GOOD, "0,inf 1,0 1,1", ""),
    "unknown lane": EDGE.format(GOOD, RING, '<connection from="a" to="a" fromLane="0" toLane="0" via=":z_0"/>'),
    "a way that leads back to itself": EDGE.format(GOOD, RING, LOOP),
    "nested": "<net>" + "<edge>" * 5000,
    "entities": '<!DOCTYPE net [<!ENTITY a "b">]><net>&a;</net>',
    "entities in another encoding": '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE n [<!ENTITY a "b">]><n>&a;</n>',
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_network_is_one_line(tmp_path, name):
    encoding = "utf-16" if "encoding" in name else "utf-8"
    (tmp_path / "a.net.xml").write_bytes(DAMAGED[name].encode(encoding))
    with pytest.raises(SumoError, match=r"a\.net\.xml") as error:
        read_road_map(tmp_path / "a.net.xml")
    assert len(str(error.value)) <= 500
    if "entities" in name:
        assert "document type" in str(error.value)


@pytest.mark.parametrize("read", [read_road_map, lambda path: read_types((path,)), lambda path: record_fcd(path, NET)])
def test_a_small_file_that_unpacks_to_gigabytes_is_refused(tmp_path, read):
    bomb = gzip.compress(b" " * (1 << 26), 9, mtime=0) * 4
    (tmp_path / "a.xml").write_bytes(gzip.compress(b"<a>") + bomb)
    with pytest.raises((SumoError, LogError), match="holds more than .* MiB, the most that is read of it"):
        read(tmp_path / "a.xml")


@pytest.mark.parametrize("attribute", ["time", "x", "angle"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e308"])
def test_numbers_that_are_none_in_a_log_are_one_line(tmp_path, attribute, value):
    path = log_of(tmp_path, "xml")
    text = path.read_text().replace(f'{attribute}="', f'{attribute}="{value}" was="', 1)
    path.write_text(text)
    if attribute == "x" and value == "1e308":
        return  # SUMO writes such places for vehicles that are not on the road
    if attribute == "angle" and value == "1e308":
        return
    with pytest.raises(LogError, match=r"log\.xml"):
        record_fcd(path, NET, Windows(horizon_s=6.0), tell=print)
