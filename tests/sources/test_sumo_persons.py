"""Persons in SUMO's traffic: recorded where they walk and wait, from a run and from its log."""

import csv
import gzip
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest
import shapely
from params import slow
from places import ROOT
from walking_town import make_town

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.map_files import map_files
from regents_cosim.errors import InputError, SumoError
from regents_cosim.maps.walkways import read_walkways
from regents_cosim.simulators.sumo.config import read_input
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import SumoRecordingJob, record_slots, record_sumo, sumo_command
from regents_cosim.sources.windows import Windows
from regents_cosim.system.files.atomic import scratch_folder
from regents_cosim.system.workers import run_isolated

BESIDE = {"taxi", "waits"}  # who waits at a stop does so off the pavement
BY_LIFT = {"1", "5", "9"}  # which is shorter than their way over the crossing
ALL_SLOTS = Windows(count=4, ego="flow0")  # where the ego is named, every slot is read


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    return make_town(tmp_path_factory.mktemp("town"))


@pytest.fixture(scope="module")
def recordings(town):
    return run_isolated(record_slots, SumoRecordingJob(read_input(town), ALL_SLOTS))[0]


def write_logs(job, folder):
    """What SUMO logs of the run that is recorded, as XML and as CSV."""
    for name, extra in (("log.xml", []), ("all.xml", ["--fcd-output.attributes", "all"]), ("log.csv", [])):
        with scratch_folder() as scratch:
            command = [*sumo_command(job, scratch), "--precision", "6", "--fcd-output", str(folder / name), *extra]
            with running_sumo(command) as sumo:
                while sumo.simulation.getTime() < 89.95:
                    sumo.simulationStep()


