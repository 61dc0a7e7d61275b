"""What is recorded of SUMO's traffic is what SUMO's own log says of the same run, to a centimetre."""

from dataclasses import replace

import against_sumo
import pytest
from against_sumo import INPUTS, SEED, NoPlaceError, assert_same_lights, own_log
from comparison import compare_with_fcd
from made_networks import MADE
from params import slow

from regents_cosim.errors import NoWindowError
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows


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


@pytest.mark.slow
def test_a_missing_vehicle_is_found_unless_the_case_says_so(tmp_path):
    config = INPUTS / "11-more-than-64-around" / "jam.sumocfg"
    source, windows = (
        SumoInput(config, begin_s=70.0, end_s=100.0),
        Windows(count=1, seed=SEED, prefer="none", max_agents=20),
    )
    (case,) = record_sumo(source, windows, tell=lambda _: None)
    assert len(case.agents) == 20
    assert "limit" in {one.reason for one in case.provenance.left_out}
    log = own_log(config, tmp_path, ("--begin", "70"), 100.0)
    (found,) = compare_with_fcd([case], log)
    assert found.unexplained(case) == {}
    silent = replace(case, provenance=replace(case.provenance, left_out=()))
    assert found.unexplained(silent)
