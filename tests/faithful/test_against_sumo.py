"""What is recorded of SUMO's traffic is what SUMO's own log says of the same run, to a centimetre."""

import os
import re
import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from made_networks import MADE, make_network
from params import slow
from places import ROOT

from regents_cosim.cases.files import load_case, save_unlisted
from regents_cosim.errors import NoWindowError
from regents_cosim.sources.comparison import compare_with_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.sumo_config import SumoInput

REGENTS = Path(sys.executable).with_name("regents")
INPUTS = Path(__file__).parent / "inputs"
DATA = Path(os.environ.get("REGENTS_DATA", ROOT.parent / "shared" / "data")) / "sumo"
SEED = 3
USUAL = ("--lanechange.duration", "3")
SAME_M, SAME_DEG = 0.01, 0.1


def own_log(config: Path, folder: Path, sumo: tuple[str, ...], until_s: float | None = None) -> Path:
    """SUMO's fcd-output of a run of the configuration, and beside it what its lights show."""
    import sumo as wheel

    log, additional = folder / "own.fcd.xml", folder / "lights.add.xml"
    additional.write_text(f'<additional><timedEvent type="SaveTLSStates" dest="{lights_of(log)}"/></additional>')
    named = ElementTree.parse(config).getroot().find(".//additional-files")
    files = [] if named is None else [str(config.parent / name) for name in re.split("[, ]+", named.get("value", ""))]
    taken = {word for word in sumo if word.startswith("--")}
    taken |= {"--lateral-resolution"} & {f"--{option.tag}" for option in ElementTree.parse(config).getroot().iter()}
    usual = USUAL if not taken & {"--lateral-resolution", "--lanechange.duration"} else ()
    words = [
        str(Path(wheel.SUMO_HOME) / "bin" / "sumo"), "-c", str(config), "--step-length", "0.1", "--seed", str(SEED),
        *(("--time-to-teleport", "-1") if "--time-to-teleport" not in taken else ()),
        "--random", "false", "--pedestrian.striping.walkingarea-detail", "32", *usual, *sumo,
        "--fcd-output", str(log), "--precision", "6",
        "--additional-files", ",".join([*files, str(additional)]), "--no-step-log", "--no-warnings",
        *(("--end", str(until_s)) if until_s is not None else ()),
    ]  # fmt: skip
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return log


def lights_of(log: Path) -> Path:
    return log.with_name("lights.xml")


def assert_same_lights(found, log: Path):
    """Each light of a case at every step, against what SUMO saved."""
    shown = defaultdict(dict)
    if not lights_of(log).exists():  # SUMO writes none where there are no lights
        assert not any(case.signals for case in found)
        return
    for state in ElementTree.parse(lights_of(log)).getroot().iter("tlsState"):
        shown[state.get("id")][round(10 * float(state.get("time")))] = state.get("state")
    compared = 0
    for case in found:
        for signal in case.signals:
            for step in range(case.tracks.steps):
                at = round(10 * case.provenance.begin_s) + step
                if at in shown[signal.id]:
                    assert signal.letters(step) == shown[signal.id][at], (case.id, signal.id, step)
                    compared += 1
    assert compared or not any(case.signals for case in found)


def assert_faithful(config: Path, folder: Path, sumo: tuple[str, ...] = (), count: int = 2, end_s: float | None = None):
    found = record_sumo(
        SumoInput(config, end_s=end_s, extra=sumo), count=count, seed=SEED, prefer="none", tell=lambda _: None
    )
    log = own_log(config, folder, sumo, end_s)
    compared = compare_with_fcd(found, log)
    for case, one in zip(found, compared, strict=True):
        assert one.unexplained(case) == {}
        assert one.compared > 0
        assert one.farthest_m <= SAME_M, one
        assert one.most_turned_deg <= SAME_DEG, one
    assert_same_lights(found, log)
    return found, log


@pytest.mark.parametrize("name", ["01-vehicle-gone-after-a-turn", "03-no-internal-links"])
def test_small_files_that_others_reported(name, tmp_path):
    (config,) = (INPUTS / name).glob("*.sumocfg")
    assert_faithful(config, tmp_path)