@pytest.fixture(scope="module")
def logs(town, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    run_isolated(write_logs, SumoRecordingJob(read_input(town), ALL_SLOTS), folder)
    return folder


def test_persons_are_recorded_with_their_sizes_where_they_walk_and_wait(recordings, town):
    found = {
        name: kind for one in recordings for name, kind in zip(one.ids, one.types, strict=True) if kind.kind != "car"
    }
    assert {kind.kind for kind in found.values()} == {"pedestrian"}
    assert {"taxi", "waits", *map(str, range(12))} <= set(found)
    assert (found["0"].length, found["0"].width) == (0.215, 0.478)
    assert (found["4"].length, found["4"].width) == (1.2, 0.72)
    road = read_road_map(town.net)
    crossings = shapely.union_all([one.area for one in road.walkways if one.kind == "crossing"])
    pavement = shapely.union_all([one.area for one in road.walkways]).buffer(0.5)
    crossed = 0
    for one in recordings:
        for row in (i for i, kind in enumerate(one.types) if kind.kind == "pedestrian" and one.ids[i] not in BESIDE):
            places = shapely.points(one.x[row, one.valid[row]], one.y[row, one.valid[row]])
            assert shapely.contains(pavement, places).mean() > 0.95, one.ids[row]
            crossed += bool(shapely.contains(crossings, places).any())
    assert crossed > 5
    waits = [one for one in recordings if "waits" in one.ids]
    assert len(waits) == len(recordings)
    assert max(np.ptp(one.x[one.ids.index("waits")]) for one in waits) < 1e-9


def presence(recordings, name):
    """Whether one is there, from the first time on: its changes."""
    here = np.concatenate(
        [
            one.valid[one.ids.index(name)] if name in one.ids else np.zeros(one.valid.shape[1], bool)
            for one in recordings
        ]
    )
    here = here[np.argmax(here) :]
    return [bool(here[0]), *(bool(here[k + 1]) for k in np.flatnonzero(np.diff(here)))]


def test_one_who_rides_or_takes_the_lift_is_left_out_meanwhile(recordings):
    assert presence(recordings, "taxi") == [True, False, True]  # walks and waits, rides, walks on
    assert presence(recordings, "1")[:3] == [True, False, True]
    assert {"taxi", "1"} <= set.union(*(set(one.riders) for one in recordings)) <= {"taxi", *BY_LIFT}
    cars = {name for one in recordings for name, kind in zip(one.ids, one.types, strict=True) if kind.kind == "car"}
    assert "taxi#2" in cars  # a person and a car of one name are two


def test_persons_move_as_persons_do(recordings):
    for one in recordings:
        on_foot = np.array([kind.kind == "pedestrian" for kind in one.types])
        assert np.percentile(one.speed[on_foot][one.valid[on_foot]], 99) < 2.0
        assert not one.motor[on_foot].any()


@pytest.mark.slow
def test_a_window_holds_them_and_is_told_whom_it_lacks(town):
    said = []
    found = record_sumo(town, Windows(count=3), tell=said.append)
    assert {agent.kind for case in found for agent in case.agents} == {"car", "pedestrian"}
    assert all(case.ego.kind == "car" for case in found)
    assert all("left out while in a vehicle, on stairs or in a lift" in line for line in said if "person" in line)


@pytest.mark.slow
@pytest.mark.parametrize("name", [slow("log.xml"), slow("all.xml"), "log.csv"])
def test_a_log_gives_the_persons_that_the_run_gives(town, logs, name):
    run = record_sumo(replace(town, ego="flow0"), Windows(count=2, prefer="none"), tell=lambda _: None)
    read = record_fcd(
        logs / name,
        town.net,
        Windows(count=2, prefer="none", ego="flow0"),
        routes_or_types=town.routes,
        tell=lambda _: None,
    )
    for ours, theirs in zip(read, run, strict=True):
        assert ours.provenance.begin_s == theirs.provenance.begin_s
        on_foot = [one for one in theirs.agents if one.kind == "pedestrian" and one.id not in {"taxi", *BY_LIFT}]
        assert len(on_foot) > 3
        assert set(on_foot) <= set(ours.agents)
        for agent in on_foot:
            i, k = ours.agents.index(agent), theirs.agents.index(agent)
            assert (ours.tracks.valid[i] == theirs.tracks.valid[k]).all()
            for field, tolerance in (("x", 1e-5), ("y", 1e-5), ("yaw", 1e-6)):
                seen = getattr(ours.tracks, field)[i], getattr(theirs.tracks, field)[k]
                np.testing.assert_allclose(*seen, atol=tolerance)


@pytest.mark.parametrize("marked", [True, False])
def test_passengers_of_a_log_are_left_out_also_where_it_does_not_say_so(town, tmp_path, marked):
    steps = []
    for step in range(90):
        cars = "".join(
            f'<vehicle id="c{k}" type="car" x="{66 + 12 * k + 0.8 * step:.2f}" y="58.40" angle="90" lane="A0B0_1"/>'
            for k in range(3)
        )
        aboard = ' vehicle="c0"' * marked
        rider = f'<person id="rides" x="{66 + 0.8 * step:.2f}" y="58.40" angle="90"{aboard}/>'
        walker = f'<person id="walks" x="{90 + 0.14 * step:.2f}" y="55.20" angle="90"/>'
        steps.append(f'<timestep time="{step / 10}">{cars}{rider}{walker}</timestep>')
    (tmp_path / "log.xml").write_text(f"<fcd-export>{''.join(steps)}</fcd-export>")
    said = []
    for case in record_fcd(
        tmp_path / "log.xml", town.net, Windows(count=2), routes_or_types=town.routes, tell=said.append
    ):
        assert {agent.id for agent in case.agents} == {"c0", "c1", "c2", "walks"}
    assert ["1 person left out" in line for line in said if "does not say how" not in line] == [True]


@pytest.mark.slow
@pytest.mark.skipif(
    version("libsumo").startswith("1.24."), reason="SUMO 1.24 writes persons with more columns than its header"
)
def test_persons_without_a_place_or_a_known_type(town, logs, tmp_path):
    rows = list(csv.reader((logs / "log.csv").read_text().splitlines(), delimiter=";"))
    x, kind, edge = (rows[0].index(f"vehicle_{name}") for name in ("x", "type", "edge"))  # persons are in these too
    for row in rows[1:]:
        if row[edge]:
            row[kind] = "runner"
            row[x] = "" if float(row[0]) < 40 else row[x]
    (tmp_path / "odd.csv").write_text("\n".join(";".join(row) for row in rows))
    said = []
    record_fcd(tmp_path / "odd.csv", town.net, Windows(count=2), routes_or_types=town.routes, tell=said.append)
    assert any("no vType for runner; taken as persons of 0.215 m x 0.478 m" in line for line in said)
    assert any("persons left out while" in line for line in said)


@pytest.mark.parametrize("size", ["0", slow("-1"), slow("0.01"), slow("inf")])
def test_a_person_without_a_size_is_one_line(town, tmp_path, size):
    routes = tmp_path / "a.rou.xml"
    routes.write_text(
        f'<routes><vType id="flat" vClass="pedestrian" length="{size}"/><person id="a" depart="0" type="flat">'
        '<walk from="A0B0" to="B0right0"/></person></routes>'
    )
    with pytest.raises(SumoError, match="length") as error:
        record_sumo(replace(town, routes=(routes,), additional=(), end_s=4.0), Windows(horizon_s=2.0))
    assert "\n" not in str(error.value)


# --- the map ----------------------------------------------------------------------------------


def test_walkways_are_those_of_the_network(town):
    road = read_road_map(town.net)
    kinds = [one.kind for one in road.walkways]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"sidewalk": 24, "walkingarea": 16, "crossing": 16}
    for one in road.walkways:
        assert one.area.area > 1.0
        if one.kind == "crossing":
            assert one.signal in {"A0", "A1", "B0", "B1"}
    lights = [(one.signal, one.link) for one in road.walkways if one.kind == "crossing"]
    assert len(set(lights)) == len(lights)


def test_a_map_is_the_same_with_walkways_and_without(town):
    road = read_road_map(town.net)
    before = map_files(road)
    assert road.walkways
    assert map_files(replace(road)) == before


@pytest.mark.parametrize("shape", ["0,0 x,1", "0,0 nan,1", "0,0 1e12,1"])
def test_damaged_walkways_are_one_line(shape):
    net = f'<net><edge id="c" function="crossing"><lane id="c_0" width="4" shape="{shape}"/></edge></net>'
    with pytest.raises(InputError, match="expected one as netconvert") as error:
        read_walkways(gzip.compress(net.encode()))
    assert "\n" not in str(error.value)


def test_networks_without_walkways_have_none():
    assert read_road_map(ROOT / "sumo_nets" / "crossing" / "crossing.net.xml").walkways == ()
    assert read_walkways(None) == ()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_persons(town):
    first, again = (record_sumo(town, Windows(count=2, prefer="none"), tell=lambda _: None) for _ in range(2))
    assert [content_hash(case) for case in first] == [content_hash(case) for case in again]
