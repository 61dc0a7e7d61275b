"""Pedestrians who attack under the law: starts, costs and acceptance ask what the verdict on the host asks."""

from dataclasses import replace

import numpy as np
import pytest
from mirror_drives import driven_in
from scenes import TIME, crash, moved, scene
from walkers import moved_through, walked, zebra

from regents_cosim.attacks.accept.acceptance import ego_contacts, is_clean
from regents_cosim.attacks.accept.lawful import lawful_road, under_the_law
from regents_cosim.attacks.descent.actions import to_controls
from regents_cosim.attacks.descent.costs import road_deviation
from regents_cosim.attacks.descent.driving_limits import with_bounds
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.attacks.starts.timed_drives import followed, starts
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import scene_origin, to_world
from regents_cosim.norms.grades import Conduct
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Signal
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.law.offences import law_of
from regents_cosim.verdicts.ordinary import PEDESTRIAN


def street(x, y, light="", speed=0.0, ego=8.0):
    """An ego to the east, and a person beside the street (y < -1.6 or y > 4.8) that stands or walks along it."""
    signals = (Signal("J", ((0, light),)),) * bool(light)
    made = scene((0, 0, ego), (80, 3.2, 0), road=zebra(light=bool(light)), signals=signals)
    return walked(made, 1, x + speed * TIME, y + 0 * TIME)


def found(made, most=12, lawful=True):
    names = ("x", "y", "yaw", "speed", "valid", "z")
    ego = replace(made.tracks, **{name: getattr(made.tracks, name)[:1] for name in names})
    return starts(made, 1, ego, most, PEDESTRIAN, lawful)


def as_crash(made, start):
    return crash(made, moved(made, 1, x=start.x, y=start.y, yaw=start.yaw, speed=start.speed))


@pytest.mark.slow
def test_starts_keep_the_law():
    rng = np.random.default_rng(0)
    tried = 0
    for light in ("", "rG", "Gr"):
        for _ in range(3):
            made = street(rng.uniform(28, 46), rng.choice([-2.6, 5.8]), light, rng.choice([0.0, 1.2, -1.2]))
            for start in found(made):
                law = law_of(as_crash(made, start))
                assert law.conduct is Conduct.KEEPS_RULES, law.adversary
                assert light != "Gr"
                tried += 1
    assert tried >= 8


@pytest.mark.slow
def test_walks_begin_with_the_heading_that_they_are_seen_with_and_can_be_walked():
    rng, tried = np.random.default_rng(2), 0
    for heading in rng.uniform(-np.pi, np.pi, 6):
        pace = rng.uniform(0.6, 1.8)
        made = street(rng.uniform(28, 46), rng.choice([-2.6, 5.8]))
        gone = pace * TIME
        made = walked(made, 1, made.tracks.x[1] + gone * np.cos(heading), made.tracks.y[1] + gone * np.sin(heading))
        world = with_bounds(to_world(made), made, REGENTS_FOCUSED, {"pedestrian": PEDESTRIAN})
        job = SearchJob(world, None, SearchedAgents.only(1, len(world.valid)))
        some = found(made, lawful=False)
        for start, actions in zip(some, followed(made, job, some, 12), strict=True):
            motion = roll_out_background(world, job.searched.put(world.controls, to_controls(actions)))
            off = np.hypot(motion.x[1] + scene_origin(made)[0] - start.x, motion.y[1] + scene_origin(made)[1] - start.y)
            assert off[: start.meets + 1].max() < 0.3
            tried += 1
    assert tried >= 30


def test_those_come_first_that_are_hit_by_the_front_and_are_not_long_in_the_way():
    for place in (36.0, 40.0):
        made = street(place, 5.8)
        first = found(made)[0]
        across = np.abs(first.y[: first.meets])
        assert first.contact[1] > 2.2
        assert 0.1 * np.sum(across < 1.5) < 1.0


def test_without_the_law_people_cross_anywhere():
    made = street(30.0, 5.8)
    assert any(law_of(as_crash(made, start)).conduct is Conduct.GROSS for start in found(made, lawful=False))


def test_where_the_map_holds_no_crossing_there_is_none_to_keep_to():
    assert lawful_road(replace(street(40.0, 5.8), road=scene((0, 0, 1)).road), 1) is None


@compiled
def _seen(world, driven, searched):
    boxes = world.boxes(driven)
    hits = ego_contacts(world, boxes)
    return is_clean(world, searched, driven, boxes, hits), road_deviation(world, boxes, searched)


@pytest.mark.slow
@pytest.mark.parametrize("jaywalks", [False, True])
def test_the_device_keeps_to_the_ground_of_the_verdict(jaywalks):
    """The pedestrian crosses anywhere at any angle; in the log it stays on its side, or crosses beside the crossing."""
    rng = np.random.default_rng(1)
    made = street(30.0, 5.8)
    if jaywalks:
        made = walked(made, 1, 30.0 + 0 * TIME, 5.8 - 1.4 * np.maximum(TIME - 5.0, 0.0))
    world = to_world(made)
    world = under_the_law(world, made, 1, lawful_road(made, 1))
    searched, verdicts = SearchedAgents.only(1, len(world.valid)), []
    while len(verdicts) < 60:
        way, speed = rng.uniform(-0.75, -0.25) * np.pi, rng.uniform(0.6, 2.4)
        paces = np.clip(TIME - rng.uniform(0.0, 2.0), 0.0, speed)
        gone = np.cumsum(paces) * 0.1
        tracks = moved_through(made, 1, rng.uniform(25, 50) + gone * np.cos(way), 5.8 + gone * np.sin(way))
        if first_contact(made.agents, tracks) is None:
            continue
        hit = crash(made, tracks)
        kept = "off_crossing" not in {offence.name for offence in law_of(hit).adversary}
        accepted, cost = _seen(world, driven_in(world, made, tracks), searched)
        verdicts.append((kept, bool(flaws(hit)), bool(accepted), float(cost)))
    assert not [1 for kept, _, accepted, _ in verdicts if accepted and not kept]
    clean = [(kept, accepted) for kept, spoilt, accepted, _ in verdicts if not spoilt]
    assert any(accepted for _, accepted in clean)
    assert sum(accepted for kept, accepted in clean if kept) >= 0.7 * sum(kept for kept, _ in clean)
    if not jaywalks:
        low, high = ([cost for kept, _, accepted, cost in verdicts if chosen(kept, accepted)] for chosen in _PARTS)
        assert max(low) < np.median(high)
        assert min(high) > 0.0


_PARTS = (lambda kept, accepted: accepted, lambda kept, accepted: not kept)
