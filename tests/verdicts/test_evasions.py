"""An evasion is the careful driver's own drive, and there is one wherever that driver avoids the crash."""

import jax.numpy as jnp
import numpy as np
import pytest
from avoidable_scenes import braking_lead
from careful_scenes import aside, careful, cut_in
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import DT, crash, scene, straight_road

from regents_cosim.cases.files import load_case
from regents_cosim.mirror.bicycle import ControlArrays, Motion, step
from regents_cosim.norms.grades import Prevention
from regents_cosim.replays.replay import replay_each
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.verdicts.careful.evasion import evaded
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import verdict_words

AVOIDED = (Prevention.PREVENTABLE, Prevention.BY_SWERVING)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(gap=st.floats(1.0, 30.0), lateral=st.floats(0.4, 2.5), other=st.floats(2.0, 12.0))
def test_where_the_careful_driver_avoids_it_the_evasion_is_its_drive(gap, lateral, other):
    made = scene((0, 0, 15), (gap + 4.6, 3.2, other), road=straight_road(2))
    tracks = aside(made, lateral, other)
    assume(first_contact(made.agents, tracks) is not None)
    judged = judge(crash(made, tracks))
    assert (judged.evasion is not None) == (judged.judgement.prevention in AVOIDED)
    if judged.evasion is None:
        assert judged.evades_from is None
        return
    acts = int(careful(judged).acts_s / DT + 1e-6)
    assert judged.evades_from == acts
    for name in ("x", "y", "yaw", "speed"):
        np.testing.assert_array_equal(getattr(judged.evasion, name)[0, :acts], getattr(judged.tracks, name)[0, :acts])
    assert (np.diff(judged.evasion.speed[0, acts:]) <= 1e-9).all(), "it brakes"
    assert first_contact(evaded(judged).agents, evaded(judged).tracks) is None


def test_the_controls_of_an_evasion_lead_along_it():
    evasion = judge(cut_in(18.0, 1.0)).evasion
    states = [getattr(evasion, name)[0] for name in ("x", "y", "yaw", "speed")]
    controls = ControlArrays(jnp.asarray(evasion.accel[0]), jnp.asarray(evasion.curvature[0]))
    then = step(Motion(*(jnp.asarray(values[:-1]) for values in states)), controls, DT)
    for ended, values in zip((then.x, then.y, then.yaw, then.speed), states, strict=True):
        np.testing.assert_allclose(ended, values[1:], atol=1e-3)


def test_what_the_careful_driver_does_not_avoid_has_no_evasion():
    judged = judge(cut_in(1.0, 1.8))
    assert judged.judgement.prevention is Prevention.NOT_PREVENTABLE
    assert judged.evasion is None


@pytest.mark.parametrize(("gap", "named"), [(1.0, ("car02",)), (18.0, ())])
def test_followers_are_left_out_of_the_replay_and_said_if_they_brake_too_late(gap, named):
    judged = judge(braking_lead(35.4, (-4.6 - gap, 0, 15)))
    assert judged.judgement.careful.rear_ended_by == named
    said = " A follower brakes too late and hits that car, which does not count."
    assert verdict_words(judged.judgement).endswith(said) == bool(named)
    assert [agent.id for agent in evaded(judged).agents] == ["car00", "car01"]
    (replay,) = replay_each([evaded(judged)], "mirror")
    assert replay.verified, replay.reason
    assert replay.found is None


def test_an_evasion_is_kept_with_its_case(tmp_path):
    judged = judge(cut_in(18.0, 1.0))
    read = load_case(save_unlisted(judged, tmp_path))
    assert read.judgement == judged.judgement
    np.testing.assert_array_equal(read.evasion.curvature, judged.evasion.curvature)
