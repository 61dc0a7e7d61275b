from dataclasses import replace

import numpy as np
import pytest
from scenes import crash, scene

from regents_cosim.errors import ScenarioError
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.judgement import Judgement, ReferenceDrive
from regents_cosim.scenario.scenario import Agent, Overlap, Signal, Tracks

CARS = ((0.0, 0.0, 10.0), (20.0, 0.0, 8.0), (20.0, 3.2, 8.0))


def tracks_with(**changes) -> Tracks:
    return replace(scene(*CARS).tracks, **changes)


def test_arrays_cannot_be_written():
    with pytest.raises(ValueError, match="read-only"):
        scene(*CARS).tracks.x[0, 0] = 1.0


def test_arrays_are_copied():
    mine = np.zeros((2, 3))
    tracks = Tracks(mine, mine, mine, mine, np.ones((2, 3), bool))
    mine[0, 0] = 7.0
    assert tracks.x[0, 0] == 0.0


@pytest.mark.parametrize("name", ["x", "y", "yaw", "speed"])
def test_a_number_that_is_not_finite_is_named(name):
    bad = np.array(getattr(scene(*CARS).tracks, name))
    bad[1, 5] = np.nan
    with pytest.raises(ScenarioError, match=f"{name} is not finite at agent 1, step 5"):
        tracks_with(**{name: bad})


def test_arrays_of_different_shapes_are_refused():
    with pytest.raises(ScenarioError, match=r"yaw has shape \[3, 80\], expected \[3, 81\]"):
        tracks_with(yaw=np.zeros((3, 80)))


def test_a_negative_speed_is_refused():
    with pytest.raises(ScenarioError, match="speed is negative"):
        tracks_with(speed=-np.ones((3, 81)))


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_sizes_are_positive(size):
    with pytest.raises(ScenarioError, match="expected a positive number"):
        Agent("a", "car", size, 2.0)


def test_the_ego_is_there_throughout():
    valid = np.ones((3, 81), bool)
    valid[0, 40] = False
    with pytest.raises(ScenarioError, match="absent at step 40"):
        scene(*CARS, tracks=tracks_with(valid=valid))


def test_the_ego_comes_first_and_ids_increase():
    agents = scene(*CARS).agents
    with pytest.raises(ScenarioError, match="ego first"):
        scene(*CARS, agents=(agents[1], agents[0], agents[2]))
    with pytest.raises(ScenarioError, match="increasing ids"):
        scene(*CARS, agents=(agents[0], agents[2], agents[1]))
    with pytest.raises(ScenarioError, match="occurs twice"):
        scene(*CARS, agents=(replace(agents[0], id="car01"), agents[1], agents[2]))


def test_as_many_tracks_as_agents():
    with pytest.raises(ScenarioError, match="tracks of 3 agents, expected 2"):
        scene(*CARS, agents=scene(*CARS).agents[:2])


@pytest.mark.parametrize("dt", [0.0, -0.1, np.nan])
def test_dt_is_positive(dt):
    with pytest.raises(ScenarioError, match="dt is"):
        scene(*CARS, dt=dt)


def test_an_attacked_scenario_keeps_its_log():
    with pytest.raises(ScenarioError, match="keeps its log"):
        scene(*CARS, attack=AttackRecord("scene", "king", "idm", "no_collision", 3))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"agent": "another"}, "collision is with 'another', expected one of the road users"),
        ({"agent": "ego"}, "collision is with 'ego', expected one of the road users"),
        ({"step": 81}, "collision is at step 81, expected 0 to 80"),
        ({"step": -1}, "collision is at step -1, expected 0 to 80"),
    ],
)
def test_a_collision_is_with_another_road_user_and_within_the_tracks(change, said):
    crashed = crash(scene(*CARS))
    with pytest.raises(ScenarioError, match=said):
        replace(crashed, attack=replace(crashed.attack, collision=replace(crashed.attack.collision, **change)))


def test_before_attack_gives_the_recording_back():
    recorded = scene(*CARS)
    agents = (recorded.agents[0], replace(recorded.agents[1], role="adversary"), recorded.agents[2])
    bent = replace(
        recorded,
        agents=agents,
        tracks=tracks_with(y=recorded.tracks.y + 1.0),
        attack=AttackRecord("scene", "king", "idm", "no_collision", 3),
        log=recorded.tracks,
    )
    back = bent.before_attack()
    assert back.tracks is recorded.tracks
    assert back.agents == recorded.agents
    assert back.attack is None


def test_a_signal_shows_what_it_last_changed_to():
    light = Signal("tls", ((0, "rG"), (30, "yr"), (60, "Gr")))
    assert [light.letters(k) for k in (0, 29, 30, 80)] == ["rG", "rG", "yr", "Gr"]
    with pytest.raises(ScenarioError, match="increasing steps from 0"):
        Signal("tls", ((5, "r"),))
    with pytest.raises(ScenarioError, match="different numbers of lights"):
        Signal("tls", ((0, "r"), (5, "rr")))


def test_an_evasion_is_the_drive_of_a_careful_driver_that_avoids_the_collision():
    case = scene(*CARS)
    ego = Tracks(*(getattr(case.tracks, name)[:1] for name in ("x", "y", "yaw", "speed", "valid")))
    avoids, crashes = (Judgement((), drivers=(ReferenceDrive("careful", of, 1.0, 2.1),)) for of in (True, False))
    assert replace(case, judgement=avoids, evasion=ego).evades_from == 21
    assert replace(case, judgement=avoids).evades_from is None
    for judgement in (crashes, Judgement(()), None):
        with pytest.raises(ScenarioError, match="only a collision that the careful driver avoids has an evasion"):
            replace(case, judgement=judgement, evasion=ego)
    with pytest.raises(ScenarioError, match="expected the ego alone"):
        replace(case, judgement=avoids, evasion=case.tracks)


def test_nothing_speaks_of_an_agent_that_was_left_out():
    made = scene((0, 0, 10), (20, 3.2, 9), (40, 0, 10), overlaps=(Overlap(("car01", "car02"), 10, 20),))
    record = AttackRecord("scene", "regents", "idm", "no_collision", 5, candidates=("car01", "car02"))
    part = replace(made, attack=record, log=made.tracks).keeping(np.array([True, False, True]))
    assert [agent.id for agent in part.agents] == ["car00", "car02"]
    assert part.overlaps == ()
    assert part.attack.candidates == ("car02",)
    assert np.array_equal(part.log.x, made.tracks.x[[0, 2]])
