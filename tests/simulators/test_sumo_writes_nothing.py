"""SUMO writes nothing where it is recorded, and goes as it would have gone: our runs beside its own."""

import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest
from command import regents
from params import slow
from places import DATA, ROOT
from writing_scenario import WRITTEN, listing, make_scenario, states_of_run

from regents_cosim.live.episodes import Episodes, run_episodes
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.sources.sumo import SumoRecordingJob, record_sumo, sumo_command
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated

GAMES = Path(find_spec("sumo").origin).parent / "tools" / "game" if find_spec("sumo") else None
# What a recording decides itself, where the configuration does not; then SUMO's own run is comparable.
OURS = {"time-to-teleport": "-1", "pedestrian.striping.walkingarea-detail": "32", "lanechange.duration": "3"}


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    """The configuration, and the two folders that have to stay as they are."""
    monkeypatch.setenv("NAMED", "seen")
    (tmp_path / "there").mkdir()
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    return make_scenario(tmp_path / "there")


def test_recording_writes_nothing_and_says_what_it_left_out(scenario, tmp_path):
    for name in WRITTEN[::2]:  # outputs of an earlier run are precious
        (scenario.parent / name).write_text("precious")
    before, said = listing(tmp_path), []
    assert record_sumo(SumoInput(scenario), Windows(count=1), tell=said.append)
    assert listing(tmp_path) == before
    (line,) = [one for one in said if one.startswith("turned off")]
    assert "tripinfo-output" in line
    assert " and " in line


@pytest.mark.slow
def test_the_command_writes_nothing(scenario, tmp_path):
    before = listing(scenario.parent)
    done = regents("record", "-c", scenario, "--count", 1, "-o", tmp_path / "out", cwd=scenario.parent, code=0)
    assert "turned off, so that SUMO writes nothing beside x.sumocfg: " in done.stderr
    assert listing(scenario.parent) == before


def test_sumo_itself_writes_all_of_that(scenario):
    run_isolated(states_of_run, ["-c", str(scenario), "--step-length", "0.1"], 400)
    assert [name for name in WRITTEN if not (scenario.parent / name).exists()] == []
    assert {path.name for path in Path().iterdir()} == {
        "calibrator.xml",
        *(f"ssm_g.{number}.xml" for number in range(4)),
    }


@pytest.mark.slow
def test_live_writes_nothing(scenario, tmp_path):
    before = listing(tmp_path)
    episodes = Episodes(read_input(SumoInput(scenario)), "auto", "idm", attack=False, most_s=3.0)
    (ended,) = run_episodes(episodes, [0])
    assert ended.how in ("time over", "arrived"), ended
    assert listing(tmp_path) == before


# --- the traffic is SUMO's own ---------------------------------------------------------------------


def assert_same_traffic(config: Path, folder: Path, begin_s: float | None = None, steps: int = 300) -> None:
    """SUMO's own run of a copy, and ours of another, which stays as it is."""
    theirs, ours, scratch = folder / "theirs", folder / "ours", folder / "scratch"
    for copy in (theirs, ours):
        shutil.copytree(config.parent, copy, dirs_exist_ok=True)
    scratch.mkdir()
    options = read_input(SumoInput(ours / config.name, begin_s=begin_s, extra=("--random", "false")))
    given = {name: value for name, value in OURS.items() if not options.says(name)}
    if float(options.says("lateral-resolution") or 0.0) > 0.0:
        given.pop("lanechange.duration", None)
    given |= {"step-length": "0.1", "seed": "0", "random": "false", "no-step-log": "true", "no-warnings": "true"}
    given |= {"begin": str(begin_s)} if begin_s is not None else {}
    words = [word for name, value in given.items() for word in (f"--{name}", value)]
    before = listing(ours)
    command = sumo_command(SumoRecordingJob(options, Windows(seed=0)), scratch)
    found = run_isolated(states_of_run, command, steps)
    assert found == run_isolated(states_of_run, ["-c", str(theirs / config.name), *words], steps)
    assert any(vehicles for vehicles, *_ in found)
    assert listing(ours) == before


SHIPPED = ["crossing", *map(slow, ("merge", "signals", "roundabout", "grid", "multilane", "lane_drop", "exit_lane",
                                   "town", "street"))]  # fmt: skip


@pytest.mark.parametrize("name", SHIPPED)
def test_the_traffic_of_the_shipped_networks_is_sumos_own(tmp_path, name):
    assert_same_traffic(ROOT / "sumo_nets" / name / f"{name}.sumocfg", tmp_path)


CITIES = {
    "bologna_acosta/run": None, "bologna_acosta_persontrips/run": None, "mcity/mcity": None,
    "resco_arterial4x4/arterial4x4": None, "resco_cologne1/cologne1": 25200.0, "resco_cologne3/cologne3": 25200.0,
    "wildau/wildau": None,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("city", CITIES)
def test_so_is_that_of_cities(tmp_path, city):
    config = DATA / "sumo" / f"{city}.sumocfg"
    if not config.is_file():
        pytest.skip("no cities (set REGENTS_DATA to their folder)")
    assert_same_traffic(config, tmp_path, CITIES[city])


@pytest.mark.slow
@pytest.mark.skipif(GAMES is None, reason="SUMO's own examples come with the package eclipse-sumo")
@pytest.mark.parametrize("name", ["A10KW", "DRT", "corridor", "fokr_bs_demo", "rail", "ramp", "square"])
def test_so_is_that_of_sumos_own_examples(tmp_path, name):
    assert_same_traffic(GAMES / f"{name}.sumocfg", tmp_path)


@pytest.mark.slow
def test_so_is_that_of_a_scenario_that_would_write(scenario, tmp_path):
    assert_same_traffic(scenario, tmp_path / "both")


DEVICES = '<device.rerouting.probability value="0.5"/><device.rerouting.period value="3"/><scale value="2"/>'


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        '<device.ssm.probability value="0.5"/>',
        '<device.fcd.probability value="0.5"/>',
        '<device.tripinfo.probability value="0.5"/><device.vehroute.probability value="0.5"/>',
        '<device.battery.probability value="0.5"/><battery-output value="b.xml"/>',
        '<battery-output value="b.xml"/><device.stationfinder.probability value="0.7"/>',
        '<device.elechybrid.probability value="0.5"/><elechybrid-output value="e.xml"/>',
        '<precision value="6"/>',
        '<device.emissions.probability value="0.5"/><emission-output value="e.xml"/>',
        '<device.btsender.probability value="0.5"/><device.btreceiver.probability value="0.5"/><bt-output value="b"/>',
    ],
)
def test_devices_are_dealt_out_as_with_all_outputs(scenario, tmp_path, options):
    """Who has one device depends on the dice that were thrown for the others."""
    scenario.write_text(scenario.read_text().replace("</configuration>", f"{DEVICES}{options}</configuration>"))
    assert_same_traffic(scenario, tmp_path / "both", steps=200)
