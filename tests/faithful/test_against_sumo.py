"""What is recorded of SUMO's traffic is what SUMO's own log says of the same run, to a centimetre."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import against_sumo
import pytest
from against_sumo import INPUTS, SEED, NoPlaceError, assert_same_lights, own_log
from made_networks import MADE
from params import slow

from regents_cosim.cases.files import load_case
from regents_cosim.errors import NoWindowError
from regents_cosim.saving import save_unlisted
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

REGENTS = Path(sys.executable).with_name("regents")


def assert_faithful(place, name, folder):
    try:
        found = place(name, folder)
    except NoWindowError:
        pytest.skip("no window: no vehicle of this traffic may be the ego")
    except NoPlaceError as why:
        pytest.skip(str(why))
    assert against_sumo.differing(found) == []
    assert_same_lights(found[0], found[2])


@pytest.mark.parametrize("name", against_sumo.REPORTED)
def test_small_files_that_others_reported(name, tmp_path):
    assert_faithful(against_sumo.reported, name, tmp_path)


@pytest.mark.parametrize("name", [one if one == "crossing" else slow(one) for one in against_sumo.SHIPPED])
def test_shipped_networks(name, tmp_path):
    assert_faithful(against_sumo.shipped_network, name, tmp_path)


@pytest.mark.parametrize("name", [one if one == "two lanes, actuated" else slow(one) for one in MADE])
def test_networks_over_a_grid_of_options(name, tmp_path):
    assert_faithful(against_sumo.made, name, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", against_sumo.GAMES)
def test_games_of_sumo(name, tmp_path):
    assert_faithful(against_sumo.game, name, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", against_sumo.CITIES)
def test_cities(name, tmp_path):
    assert_faithful(against_sumo.city, name, tmp_path)


def regents(*words):
    return subprocess.run([REGENTS, *map(str, words)], capture_output=True, text=True, timeout=120)


@pytest.mark.slow
def test_inspect_finds_a_missing_vehicle_unless_the_case_says_so(tmp_path):
    config = INPUTS / "11-more-than-64-around" / "jam.sumocfg"
    options = ("-c", config, "--count", "1", "--seed", SEED, "--prefer", "none", "--end", "100", "--begin", "70")
    told = regents("record", *options, "--max-agents", "20", "-o", tmp_path / "few")
    assert "beyond `max_agents`" in told.stderr
    (case,) = (one.parent for one in (tmp_path / "few").glob("*/scenario.json"))
    log = own_log(config, tmp_path, ("--begin", "70"), 100.0)
    fine = regents("inspect", case, "--compare-with", log)
    assert fine.returncode == 0, fine.stderr
    assert "road users beyond `max_agents` (the nearest comes to " in fine.stderr
    loaded = load_case(case)
    assert len(loaded.agents) == 20
    silent = replace(loaded, provenance=replace(loaded.provenance, left_out=()))
    save_unlisted(silent, tmp_path / "silent")
    found = regents("inspect", tmp_path / "silent", "--compare-with", log)
    assert found.returncode == 1
    assert "which the case does not say" in found.stderr


@pytest.mark.slow
def test_inspect_refuses_a_log_of_another_time(tmp_path):
    config = INPUTS / "11-more-than-64-around" / "jam.sumocfg"
    (case,) = record_sumo(
        SumoInput(config, begin_s=70.0, end_s=100.0), Windows(count=1, seed=SEED), tell=lambda _: None
    )
    save_unlisted(case, tmp_path / "case")
    refused = regents("inspect", tmp_path / "case", "--compare-with", own_log(config, tmp_path, (), 20.0))
    assert refused.returncode == 2
    assert "expected the fcd-output of the run" in refused.stderr