@pytest.mark.parametrize(
    "name",
    [
        "crossing",
        *map(slow, ("merge", "signals", "roundabout", "grid", "multilane", "lane_drop", "exit_lane", "town", "street")),
    ],
)
def test_shipped_networks(name, tmp_path):
    assert_faithful(ROOT / "sumo_nets" / name / f"{name}.sumocfg", tmp_path, end_s=120.0)


@pytest.mark.parametrize("name", ["two lanes, actuated", *(slow(one) for one in MADE if one != "two lanes, actuated")])
def test_networks_over_a_grid_of_options(name, tmp_path):
    made = MADE[name]
    try:
        assert_faithful(make_network(made, tmp_path), tmp_path, made.sumo)
    except NoWindowError:
        pytest.skip("no window: no vehicle of this traffic may be the ego")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["A10KW", "cross", "grid6", "square", "ramp", "corridor", "DRT", "fkk_in"])
def test_games_of_sumo(name, tmp_path):
    import sumo as wheel

    config = Path(wheel.SUMO_HOME) / "tools" / "game" / f"{name}.sumocfg"
    if not config.is_file():
        pytest.skip(f"this version of SUMO has no {config.name}")
    try:
        assert_faithful(config, tmp_path, end_s=120.0)
    except NoWindowError:
        pytest.skip("no window: no vehicle of this traffic may be the ego")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        *("bologna_acosta", "bologna_acosta_persontrips", "mcity", "wildau"),
        *("resco_arterial4x4", "resco_cologne1", "resco_cologne3"),
    ],
)
def test_cities(name, tmp_path):
    configs = sorted((DATA / name).glob("*.sumocfg"))
    if not configs:
        pytest.skip(f"no {DATA / name} (REGENTS_DATA names the folder of recordings and cities)")
    begin = ElementTree.parse(configs[0]).getroot().find(".//begin")
    begin_s = float(begin.get("value", 0)) if begin is not None else 0.0
    assert_faithful(configs[0], tmp_path, end_s=begin_s + 120.0)


def regents(*words):
    return subprocess.run([REGENTS, *map(str, words)], capture_output=True, text=True, timeout=120)


@pytest.mark.slow
def test_inspect_finds_a_missing_vehicle_unless_the_case_says_so(tmp_path):
    config = INPUTS / "11-more-than-64-around" / "jam.sumocfg"
    options = ("-c", config, "--count", "1", "--seed", SEED, "--prefer", "none", "--end", "100", "--begin", "70")
    told = regents("record", *options, "--max-agents", "20", "-o", tmp_path / "few")
    assert "beyond --max-agents" in told.stderr
    (case,) = (one.parent for one in (tmp_path / "few").glob("*/scenario.json"))
    log = own_log(config, tmp_path, ("--begin", "70"), 100.0)
    fine = regents("inspect", case, "--against", log)
    assert fine.returncode == 0, fine.stderr
    assert "road users beyond --max-agents (the nearest comes to " in fine.stderr
    loaded = load_case(case)
    assert len(loaded.agents) == 20
    silent = replace(loaded, provenance=replace(loaded.provenance, left_out=()))
    save_unlisted(silent, tmp_path / "silent")
    found = regents("inspect", tmp_path / "silent", "--against", log)
    assert found.returncode == 1
    assert "which the case does not say" in found.stderr


@pytest.mark.slow
def test_inspect_refuses_a_log_of_another_time(tmp_path):
    config = INPUTS / "11-more-than-64-around" / "jam.sumocfg"
    (case,) = record_sumo(SumoInput(config, begin_s=70.0, end_s=100.0), count=1, seed=SEED, tell=lambda _: None)
    save_unlisted(case, tmp_path / "case")
    refused = regents("inspect", tmp_path / "case", "--against", own_log(config, tmp_path, (), 20.0))
    assert refused.returncode == 2
    assert "expected the fcd-output of the run" in refused.stderr
