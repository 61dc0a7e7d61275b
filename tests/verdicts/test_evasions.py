"""The evasion that is shown, and proofs that a crash is unavoidable, in hand-made and in random scenes."""

import os
from dataclasses import replace

import numpy as np
import pytest
import shapely
from avoidable_scenes import braking_lead, moved, pushed, standing_car
from scenes import DT, crash, scene, straight_road

from regents_cosim.cases.files import load_case
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.reports.drawing.texts.caption import evasion_words
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario import Signal
from regents_cosim.verdicts.careful.perception import perceived_step, reacts_step
from regents_cosim.verdicts.escape.avoidability import avoidability
from regents_cosim.verdicts.escape.manoeuvres import BANK, manoeuvre_sets
from regents_cosim.verdicts.escape.preference import Preference
from regents_cosim.verdicts.escape.unavoidable import proven_unavoidable, unavoidable
from regents_cosim.verdicts.judge import judge

# What a proof could contradict: begins in the last second.
LATE = replace(BANK, lasting_s=(None,), onsets_s=((1.0, 0.1),))


def two_way(shoulder_m=0.0):
    """One lane each way, the ego's on the right, with a shoulder beside it."""
    ways = {"on": [[-200.0, 0.0], [600.0, 0.0]], "back": [[600.0, 3.2], [-200.0, 3.2]]}
    lanes = tuple(Lane(name, np.array(points), 3.2, 15.0) for name, points in ways.items())
    return RoadMap(lanes, (), shapely.box(-200.0, -1.6 - shoulder_m, 600.0, 4.8))


def shown(attacked):
    found, ego = avoidability(attacked)
    assert found.gentlest is not None
    return found, found.gentlest, ego


def test_to_brake_in_lane_comes_first():
    found, gentlest, _ = shown(braking_lead(40.0, road=straight_road(2)))
    assert found.in_time
    assert (gentlest.shift, gentlest.side, gentlest.runs_red) == (0.0, "own", False)
    assert gentlest.accel < 0.0
    assert gentlest.lasting_s is None


def test_to_swerve_within_the_own_side_comes_next():
    found, gentlest, _ = shown(standing_car(42.0, straight_road(2)))
    assert found.in_time
    assert gentlest.shift > 0.0
    assert gentlest.side == "own"


def test_then_comes_the_shoulder():
    found, gentlest, _ = shown(standing_car(42.0, two_way(shoulder_m=3.0)))
    assert found.in_time
    assert gentlest.shift < 0.0
    assert gentlest.side == "shoulder"


def test_to_stop_in_front_of_one_that_comes_is_no_answer_where_another_is():
    """The adversary drifts over the centre line in the last two seconds; the ego could stop 30 m ahead of it."""
    made = scene((0, 0, 10), (160, 3.2, 10), road=two_way(shoulder_m=3.0))
    time = DT * np.arange(81)
    yaw = np.array(made.tracks.yaw)
    yaw[1] = np.pi + np.where(time > 6.0, 0.1, 0.0)
    tracks = replace(moved(made, 1, x=160 - 10 * time, y=3.2 - np.maximum(time - 6.0, 0.0)), yaw=yaw)
    found, gentlest, _ = shown(crash(made, tracks))
    assert found.in_time
    assert gentlest.shift < 0.0


def test_what_begins_late_and_brakes_gently_comes_first():
    attacked = braking_lead(40.0)
    late = attacked.attack.collision.step - 25
    found, gentlest, _ = shown(attacked)
    assert gentlest.onset_step >= max(late, reacts_step(found.perceived_step, DT))
    assert -4.0 <= gentlest.accel < 0.0


def test_lanes_of_others_come_last_and_are_named():
    judged = judge(standing_car(42.0, two_way()))
    gentlest = judged.judgement.avoidability.gentlest
    assert gentlest.shift > 0.0
    assert gentlest.side == "oncoming"
    assert "into lanes of others" in evasion_words(judged.judgement, DT)


def test_what_begins_before_there_is_anything_to_be_seen_takes_knowledge_ahead():
    judged = judge(standing_car(35.0, straight_road(1)))  # to stop takes 33 m, from the very first step
    assert judged.judgement.escape == "not in time"
    assert judged.judgement.avoidability.gentlest.onset_step == 0
    assert evasion_words(judged.judgement, DT).startswith("Only who knows what comes avoids it: ")


def test_no_evasion_in_time_begins_before_the_reaction():
    attacked = braking_lead(40.0)
    found, gentlest, _ = shown(attacked)
    assert found.perceived_step == 3  # at 6 m/s^2 it is 1.8 m/s slower by then
    assert gentlest.onset_step >= reacts_step(3, DT) == 11


def test_to_drive_on_or_to_brake_less_than_the_ego_did_is_no_answer():
    made = braking_lead(40.0)
    slows = np.maximum(15.0 - 2.0 * DT * np.arange(81), 0.0)
    driven = replace(made, tracks=moved(made, 0, speed=slows))
    preference = Preference(driven, made.attack.collision, BANK, 0, 8)
    for manoeuvres in manoeuvre_sets(BANK, driven, made.attack.collision.step, 81):
        if manoeuvres.onset > made.attack.collision.step - 4:
            continue  # too short to tell
        accel = np.array([BANK.along[along][0] for along in manoeuvres.along])
        lasts = np.array([BANK.along[along][1] is None for along in manoeuvres.along])
        answers = preference.answers(manoeuvres)
        assert not answers[accel > -2.0].any()
        assert answers[(accel <= -2.0) & lasts].all()


