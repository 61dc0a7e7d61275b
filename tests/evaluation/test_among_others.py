"""Planners scored among others that follow their tracks, and among others that SUMO drives."""

import json
from dataclasses import replace

import pytest
from crossing_scenes import LANE_Y, braking, scenario, straight

from regents_cosim.cli import run
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.evaluation.regression.evaluate import evaluate
from regents_cosim.saving import save_unlisted


def rammed():
    """An ego that brakes hard, and a follower that did not in the log."""
    return scenario(braking("ego", -80.0, 12.0, 8.0), straight("follower", -92.0, LANE_Y, 0.0, 12.0))


@pytest.mark.slow
def test_a_follower_that_sumo_drives_brakes_for_the_ego():
    logged, reacting = (
        evaluate([rammed()], "log_replay", where="sumo", background=background).drives[0]
        for background in ("log", "reactive")
    )
    assert (logged.hits, logged.collision, reacting.hits) == ("follower", False, None)


@pytest.mark.slow
def test_drives_among_others_that_react_are_kept_apart(tmp_path):
    evaluate([rammed()], "log_replay", where="sumo", keep=tmp_path)
    with pytest.raises(CaseError, match="background"):
        evaluate([rammed()], "log_replay", where="sumo", background="reactive", keep=tmp_path)


@pytest.mark.slow
def test_the_command_says_among_whom(tmp_path, capsys):
    case = str(save_unlisted(rammed(), tmp_path))
    words = f"evaluate {case} --planner log_replay --in sumo --background reactive --quiet".split()
    assert run([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["collisions"] == 0
    assert run(words) == 0
    assert "log_replay on 1 case in sumo among traffic that reacts" in capsys.readouterr().out


def test_cases_without_a_network_of_sumo_are_refused():
    from_a_log = replace(rammed(), road=replace(rammed().road, sumo_net=None))
    with pytest.raises(
        RegentsError, match=r"1 of 2 cases have no SUMO network for SUMO to drive in \(the first is made\)"
    ):
        evaluate([rammed(), from_a_log], "log_replay", where="sumo", background="reactive")
