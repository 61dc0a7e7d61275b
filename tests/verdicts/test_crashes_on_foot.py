"""Collisions with pedestrians: which face meets them, what spoils them as a test, and whose fault they are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import TIME, crash, moving, scene
from walkers import moved_through, walked

from regents_cosim.cases.files import load_case
from regents_cosim.norms.grades import Conduct
from regents_cosim.reports.drawing.texts.caption import ending
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.collisions import collision_type_of, first_contact
from regents_cosim.verdicts.behaviour import death_risk
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.law.fault import fault
from regents_cosim.verdicts.law.offences import law_of


def crossing(at_m, speed=1.4, ego=10.0, waits_s=0.0, stands_at=None, from_y=-5.0):
    """An ego that goes straight on at `ego` m/s, and a pedestrian, at rest in the log, that crosses its path."""
    made = walked(scene((0, 0, ego), (80, 0, 0)), 1, 0 * TIME + at_m, 0 * TIME + from_y)
    y = from_y + speed * np.maximum(TIME - waits_s, 0.0)
    y = y if stands_at is None else np.minimum(y, stands_at)
    return crash(made, moved_through(made, 1, 0 * TIME + at_m, y))


def test_a_person_that_crosses_in_front_is_a_clean_crash():
    hit = crossing(36.0)
    assert hit.collision.collision_type == "person_by_front"
    assert flaws(hit) == ()


def test_a_person_that_runs_into_the_side_of_the_ego_is_none():
    hit = crossing(26.0, waits_s=0.0)
    assert hit.collision.collision_type == "person_by_side"
    assert flaws(hit) == ("into_side",)


def test_a_person_that_just_stands_there_is_none():
    assert "person_stood" in flaws(crossing(50.0, stands_at=0.0))
    assert "person_stood" not in flaws(crossing(36.0))


def test_a_side_that_swings_into_a_person_is_the_egos_doing():
    """The ego drifts sideways into a pedestrian that walks beside it."""
    made = walked(scene((0, 0, 3), (1, 0, 0)), 1, 1.0 + 1.5 * TIME, 0 * TIME + 2.0)
    drifts = moved_through(made, 0, 3.0 * np.minimum(TIME, 2.0) + 1.5 * np.maximum(TIME - 2.0, 0.0), 0.4 * TIME)
    beside = replace(made, tracks=drifts)
    hit = crash(made, moved_through(beside, 1, 3.0 + 1.5 * TIME, 0 * TIME + 2.0 + 1e-2 * TIME))
    assert hit.collision.collision_type == "person_by_side"
    assert "into_side" not in flaws(hit)


def test_a_person_that_walks_into_the_rear_whichever_way_it_faces():
    made = walked(scene((10, 0, 1), (0, 0, 0)), 1, 4.0 + 0 * TIME, 0 * TIME)
    hit = crash(made, moved_through(made, 1, 4.0 + 2.0 * TIME, 0 * TIME))
    assert "rear_ends_ego" in flaws(hit)
    assert "rear_ends_ego" in flaws(moving(hit, 1, yaw=hit.tracks.yaw[1] + np.pi))


def test_a_person_that_moves_as_no_one_does():
    assert "beyond_walking" in flaws(crossing(40.0, speed=4.0, waits_s=2.5))
    assert "beyond_walking" not in flaws(crossing(36.0, speed=1.4))


@settings(max_examples=40)
@given(st.floats(-np.pi, np.pi), st.floats(0.5, 3.0), st.integers(0, 1000))
def test_the_kind_does_not_depend_on_where_a_person_looks_or_on_the_frame(looks, speed, seed):
    rng = np.random.default_rng(seed)
    made = walked(scene((0, 0, 10), (80, 0, 0)), 1, 0 * TIME + 25.0, 0 * TIME - 4.0)
    way = rng.uniform(0.0, np.pi)
    x, y = (
        25.0 + rng.uniform(-5, 5) + speed * np.cos(way) * TIME, -3.0 + rng.uniform(-1, 1) + speed * np.sin(way) * TIME,
    )  # fmt: skip
    tracks = moved_through(made, 1, x, y)
    contact = first_contact(made.agents, tracks)
    if contact is None:
        return
    kind = collision_type_of(made.agents, tracks, *contact)
    cos, sin = np.cos(looks), np.sin(looks)
    turned = replace(
        tracks, x=cos * tracks.x - sin * tracks.y, y=sin * tracks.x + cos * tracks.y, yaw=tracks.yaw + looks
    )
    assert collision_type_of(made.agents, turned, *contact) == kind


@pytest.mark.parametrize(("km_h", "percent"), [(30.0, 1.5), (50.0, 8.3), (75.0, 46.3)])
def test_how_deadly_an_impact_is(km_h, percent):
    assert 100.0 * death_risk(km_h / 3.6) == pytest.approx(percent, abs=0.1)


def test_a_picture_says_how_deadly_it_is():
    assert ending("collision", crossing(36.0).collision)[-1] == "deadly for 1 % of pedestrians"
    assert "deadly" not in ending("collision", crossing(26.0).collision)[-1]


def test_a_judgement_keeps_how_deadly_it_is(tmp_path):
    judged = judge(crossing(36.0))
    assert judged.judgement.death_risk == pytest.approx(death_risk(5.0), abs=1e-4)
    kept = load_case(save_unlisted(judged, tmp_path))
    assert kept.judgement.death_risk == judged.judgement.death_risk
    assert judge(crossing(26.0)).judgement.death_risk is None


# --- law and fault -------------------------------------------------------------------------------


def test_the_law_of_pedestrians_is_not_known_without_crossings():
    found = law_of(crossing(36.0))
    assert found.conduct is Conduct.UNKNOWN
    assert "off_crossing" in found.unknown
    assert found.adversary == ()


@pytest.mark.parametrize(
    ("hit", "rule", "blamed"),
    [
        (crossing(36.0), "unclear", "nobody"),  # without crossings no one knows
        (crossing(26.0), "into_side", "adversary"),
        (crossing(50.0, stands_at=0.0), "standing", "ego"),
    ],
)
def test_fault(hit, rule, blamed):
    found = fault(hit)
    assert (found.rule, found.at_fault) == (rule, blamed), found.reason