def test_a_red_light_is_named():
    """The light ahead turns red after the ego has passed; braking then is too late."""
    lanes = (Lane("in", np.array([[-200.0, 0.0], [30.0, 0.0]]), 3.2, 15.0),
             Lane("out", np.array([[30.0, 0.0], [600.0, 0.0]]), 3.2, 15.0))  # fmt: skip
    road = RoadMap(lanes, (Connection("in", "out", "light", 0),), shapely.box(-200.0, -1.6, 600.0, 1.6))
    made = replace(braking_lead(60.0, road=road), signals=(Signal("light", ((0, "G"), (25, "r"))),))
    preference = Preference(made, made.attack.collision, BANK, 0, 8)
    runs = [
        (manoeuvres, preference.runs_red(manoeuvres))
        for manoeuvres in manoeuvre_sets(BANK, made, made.attack.collision.step, 81)
    ]
    assert any(red.any() for _, red in runs)
    for manoeuvres, red in runs:
        front = manoeuvres.x[:, : 81 - manoeuvres.onset] + 2.3
        before, beyond = front < 28.0, front > 32.0  # a light is known to a metre
        late = np.argmax(beyond, axis=1) + manoeuvres.onset > 25
        assert (beyond.any(axis=1) & late)[red].all()
        waits = before[:, max(26 - manoeuvres.onset, 0)] & beyond.any(axis=1)
        assert red[waits].all()


@pytest.mark.parametrize(
    ("change", "step"),
    [
        ({"y": lambda t: 0.3 * t}, 17),  # 0.5 m off at 1.67 s; 0.375 m from the middle of its lane at 1.25 s
        ({"x": lambda t: 30 + 15 * t - 3 * t**2, "speed": lambda t: 15 - 6 * t}, 3),
        ({}, 0),
    ],
)
def test_a_departure_is_seen_by_place_speed_or_lane(change, step):
    made = scene((0, 0, 25), (30, 0, 15), road=straight_road(1))
    time = np.minimum(DT * np.arange(81), 2.5)
    tracks = moved(made, 1, **{name: values(time) for name, values in change.items()})
    bare = replace(made, road=replace(made.road, lanes=made.road.lanes))
    seen = perceived_step(crash(bare, tracks), 1)
    assert seen == (13 if "y" in change else step)


def test_a_car_that_appears_right_in_front_is_proven_unavoidable():
    made = scene((0, 0, 20), (4.6 + 3.0, 3.2, 5), road=straight_road(3))
    aside = np.maximum(3.2 - 8.0 * DT * np.arange(81), 0.0)
    judged = judge(crash(made, moved(made, 1, y=aside)))
    assert judged.judgement.unavoidable
    assert judged.judgement.escape == "never"
    assert evasion_words(judged.judgement, DT) == "It is proven that nothing avoids it."


def test_the_road_makes_a_proof():
    """Between walls there is no way around a car that stands 8 m ahead; on a field there is."""
    walled, field = (
        standing_car(6.0, straight_road(1)),
        replace(straight_road(1), drivable=shapely.box(-99, -99, 399, 99)),
    )
    assert proven_unavoidable(walled, 0)
    assert not proven_unavoidable(standing_car(35.0, field), 0)
    assert not proven_unavoidable(standing_car(35.0, straight_road(1)), 0)


def contradictions(seeds):
    """Scenes and starts for which a manoeuvre avoids what is proven unavoidable, and how many proofs there were."""
    found, proofs = [], 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        attacked = pushed(seed, rng.uniform(2.0, 30.0), rng.uniform(0.5, 6.0))
        if attacked is None:
            continue
        hit, (verdict, _) = attacked.attack.collision.step, avoidability(attacked, LATE)
        last = -1 if verdict.last_onset_step is None else verdict.last_onset_step
        for since in (max(last, 0), hit - 4, hit - 2):
            proven = 0 <= since < hit and proven_unavoidable(attacked, since)
            proofs += proven
            if proven and last >= since:
                found.append((seed, since))
    return found, proofs


def test_no_proof_contradicts_a_witness():
    found, proofs = contradictions(range(15))
    assert not found
    assert proofs > 0


@pytest.mark.slow
def test_no_proof_contradicts_a_witness_in_many_scenes():
    """Runs 200 random scenes, or $REGENTS_SCENES of them."""
    scenes = int(os.environ.get("REGENTS_SCENES", "200"))
    found, proofs = contradictions(range(scenes))
    assert not found
    assert proofs > 0.1 * scenes


def test_what_older_cases_do_not_say_is_not_hashed(tmp_path):
    judged = judge(braking_lead(40.0))
    read = load_case(save_unlisted(judged, tmp_path))
    assert read.judgement == judged.judgement
    assert (read.judgement.avoidability.in_time, read.judgement.unavoidable) == (True, False)
    assert unavoidable(judged, judged.judgement.avoidability) is False


def test_an_evasion_on_the_own_side_leaves_no_corner_elsewhere():
    _, _, ego = shown(standing_car(42.0, straight_road(2)))
    places = corners(Boxes(ego.x[0], ego.y[0], ego.yaw[0], 4.6, 1.8))
    assert shapely.contains_xy(straight_road(2).drivable.buffer(0.3), places[..., 0], places[..., 1]).all()
