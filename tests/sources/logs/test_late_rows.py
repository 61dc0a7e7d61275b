"""A row that is centuries late is one more sample: no grid is laid over the time in between, and all else stays."""

import log_files
import numpy as np
import pytest
from places import ROOT

from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.logs.formats import CompanionFiles, formats, read_log
from regents_cosim.sources.logs.record import record_log
from regents_cosim.sources.windows import Windows

LATE_S = 1e10


def same(windows, others):
    assert [(one.id, one.agents) for one in windows] == [(one.id, one.agents) for one in others] != []
    for one, other in zip(windows, others, strict=True):
        for name in ("x", "y", "yaw", "valid"):
            np.testing.assert_array_equal(getattr(one.tracks, name), getattr(other.tracks, name))


@pytest.mark.parametrize("format", [name for name, one in log_files.FORMATS.items() if one.time])
def test_a_late_row_of_a_table_is_one_more_sample(format, tmp_path):
    def scene():
        return next(read_log(path, formats()[format], CompanionFiles()))

    path = log_files.write(format, tmp_path)
    before, windows = scene(), record_log(path, format=format, tell=print)
    log_files.add_late_row(path, format, LATE_S)
    after = scene()
    assert after.duration_s == pytest.approx(LATE_S, rel=1e-6)
    assert sum(len(t.step) for t in after.tracks) == sum(len(t.step) for t in before.tracks) + 1
    same(record_log(path, format=format, tell=print), windows)


def test_a_late_state_of_an_obstacle_is_one_more_sample(tmp_path):
    """Those that stand are there while others move, and lights show what they show."""

    def scene(text):
        path = tmp_path / "scene.xml"
        path.write_text(text)
        return next(read_log(path, formats()["commonroad"], CompanionFiles()))

    parked = (
        '<staticObstacle id="77"><type>car</type><shape><circle><radius>1</radius></circle></shape><initialState><time>'
        "<exact>0</exact></time><position><point><x>1</x><y>9</y></point></position></initialState></staticObstacle>"
    )
    light = (
        '<trafficLight id="5"><cycle><cycleElement><duration>30</duration><color>red</color></cycleElement>'
        "<cycleElement><duration>20</duration><color>green</color></cycleElement></cycle></trafficLight>"
    )
    text = log_files.commonroad().replace("<planningProblem", f"{parked}{light}<planningProblem", 1)
    text = text.replace("</lanelet>", '<trafficLightRef ref="5"/></lanelet>', 1)
    late = round(LATE_S / 0.2)
    state = f"<state><time><exact>{late}</exact></time><position><point><x>9</x><y>2</y></point></position></state>"
    before, after = scene(text), scene(text.replace("</trajectory>", f"{state}</trajectory>", 1))
    steps = [{track.agent.id: track.step.tolist() for track in one.tracks} for one in (before, after)]
    assert steps[1].pop("12") == [*steps[0].pop("12"), late]
    assert steps[1].pop("77") == [*steps[0].pop("77"), late]
    assert steps[0] == steps[1]
    (signal,) = after.signals
    assert "".join(signal.shown(np.array([0, 29, 30, 49, 50, 10**9 + 31]))) == "rrggrg"


def test_a_late_timestep_of_an_fcd_output_is_one_more_instant(tmp_path):
    net, log = ROOT / "sumo_nets" / "crossing" / "crossing.net.xml", tmp_path / "log.xml"
    rows = "".join(
        f'<timestep time="{0.1 * step:.1f}">'
        + "".join(f'<vehicle id="{i}" x="{12 * i + step - 90}" y="-1.7" angle="90"/>' for i in range(4))
        + "</timestep>"
        for step in range(40)
    )
    late = f'<timestep time="{LATE_S:.1f}"><vehicle id="9" x="0" y="0" angle="90"/></timestep>'
    found = []
    for text in (rows, rows + late):
        log.write_text(f"<fcd-export>{text}</fcd-export>")
        found.append(record_fcd(log, net, Windows(horizon_s=1.0, ego="0"), tell=print))
    same(*found)
