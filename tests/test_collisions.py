from dataclasses import replace

import numpy as np
import pytest
from scenes import moved, moving, scene

from regents_cosim.scenario.collisions import (
    collides_since,
    collision_type_of,
    ego_contacts,
    find_overlaps,
    first_contact,
    relative_speed,
)
from regents_cosim.scenario.scenario import Overlap


def turned(scenario, agent, yaw, x, y, speed):
    """`agent` drives straight with `yaw` so that it is at (x, y) at step 40."""
    way = speed * 0.1 * (np.arange(scenario.tracks.steps) - 40)
    return moving(scenario, agent, x=x + way * np.cos(yaw), y=y + way * np.sin(yaw), yaw=yaw, speed=speed)


def contact_kind(scenario):
    agent, step = first_contact(scenario.agents, scenario.tracks)
    return collision_type_of(scenario.agents, scenario.tracks, agent, step)


def test_the_ego_runs_into_a_slower_car():
    found = scene((0, 0, 10), (20, 0, 5))
    # 20 m less one length of 4.6 m, closing at 5 m/s: contact after 3.08 s
    assert first_contact(found.agents, found.tracks) == (1, 31)
    assert contact_kind(found) == "rear_end_by_ego"
    assert relative_speed(found.tracks, 1, 31) == pytest.approx(5)


def test_a_faster_car_runs_into_the_ego():
    assert contact_kind(scene((20, 0, 5), (0, 0, 10))) == "rear_end_by_adversary"


def test_a_car_from_the_side_is_a_t_bone():
    crossing = turned(scene((-40, 0, 10), (0, 50, 8)), 1, -np.pi / 2, 0.0, 0.0, 8.0)
    assert contact_kind(crossing) == "t_bone"


def test_a_car_against_the_ego_is_head_on():
    oncoming = turned(scene((-40, 0, 10), (0, 50, 8)), 1, np.pi, 5.0, 0.3, 8.0)
    assert contact_kind(oncoming) == "head_on"


def test_a_car_that_drifts_into_the_ego_is_a_side_swipe():
    beside = turned(scene((0, 0, 10), (0, 3.2, 10)), 1, -0.05, 40.0, 2.0, 10.0)
    assert contact_kind(beside) == "side_swipe"


def test_no_contact():
    apart = scene((0, 0, 10), (20, 3.2, 5))
    assert first_contact(apart.agents, apart.tracks) is None


def test_agents_that_overlap_from_the_start_do_not_count():
    inside = scene((0, 0, 10), (2, 0, 10), (30, 0, 5))
    assert not ego_contacts(inside.agents, inside.tracks)[1].any()
    assert first_contact(inside.agents, inside.tracks)[0] == 2


def test_absent_agents_do_not_count():
    found = scene((0, 0, 10), (20, 0, 5))
    assert first_contact(found.agents, moved(found, 1, valid=np.arange(81) < 25)) is None


def test_overlaps_of_the_recorded_traffic_are_found_with_their_steps():
    found = scene((0, 3.2, 10), (20, 0, 10), (40, 0, 5))
    # contact after (20 - 4.6) / 5 = 3.08 s, apart again after (20 + 4.6) / 5 = 4.92 s
    assert find_overlaps(found.agents, found.tracks) == (Overlap(("car01", "car02"), 31, 49),)


def test_who_collides_in_the_log_does_so_from_then_on_but_not_who_overlaps_from_its_entry_on():
    made = scene((0, 3.2, 10), (20, 0, 10), (40, 0, 5), (100, 0, 5), (103, 0, 5))
    made = replace(made, overlaps=find_overlaps(made.agents, made.tracks))
    assert collides_since(made).tolist() == [81, 31, 31, 81, 81]
    on_foot = tuple(replace(one, kind="pedestrian") for one in made.agents)
    assert collides_since(replace(made, agents=on_foot)).tolist() == [81] * 5
