"""Harmless neighbours of crashes, and the rank of planners that they keep honest."""

from dataclasses import replace

import numpy as np
import pytest
from regression_cases import cuts_in, follows, pushes

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import suite_folder
from regents_cosim.cases.suite import load_suite, suite_cases
from regents_cosim.evaluation.drives.driving import drive_each, driving_row, score
from regents_cosim.evaluation.suites.cards import card, card_of
from regents_cosim.evaluation.suites.harmless import harmless_neighbour
from regents_cosim.evaluation.suites.ranking import rank_rows
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.saving import save_unlisted


@pytest.fixture(scope="module")
def neighbour():
    with MirrorController("careful") as careful:
        return harmless_neighbour(pushes(), careful)


@pytest.mark.slow
def test_a_careful_driver_passes_with_room_and_gets_on(neighbour):
    drive = score(neighbour, neighbour.tracks)
    assert drive.hits is None
    assert drive.min_gap_m >= 1.0
    assert (np.diff(neighbour.tracks.speed[0]) / neighbour.dt).min() >= -3.01
    assert drive.completion == pytest.approx(neighbour.attack.careful_completion, abs=1e-3)
    assert not drive.held_up
    assert neighbour.id == "pushes-harmless"


@pytest.mark.slow
def test_it_is_the_nearest_to_the_crash_that_is_harmless(neighbour):
    """With a quarter more of the attack left the careful driver has less than a metre, brakes hard, or crashes."""
    share = neighbour.attack.settings["harmless_share"]
    assert share in (0.0, 0.25, 0.5)
    with MirrorController("careful") as careful:
        assert harmless_neighbour(pushes(), careful).attack == neighbour.attack


@pytest.mark.slow
def test_it_says_so_on_its_card_and_on_disk(neighbour, tmp_path):
    again = load_case(save_unlisted(neighbour, tmp_path))
    assert content_hash(again) == content_hash(neighbour)
    found = card(again, "")
    assert (found.collision_type, found.adversary, found.telling) == ("harmless", None, None)
    assert "harmless neighbour" in found.adversary_in_words
    assert card(pushes(), "").collision_type == "side_swipe"


@pytest.mark.slow
def test_who_stands_is_held_up_in_harmless_cases_alone(neighbour):
    """A planner that never moves crashes nowhere, and is no better for it."""
    tracks = neighbour.tracks
    still = replace(
        tracks,
        **{name: _row_held(getattr(tracks, name)) for name in ("x", "y")},
        speed=_row_held(tracks.speed, to=0.0),
    )
    held = score(neighbour, still)
    assert held.hits is None
    assert held.held_up
    row = driving_row("all", [held, score(follows(), follows().tracks)])
    assert (row.n, row.harmless_cases, row.held_up) == (2, 1, 1)


def _row_held(values, to=None):
    held = values.copy()
    held[0] = held[0, 0] if to is None else to
    return held


@pytest.mark.slow
def test_a_rank_compares_each_planner_with_the_one_before():
    """A cut-in that IDM brakes for and one that nobody gets away from."""
    cases = [cuts_in("late", behind_leader=10.5, begin_s=4.0), pushes(), follows()]
    planners = ("idm", "idm:time_headway=0.2", "constant_velocity")
    rows = rank_rows([(name, list(drive_each(cases, name))) for name in planners])
    assert [row.planner for row in rows] == list(planners)
    assert rows[0].p_value is None
    for row, before in zip(rows[1:], rows, strict=False):
        assert row.crashes - before.crashes == row.only_this - row.only_before
        assert 0.0 < row.p_value <= 1.0
    assert rows[0].crashes < rows[1].crashes


@pytest.mark.slow
def test_the_standard_suite_separates_the_ladder_it_was_made_with():
    cases = load_suite(suite_folder("standard"))
    ladder = ("careful", "idm", "idm:time_headway=0.2", "constant_velocity")
    rows = rank_rows([(name, list(drive_each(cases, name))) for name in ladder])
    assert (rows[0].crashes, rows[0].held_up) == (0, 0)
    assert all(row.crashes > before.crashes for row, before in zip(rows[1:], rows, strict=False))
    assert all(rows[k].p_value < 0.05 for k in (1, 3))  # two planners of the same kind differ in few of its cases


@pytest.mark.parametrize("suite", ["standard", "on_foot"])
def test_every_crash_of_a_suite_has_its_grades_and_a_harmless_neighbour(suite):
    folder = suite_folder(suite)
    cards = [card_of(folder / name) for name in suite_cases(folder)]
    crashes = [one for one in cards if one.collision_type not in ("ordinary", "harmless")]
    assert crashes
    assert all(one.clean and one.telling is not None for one in crashes)
    assert 4 * sum(one.flawless is not None for one in crashes) >= 3 * len(crashes)
    assert 4 * sum(one.telling for one in crashes) >= 3 * len(crashes)
    assert any(one.flawless for one in crashes)
    assert {f"{one.case}-harmless" for one in crashes} == {
        one.case for one in cards if one.collision_type == "harmless"
    }
