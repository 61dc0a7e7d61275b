"""Logged traffic under attack: overlaps that the log holds are nobody's success."""

import json

import log_files
import numpy as np
import pytest
from places import DATA

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS, REGENTS_FOCUSED
from regents_cosim.scenario.collisions import find_overlaps, first_contact
from regents_cosim.sources.logs.record import record_log
from regents_cosim.sources.windows import Windows

EGO, TRAILER, WALKER = "11", "15", log_files.WALKER[0]


def logged(folder, *, ahead_m, speed, others=True):
    """A log whose ego shares its lane with one more car that starts `ahead_m` before it."""
    content = log_files.gpudrive(3)
    ego, *rest = content["objects"]
    way = ahead_m + (speed - log_files.SPEED) * 0.1 * np.arange(len(ego["position"]))
    positions = [{"x": p["x"] + w, "y": p["y"]} for p, w in zip(ego["position"], way, strict=True)]
    kept = rest if others else [one for one in rest if one["type"] == "pedestrian"]
    content["objects"] = [ego, ego | {"id": int(TRAILER), "position": positions}, *kept]
    path = folder / "scene.json"
    path.write_text(json.dumps(content))
    (scenario,) = record_log(path, tell=str)
    assert scenario.ego.id == EGO
    assert any({EGO, TRAILER} == set(one.agents) for one in find_overlaps(scenario.agents, scenario.tracks))
    return scenario


def attacked(scenario, config=REGENTS, planner="log_replay"):
    return next(attack([scenario], config, planner))


@pytest.mark.slow
def test_somebody_who_overlaps_the_ego_from_the_start_is_no_success(tmp_path):
    alone = attacked(logged(tmp_path, ahead_m=-3.0, speed=log_files.SPEED, others=False))
    assert (alone.attack.outcome, alone.collision) == ("no_candidate", None)


@pytest.mark.slow
def test_an_attack_succeeds_by_somebody_who_did_not_overlap_before(tmp_path):
    scenario = logged(tmp_path, ahead_m=-3.0, speed=log_files.SPEED)
    assert first_contact(scenario.agents, scenario.tracks) is None
    found = attacked(scenario).attack
    assert found.outcome == "collision"
    assert found.collision.agent in log_files.CARS
    assert found.iterations > 0


@pytest.mark.slow
def test_a_log_that_runs_somebody_through_the_ego_is_no_success(tmp_path):
    found = attacked(logged(tmp_path, ahead_m=20.0, speed=5.0)).attack
    assert (found.outcome, found.iterations) == ("already_colliding", 0)


FEW = REGENTS_FOCUSED.but(adversaries="one", nearest=3, attempts=1, iterations=20)
SAMPLES = {
    "waymo": "womd/proto", "gpudrive": "womd/json", "scenarionet": "scenarionet",
    "argoverse2_motion": "argoverse2/motion", "argoverse2_sensor": "argoverse2/sensor",
    "interaction": "interaction", "commonroad": "commonroad",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", log_files.FORMATS)
@pytest.mark.parametrize("real", [False, True], ids=["made", "recorded"])
def test_every_kind_is_attacked(tmp_path, name, real):
    path = DATA / SAMPLES.get(name, "none") if real else log_files.write(name, tmp_path)
    if not path.exists():
        pytest.skip(f"no recording of {name} (set REGENTS_DATA to the folder of recordings)")
    (scenario,) = record_log(path, Windows(count=1), tell=str)
    case = attacked(scenario, FEW, "idm")
    assert case.attack.outcome in ("collision", "no_collision", "no_candidate", "already_colliding")
    hit = first_contact(case.agents, case.tracks)
    if case.attack.outcome == "collision":
        assert case.agents[hit[0]].id == case.collision.agent
        assert case.attack.rollouts > 0
    elif case.attack.outcome != "already_colliding":
        assert hit is None
