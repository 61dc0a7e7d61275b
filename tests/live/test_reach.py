"""Whether a vehicle could meet the ego, asked before its drives are looked for."""

from dataclasses import replace

import pytest
from shipped_cases import shipped_windows

from regents_cosim.attacks.starts.timed_drives import starts
from regents_cosim.live.search.reach import could_meet, near_enough
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.verdicts.ordinary import ordinary

EARLIEST_S = 1.5


def ego_of(made):
    there = made.tracks
    return Tracks(there.x[:1], there.y[:1], there.yaw[:1], there.speed[:1], there.valid[:1])


def asked(made):
    """Of every vehicle that is there at once: whether it could meet the ego, and whether it has a drive that does."""
    ego, limits = ego_of(made), ordinary(made, "car")
    near = near_enough(made, ego, EARLIEST_S, dict.fromkeys({agent.kind for agent in made.agents}, limits))
    for agent in range(1, len(made.agents)):
        if made.tracks.valid[agent, 0]:
            could = bool(near[agent]) and could_meet(made, agent, ego, EARLIEST_S, limits)
            yield could, bool(starts(made, agent, ego, 1, limits))


@pytest.mark.slow
def test_hardly_one_that_has_a_drive_is_left_out_and_most_that_have_none_are():
    windows = [made for network in ("crossing", "grid", "merge") for made in shipped_windows(network)[:2]]
    said = [one for made in windows for one in asked(made)]
    have, lack = ([could for could, has in said if has == wanted] for wanted in (True, False))
    assert sum(have) >= 0.85 * len(have)  # those that meet it after a change of lane further on are not seen
    assert sum(lack) < 0.5 * len(lack)


@pytest.mark.parametrize(("away_m", "near"), [(0.0, True), (200.0, False)])
def test_who_stands_could_meet_the_ego_only_where_that_comes(away_m, near):
    made = shipped_windows("crossing")[0]
    tracks, ego = made.tracks, ego_of(made)
    x, y, speed = tracks.x.copy(), tracks.y.copy(), tracks.speed.copy()
    x[1], y[1], speed[1] = ego.x[0, -1] + away_m, ego.y[0, -1], 0.0
    moved = replace(made, tracks=replace(tracks, x=x, y=y, speed=speed, accel=None, curvature=None))
    limits = dict.fromkeys({agent.kind for agent in made.agents}, replace(ordinary(made, "car"), accel=1.0))
    assert near_enough(moved, ego, EARLIEST_S, limits)[1] == near
