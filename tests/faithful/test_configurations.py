"""Configurations that others reported: a scene is what SUMO takes them to mean, and their folder stays as it is."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from against_sumo import INPUTS, differing, held

from regents_cosim.exports.export import export
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.logs.record import scenes_of
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

pytestmark = pytest.mark.slow
NET = INPUTS / "04-lateral-resolution-off" / "base.net.xml"
ROUTES = INPUTS / "01-vehicle-gone-after-a-turn" / "base.rou.xml"


def folder_of(name: str, to: Path, net: str = "base.net.xml", routes: str = "base.rou.xml") -> Path:
    """The files of a case in a folder of its own."""
    shutil.copytree(INPUTS / name, to, dirs_exist_ok=True)
    shutil.copyfile(NET, to / net)
    shutil.copyfile(ROUTES, to / routes)
    return to


def windows(config: Path, *extra: str, count: int = 2):
    return record_sumo(SumoInput(config, extra=extra), Windows(count=count, prefer="none"), tell=lambda _: None)


def test_no_sublane_model_is_no_sublane_model(tmp_path):
    config = folder_of("04-lateral-resolution-off", tmp_path / "in") / "lat.sumocfg"
    assert differing(held(config, tmp_path, sumo=("--lanechange.duration", "3"))) == []
    plain = tmp_path / "in" / "plain.sumocfg"
    plain.write_text(config.read_text().replace('<lateral-resolution value="-1"/>', ""))
    ours, theirs = windows(config), windows(plain)
    assert [one.agents for one in ours] == [one.agents for one in theirs]
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one.tracks.x, other.tracks.x)
        np.testing.assert_array_equal(one.tracks.valid, other.tracks.valid)


@pytest.mark.parametrize(("name", "begin_s", "end_s"), [("sect", 20.0, 100.0), ("text", 20.0, 60.0)])
def test_options_count_in_every_section(name, begin_s, end_s, tmp_path):
    found = windows(folder_of("05-options-in-other-sections", tmp_path / "in") / f"{name}.sumocfg")
    assert found
    for case in found:
        assert begin_s <= case.provenance.begin_s
        assert case.provenance.begin_s + (case.tracks.steps - 1) * case.dt <= end_s
        assert name == "text" or len(case.agents) < 53, "of all that --scale 0.4 lets in"


def test_names_of_files_are_those_that_sumo_saves(tmp_path, monkeypatch):
    folder = folder_of("06-paths-as-SUMO-saves-them", tmp_path / "a", "my net.net.xml", "my routes.rou.xml")
    folder_of("06-paths-as-SUMO-saves-them", folder)
    monkeypatch.setenv("TESTNET", "base")
    saved, env = (windows(folder / f"{name}.sumocfg", count=1)[0] for name in ("saved", "env"))
    np.testing.assert_array_equal(saved.tracks.x, env.tracks.x)


def test_nothing_is_written_beside_the_scenario(tmp_path):
    folder = folder_of("07-outputs-written-into-the-folder", tmp_path / "in")
    (folder / "sub" / "edge.xml").write_text("the user's own")
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    assert windows(folder / "inc.sumocfg")
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_the_nine_lights_of_a_grid_are_exported(tmp_path):
    (case,) = windows(INPUTS / "01-vehicle-gone-after-a-turn" / "act.sumocfg", count=1)
    assert len(case.signals) == 9
    export(case, "commonroad", tmp_path / "cr")
    text = (tmp_path / "cr" / "ids.csv").read_text()
    assert all(f",{signal.id} " in text for signal in case.signals)
    ((_, _, found),) = scenes_of(tmp_path / "cr" / "recorded.xml")
    assert len(found.signals) == text.count("light,")
