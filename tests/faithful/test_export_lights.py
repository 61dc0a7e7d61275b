"""Lights of a case are in its exports, or these say that they are not."""

import csv
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from command import regents
from params import slow
from shipped_cases import shipped_window

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.exports.export import export
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.scenario import Signal
from regents_cosim.sources.logs.record import scenes_of

CHANGES = ((0, "rrrrGGGgrrrrGGGg"), (20, "rrrryyyyrrrryyyy"), (35, "uuuurrrruuuurrrr"), (42, "GGggrrrrGGggrrrr"))
COLOURS = {"r": "red", "u": "redYellow", "y": "yellow", "g": "green", "G": "green"}
LAMPS = {"r": "on;off;off", "u": "on;on;off", "y": "off;on;off", "g": "off;off;on", "G": "off;off;on"}


@pytest.fixture(scope="module")
def case():
    return replace(shipped_window("signals"), signals=(Signal("centre", CHANGES),))


@pytest.fixture(scope="module")
def written(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lights") / "cr"
    told = []
    export(case, "commonroad", folder, tell=told.append)
    assert told == []
    return folder


def shown(case, step):
    return {(signal.id, link): letter for signal in case.signals for link, letter in enumerate(signal.letters(step))}


def numbers(folder):
    """What the numbers of lights stand for: number, then signal and links."""
    with (folder / "ids.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["what"] == "light"]
    return {row["number"]: (row["id"].split()[0], [int(link) for link in row["id"].split()[1:]]) for row in rows}


@pytest.mark.parametrize("name", ["recorded", slow("planning")])
def test_commonroad_has_every_light_with_what_it_shows(case, written, name):
    ((_, _, found),) = scenes_of(written / f"{name}.xml")
    lights = {light.id: light for light in found.signals}
    stand_for = numbers(written)
    assert set(lights) == set(stand_for)
    assert sorted(link for _, links in stand_for.values() for link in links) == list(range(16))
    steps = np.arange(case.tracks.steps)
    for number, (signal, links) in stand_for.items():
        ours = [COLOURS[case.signals[0].letters(step)[links[0]]] for step in steps]
        assert [COLOURS[letter] for letter in lights[number].shown(steps)] == ours, signal


@pytest.mark.slow
def test_commonroad_io_sees_what_they_show(case, written):
    pytest.importorskip("commonroad", reason="commonroad-io is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from commonroad.common.file_reader import CommonRoadFileReader

        theirs, _ = CommonRoadFileReader(str(written / "recorded.xml")).open()
    stand_for = numbers(written)
    lights = theirs.lanelet_network.traffic_lights
    assert {str(light.traffic_light_id) for light in lights} == set(stand_for)
    for light in lights:
        signal, links = stand_for[str(light.traffic_light_id)]
        for step in range(case.tracks.steps):
            wanted = {COLOURS[shown(case, step)[signal, link]] for link in links}
            assert {light.get_state_at_time_step(step).value} == wanted
    referred = {str(number) for lane in theirs.lanelet_network.lanelets for number in lane.traffic_lights}
    assert referred == set(stand_for)


@pytest.mark.slow
def test_openscenario_has_every_light_with_what_it_shows(case, tmp_path):
    pytest.importorskip("scenariogeneration")
    told = []
    export(case, "openscenario", tmp_path / "os", tell=told.append)
    assert told == []
    (controller,) = ET.parse(tmp_path / "os" / "case.xosc").getroot().iter("TrafficSignalController")
    in_road = {signal.get("id") for signal in ET.parse(tmp_path / "os" / "case.xodr").getroot().iter("signal")}
    begin = 0.0
    for phase in controller.iter("Phase"):
        states = {state.get("trafficSignalId"): state.get("state") for state in phase.iter("TrafficSignalState")}
        expected = {f"{s}_{link}": LAMPS[letter] for (s, link), letter in shown(case, round(begin / case.dt)).items()}
        assert states == expected
        assert set(states) <= in_road
        begin += float(phase.get("duration"))
    assert begin == pytest.approx(case.tracks.steps * case.dt)


@pytest.mark.slow
def test_a_table_says_that_it_has_no_lights(case, tmp_path):
    folder = save_unlisted(case, tmp_path)
    done = regents("export", folder, "--to", "csv", "-o", tmp_path / "out", code=0)
    assert "traffic light left out: centre" in done.stderr
    assert (tmp_path / "out" / "tracks.toml").read_text().startswith("# traffic light left out: centre\n")
    assert list(scenes_of(tmp_path / "out" / "tracks.csv"))


@pytest.mark.parametrize("to", ["fcd", slow("openscenario")])
def test_a_map_without_junctions_says_that_its_lights_are_left_out(case, to, tmp_path):
    if to == "openscenario":
        pytest.importorskip("scenariogeneration")
    elsewhere, told = replace(case, road=replace(case.road, sumo_net=None)), []
    export(elsewhere, to, tmp_path / "out", tell=told.append)
    assert told == [f"{case.id} as {to}: traffic light left out: centre"]
    header = {"fcd": "case.sumocfg", "openscenario": "case.xosc"}[to]
    assert "traffic light left out: centre" in (tmp_path / "out" / header).read_text()


@pytest.mark.slow
def test_lights_of_crossings_are_written_or_said(tmp_path):
    pytest.importorskip("scenariogeneration")
    cases = find_cases(shipped("scenarios") / "on_foot")
    walked = load_case(next(one for one in cases if one.name.startswith("town-")))
    crossings = {f"{one.signal} {one.link}" for one in walked.road.walkways if one.signal and one.kind == "crossing"}
    assert crossings
    told = []
    export(walked, "commonroad", tmp_path / "cr", tell=told.append)
    assert told == []
    assert crossings <= {" ".join(map(str, (signal, *links))) for signal, links in numbers(tmp_path / "cr").values()}
    export(walked, "openscenario", tmp_path / "os", tell=told.append)
    (line,) = told
    assert "traffic lights of crossings left out" in line
    assert "traffic lights of crossings left out" in (tmp_path / "os" / "case.xosc").read_text()
