"""Each road user that SUMO shows is in a scene, once; a line names those that are left out."""

import pytest
from against_sumo import differing, held, own_log
from places import ROOT

from regents_cosim.errors import SumoError
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.types import CAR, PEDESTRIAN, VehicleType
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.recording import DistinctIds
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

NET = ROOT / "sumo_nets" / "signals" / "signals.net.xml"
TRAFFIC = '<flow id="{0}" type="{0}" begin="0" end="60" period="{1}" from="west_in" to="east_out" departLane="best"/>'
CARS = '<vType id="car"/>' + TRAFFIC.format("car", 3)
BLUE_LIGHT = (
    '<vType id="blue" vClass="emergency" speedFactor="1.5"><param key="has.bluelight.device" value="true"/></vType>'
)
STOP = '<stop lane="east_out_0" endPos="20" duration="99"/>'
CONTAINERS = f'<containerFlow id="box" begin="0" end="9" period="3">{STOP}</containerFlow>'


def config(folder, text):
    (folder / "x.xml").write_text(f"<additional>{text}</additional>")
    path = folder / "x.sumocfg"
    path.write_text(
        f'<configuration><net-file value="{NET}"/><additional-files value="x.xml"/><end value="60"/></configuration>'
    )
    return path


def windows(found, said, count=2):
    return record_sumo(found, Windows(count=count, seed=3, prefer="none"), tell=said.append)


def test_who_makes_way_for_a_blue_light_stays_one_vehicle(tmp_path):
    text = CARS.replace("<flow", f"{BLUE_LIGHT}<flow") + TRAFFIC.format("blue", 15)
    found = windows(SumoInput(config(tmp_path, text)), [])
    assert found
    names = [agent.id for case in found for agent in case.agents]
    assert not [name for name in names if "#" in name]
    assert not [one for case in found for one in case.provenance.left_out if one.reason == "gap"]


def test_ids_stay_distinct_where_vehicles_are_called_alike():
    names, lorry = DistinctIds(), VehicleType("truck", 9.0, 2.5)
    asked = [("p", CAR, False), ("p", PEDESTRIAN, True), ("p#2", CAR, False), ("p", lorry, False)]
    found = [names.of(*one) for one in asked]
    assert len({*found}) == len(found)
    assert [names.of(*one) for one in asked] == found
    assert [names.types[one] for one in found] == [outline for _, outline, _ in asked]


def test_what_calibrators_bring_is_recorded(tmp_path):
    flow = '<flow begin="10" end="60" route="we" vehsPerHour="1200" speed="12" type="car"/>'
    text = (
        '<vType id="car"/><route id="we" edges="west_in west_stop east_out"/>'
        f'<calibrator id="c" edge="west_in" pos="10">{flow}</calibrator>'
    )
    assert windows(SumoInput(config(tmp_path, text)), [], 1)


@pytest.mark.slow
def test_containers_are_in_a_scene_of_a_log_and_else_named(tmp_path):
    path, said = config(tmp_path, CARS + CONTAINERS), []
    (live,) = record_sumo(SumoInput(path), Windows(count=1, seed=3, prefer="none"), tell=said.append)
    assert "containers" in str(live.provenance.left_out)
    log = own_log(path, tmp_path, (), 60.0)
    found = record_fcd(
        log, NET, Windows(count=2, prefer="none"), routes_or_types=(tmp_path / "x.xml",), tell=said.append
    )
    boxes = {(one.id, one.kind, one.length) for case in found for one in case.agents if one.id.startswith("box")}
    assert boxes == {(f"box.{number}", "other", 6.096) for number in range(3)}


@pytest.mark.slow
def test_two_networks_are_refused(tmp_path):
    path = tmp_path / "x.sumocfg"
    path.write_text(f'<configuration><net-file value="{NET},{NET}"/></configuration>')
    with pytest.raises(SumoError, match="2 networks"):
        record_sumo(SumoInput(path))


@pytest.mark.slow
def test_persons_without_a_state_are_where_sumo_logs_them(tmp_path):
    street = ROOT / "sumo_nets" / "street" / "street.sumocfg"
    found = held(street, tmp_path, ("--pedestrian.model", "nonInteracting"), end_s=60.0)
    assert differing(found) == []
    assert any(agent.kind == "pedestrian" for case in found[0] for agent in case.agents)


@pytest.mark.slow
def test_who_is_ignored_by_sumo_itself_is_told_once(tmp_path):
    vehicle = '<vehicle id="{}" type="car" depart="{}"><route edges="east_in"/></vehicle>'
    late = "".join(vehicle.format(f"late{number}", 10) for number in range(3))
    (tmp_path / "r.xml").write_text(f"<routes>{CARS}{vehicle.format('first', 20)}{late}</routes>")
    said = []
    source = SumoInput(net=NET, routes=(tmp_path / "r.xml",), end_s=60.0)
    record_sumo(source, Windows(count=1, seed=3), tell=said.append)
    (line,) = (line for line in said if "ignored by SUMO" in line)
    assert line.startswith("3 road users ignored")
    assert "'late0'" in line
