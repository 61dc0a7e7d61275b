"""Logs that hold a share of the vehicles say so, and who rides in the others is nobody on foot."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from comparison import compare_with_fcd
from params import slow

from regents_cosim.errors import LogError
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.fcd_rides import what_it_lacks
from regents_cosim.sources.windows import Windows

NET = Path(__file__).parent / "inputs" / "08-types-of-an-fcd-log" / "net.net.xml"
ROUTES = """<routes>
<vType id="bus" vClass="bus"/>
<person id="walks" depart="0" departPos="20"><walk edges="WC CE" arrivalPos="100"/></person>
<person id="rides" depart="0" departPos="45"><walk edges="WC" arrivalPos="60"/><ride from="WC" to="CE" lines="b"/>
  <walk edges="CE" arrivalPos="100"/></person>
<flow id="f" begin="0" end="60" period="2" departSpeed="max" departLane="1"><route edges="WC CE"/></flow>
<vehicle id="b" type="bus" depart="1" departLane="0"><route edges="WC CE"/>
  <stop lane="WC_0" endPos="65" duration="12"/><stop lane="CE_0" endPos="60" duration="5"/></vehicle>
</routes>"""


def sumo(folder, log, *more, step="0.1", end="60"):
    import sumo as wheel

    (folder / "r.rou.xml").write_text(ROUTES)
    words = [Path(wheel.SUMO_HOME) / "bin" / "sumo", "-n", NET, "-r", "r.rou.xml", "--fcd-output", log]
    words += ["--step-length", step, "--precision", "6", "--no-step-log", "--no-warnings", "--end", end, *more]
    subprocess.run(words, cwd=folder, check=True, timeout=60)
    return folder / log


@pytest.fixture(scope="module", params=["0.1 xml", slow("1 csv"), slow("0.1 xml without speeds")])
def without_the_bus(request, tmp_path_factory):
    """SUMO's log of everything, less the bus."""
    step, ending, *bare = request.param.split()
    more = ("--fcd-output.attributes", "x,y,z,angle,type") if bare else ()
    log = sumo(tmp_path_factory.mktemp("share"), f"all.{ending}", *more, step=step)
    rows = log.read_text().splitlines(keepends=True)
    log.write_text("".join(row for row in rows if '<vehicle id="b"' not in row and ";b;" not in row))
    return log


def record(log, said=None, **more):
    windows = Windows(**({"count": 20, "prefer": "none", "radius_m": 400.0} | more))
    tell = (said if said is not None else []).append
    return record_fcd(log, NET, windows, routes_or_types=(log.with_name("r.rou.xml"),), tell=tell)


def test_who_rides_in_a_vehicle_that_the_log_lacks_does_not_walk(without_the_bus):
    found = record(without_the_bus, horizon_s=4.0)
    on_foot = [(case, i) for case in found for i, agent in enumerate(case.agents) if agent.kind == "pedestrian"]
    assert {case.agents[i].id for case, i in on_foot} == {"walks", "rides"}
    assert max(case.tracks.speed[i].max() for case, i in on_foot) < 3.0
    for case, i in on_foot:
        y = case.tracks.y[i][case.tracks.valid[i]]
        assert (np.abs(y - 195.2) > 1.0).all(), "the middle of the lane is the bus's, also while it waits"
    riding = [one for case in found for one in case.provenance.left_out if one.reason == "rider"]
    assert {one.ids for one in riding} == {("rides",)}
    lacks = {one.detail for case in found for one in case.provenance.left_out if one.reason == "unlogged"}
    assert lacks == {"persons in vehicles that it lacks: 1"}


@pytest.mark.slow
def test_the_log_of_all_vehicles_lacks_nothing(tmp_path):
    log = sumo(tmp_path, "all.xml")
    said = []
    found = record(log, said)
    assert what_it_lacks(log) == ""
    assert not any(one.reason == "unlogged" for case in found for one in case.provenance.left_out)
    assert not any("does not say" in line for line in said)
    assert all(one.unexplained(case) == {} for case, one in zip(found, compare_with_fcd(found, log), strict=True))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--device.fcd.probability", "0.5"), "device.fcd.probability 0.5"),
        slow(("--device.fcd.explicit", "b"), "device.fcd.explicit b"),
        slow(("--person-device.fcd.probability", "0"), "person-device.fcd.probability 0"),
        slow(("--device.fcd.probability", "1"), ""),
        slow(("--fcd-output.filter-edges.input-file", "edges.txt"), "fcd-output.filter-edges.input-file edges.txt"),
    ],
)
def test_the_options_that_kept_vehicles_out_are_told(options, expected, tmp_path):
    (tmp_path / "edges.txt").write_text("edge:WC\n")
    assert what_it_lacks(sumo(tmp_path, "some.xml.gz", *options, end="1")) == expected


@pytest.mark.parametrize("value", ["true", slow("on")])
def test_the_log_of_a_mesoscopic_simulation_is_refused(value, tmp_path):
    log = sumo(tmp_path, "meso.xml", "--mesosim", value, end="20")
    with pytest.raises(LogError, match="log of a mesoscopic simulation .* expected a microscopic one"):
        record(log)


def test_a_case_says_that_its_log_is_a_share_or_does_not_say(tmp_path):
    log, said = sumo(tmp_path, "some.xml", "--device.fcd.probability", "0.7", "--seed", "3"), []
    (case,) = record(log, said, count=1)
    (entry,) = (one for one in case.provenance.left_out if one.reason == "unlogged")
    assert entry.detail.startswith("device.fcd.probability 0.7")
    bare = tmp_path / "bare.xml"
    bare.write_text("<fcd-export" + log.read_text().partition("<fcd-export")[2])
    record(bare, said, count=1)
    assert any("bare.xml does not say how SUMO wrote it" in line for line in said)
