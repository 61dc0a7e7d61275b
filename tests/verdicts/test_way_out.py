"""The evasion that is shown is the careful driver's own drive, wherever that avoids the crash with room."""

from dataclasses import replace

import numpy as np
import pytest
from avoidable_scenes import braking_lead, standing_car
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from reference_scenes import aside, careful, cut_in
from scenes import DT, crash, scene, straight_road

from regents_cosim.cases.files import load_case
from regents_cosim.collisions import first_contact
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.replays.replay import replay_each
from regents_cosim.reports.drawing.texts.caption import evasion_words, manoeuvre_words
from regents_cosim.saving import save_unlisted
from regents_cosim.verdicts.careful.reference_drivers import careful_answer
from regents_cosim.verdicts.escape.manoeuvres import BANK, manoeuvre_sets
from regents_cosim.verdicts.escape.preference import Preference
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import verdict_words

FOLLOWED = braking_lead(35.4, (-4.6 - 3.0, 0, 15))


def near_miss_m(judged):
    """Whether the evasion touches anyone but followers, with so much more room on every side [m]."""
    left = judged.evaded()
    own = left.tracks

    def touches(margin_m):
        ego = Boxes(own.x[:1], own.y[:1], own.yaw[:1], 4.6 + 2 * margin_m, 1.8 + 2 * margin_m)
        return overlap(ego, Boxes(own.x[1:], own.y[1:], own.yaw[1:], 4.6, 1.8)).any()

    return next((margin for margin in (0.0, 0.1) if touches(margin)), np.inf)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(gap=st.floats(1.0, 30.0), lateral=st.floats(0.4, 2.5), other=st.floats(2.0, 12.0))
def test_where_the_careful_driver_avoids_it_is_in_time_and_the_evasion_is_its_drive(gap, lateral, other):
    made = scene((0, 0, 15), (gap + 4.6, 3.2, other), road=straight_road(2))
    tracks = aside(made, lateral, other)
    assume(first_contact(made.agents, tracks) is not None)
    judged = judge(crash(made, tracks))
    found, (drive, way) = judged.judgement.avoidability, careful_answer(judged)
    assert drive == careful(judged)
    if not drive.avoids:
        assert found.gentlest is None or found.gentlest.driver is None
        return
    assert judged.judgement.escape == "in time"
    assert not judged.judgement.unavoidable
    assert near_miss_m(judged) > 0.0, "the evasion itself touches no one"
    if found.gentlest.driver is None:  # the careful driver swerves past by a hair, the bank does not
        assert drive.shift_m
        assert near_miss_m(judged) == np.inf
        return
    assert found.gentlest.driver == "careful"
    acts = round(drive.acts_s / DT)
    assert found.gentlest.onset_step == acts <= found.last_onset_step
    assert found.perceived_step < acts
    for name in ("x", "y", "yaw", "speed"):
        np.testing.assert_allclose(getattr(judged.evasion, name)[0], getattr(way, name)[:81], atol=1e-9)
        np.testing.assert_array_equal(getattr(judged.evasion, name)[0, :acts], getattr(judged.tracks, name)[0, :acts])


def test_the_words_say_which_driver_and_when():
    judged = judge(cut_in(18.0, 1.0))
    (drive,) = (drive for drive in judged.judgement.drivers if drive.driver == "careful")
    gentlest = judged.judgement.avoidability.gentlest
    how = f"a careful driver (UN R157) brakes from {drive.acts_s:.1f} s"
    assert manoeuvre_words(gentlest, DT) == how
    assert evasion_words(judged.judgement, DT) == ""
    aside = replace(gentlest, shift=-1.8, lateral_accel=-4.0, side="shoulder", onset_step=24)
    said = "a careful driver (UN R157) brakes and swerves 1.8 m to the right onto the shoulder from 2.4 s"
    assert manoeuvre_words(aside, DT) == said


def test_a_bank_that_is_asked_for_is_asked_alone():
    assert judge(cut_in(18.0, 1.0), BANK).judgement.avoidability.gentlest.driver is None


def test_where_the_careful_driver_crashes_too_the_words_say_so():
    judged = judge(standing_car(42.0, straight_road(2))).judgement  # one stops where it would have driven on
    assert "careful" not in judged.preventable_by or judged.avoidability.gentlest.driver == "careful"
    drivers = tuple(replace(drive, avoids=False) for drive in judged.drivers)
    bank = judge(standing_car(42.0, straight_road(2)), BANK).judgement.avoidability
    crashed = replace(judged, drivers=drivers, avoidability=bank)
    assert "A careful driver in the ego's place crashes too." in verdict_words(crashed)
    assert evasion_words(crashed, DT) == f"What avoids it: {manoeuvre_words(bank.gentlest, DT)}."


def test_followers_that_replay_a_log_are_said_and_left_out_of_the_replay():
    judged = judge(FOLLOWED)
    assert judged.judgement.escape == "in time"
    assert judged.judgement.into_evasion == ("car02",)
    said = " A follower that replays its log then hits that car, which does not count."
    assert verdict_words(judged.judgement).endswith(said)
    assert [agent.id for agent in judged.evaded().agents] == ["car00", "car01"]
    (replay,) = replay_each([judged.evaded()], "mirror")
    assert replay.verified, replay.reason
    assert replay.found is None


def test_to_brake_for_a_moment_is_timing_and_no_answer():
    made = braking_lead(40.0)
    preference = Preference(made, made.attack.collision, BANK, 0, 8)
    for manoeuvres in manoeuvre_sets(BANK, made, 10, 81):
        lost = np.array([0.0 if lasting is None else -accel * lasting for accel, lasting in BANK.along])[
            manoeuvres.along
        ]
        brief = (manoeuvres.aside == 0) & (lost > 0.0) & (lost <= 2.0)
        assert brief.any()
        assert not preference.answers(manoeuvres)[brief].any()


def test_the_driver_is_kept_and_older_cases_are_hashed_without_it(tmp_path):
    judged = judge(cut_in(18.0, 1.0))
    read = load_case(save_unlisted(judged, tmp_path))
    assert read.judgement == judged.judgement
    np.testing.assert_array_equal(read.evasion.curvature, judged.evasion.curvature)
    by_bank = judge(cut_in(18.0, 1.0), BANK)
    folder = save_unlisted(replace(by_bank, id="older"), tmp_path)
    text = (folder / "scenario.json").read_text()
    assert '"driver": null' in text
    (folder / "scenario.json").write_text(text.replace(',\n    "driver": null', ""))
    assert load_case(folder).judgement == by_bank.judgement
