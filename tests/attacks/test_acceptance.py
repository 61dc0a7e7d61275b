"""What ends a search that looks for clean collisions, and where its later attempts begin."""

import os
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from mirror_drives import driven_in
from scenes import DT, absent, crash, platoon, scene, straight_road

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.accept.acceptance import ego_contacts, is_clean
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent.search_state import decreases_enough, updates_to_wait
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import RegentsError
from regents_cosim.geometry.boxes import Boxes, corners, overlap
from regents_cosim.maps.levels import beyond_road
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.world import _apart_at_first, _corners_on_road, to_world
from regents_cosim.planners.blind import LogReplay
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.verdicts.clean import flaws, touches_in
from regents_cosim.verdicts.leaving_road import corners_leave


@compiled
def accepted(world, driven, searched):
    boxes = world.boxes(driven)
    contacts = ego_contacts(world, boxes)
    return is_clean(world, searched, driven, boxes, contacts), contacts


def random_scene(rng, road):
    """Cars on all lanes of a road that swerve, brake, turn and jump as no search would; the first is the ego."""
    cars = [(0.0, 3.2 * rng.integers(3), rng.uniform(0.0, 12.0))]
    for _ in range(8):
        beside = rng.random() < 0.1
        y = -1.7 - rng.uniform(-0.5, 3.0) if beside else 3.2 * rng.integers(3) + rng.normal(0.0, 0.4)
        cars.append((rng.uniform(-20.0, 60.0), y, rng.uniform(0.0, 14.0)))
    made = scene(*cars, road=road)
    time, tracks = np.linspace(0.0, 1.0, made.tracks.steps), made.tracks
    chosen = [1, *(rng.integers(2, 9, rng.integers(0, 3)))]
    x, y, yaw, speed = (np.array(v) for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed))
    for agent in chosen:
        begin, lasting = rng.uniform(0.0, 0.7), rng.uniform(0.1, 1.0)
        share = np.clip((time - begin) / lasting, 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        aside, along = rng.normal(0.0, 4.0), rng.normal(0.0, 15.0)
        x[agent] += along * share
        y[agent] += aside * share
        way_x, way_y = np.gradient(x[agent]), np.gradient(y[agent])
        yaw[agent], speed[agent] = np.arctan2(way_y, way_x + 1e-3), np.hypot(way_x, way_y) / DT
    return made, replace(tracks, x=x, y=y, yaw=np.unwrap(yaw), speed=speed)


def broken_road(rng):
    """Three lanes with islands on them and bites out of their edges, none too small for the blurred map."""
    road = straight_road()
    area = road.drivable
    for _ in range(8):
        x, y = rng.uniform(-20.0, 120.0), rng.choice([-2.6, 8.0, rng.uniform(-1.0, 7.0)])
        hole = shapely.affinity.rotate(shapely.box(0, 0, *rng.uniform(2.0, 4.0, 2)), rng.uniform(0.0, 90.0))
        area = area - shapely.affinity.translate(hole, x, y)
    return replace(road, drivable=area)


def both_verdicts(seed, roads, crashes):
    """What the host finds, and whether the device accepts, for random crashes on several random roads."""
    rng = np.random.default_rng(seed)
    ends = ((0.0, 0.0, 20.0), (-80.0, -40.0, 0.0), (300.0, 50.0, 0.0), *((200.0, 3.2, 0.0),) * 6)
    for _ in range(roads):
        base = scene(*ends, road=broken_road(rng))
        world, found = to_world(base), 0
        while found < crashes:
            made, tracks = random_scene(rng, base.road)
            contact = first_contact(made.agents, tracks)
            if contact is None or (np.array_equal(tracks.y[contact[0]], made.tracks.y[contact[0]]) and found % 8):
                continue  # few of those that the attack has nothing to do with
            log = driven_in(world, base, made.tracks)
            extra = (0, len(world.valid) - len(made.agents))
            apart, on_road = np.pad(_apart_at_first(made), extra), np.pad(_corners_on_road(made), ((0, 0), extra))
            here = replace(world, log=log, apart=jnp.asarray(apart), on_road=jnp.asarray(on_road))
            searched = SearchedAgents.only(contact[0], world.valid.shape[0])
            clean, hits = accepted(here, driven_in(world, base, tracks), searched)
            if int(np.argmax(np.asarray(hits).any(axis=0))) == contact[1] and bool(hits[contact]):
                found += 1
                yield crash(made, tracks), bool(clean)


def adversarys_box(case):
    """The row of the adversary and its boxes up to the contact."""
    step = case.collision.step + 1
    row = case.adversary
    return row, Boxes(*(np.broadcast_to(values, case.tracks.x.shape)[row, :step] for values in case.boxes))


def for_the_device(case, found):
    """The part of the host's findings `found` that the device must see too: at the steps, and near the road."""
    row, box = adversarys_box(case)
    if "off_road" in found:
        began = beyond_road(case.road, corners(box)[0], 0.0)
        found = found if corners_leave(case.road, box) and began.max() < 1.0 else found - {"off_road"}
    if "hits_others" in found:
        others = Boxes(*(np.broadcast_to(values, case.tracks.x.shape)[:, : len(box.x)] for values in case.boxes))
        touched = overlap(box, others).any(axis=1) & ~touches_in(case, case.log)[row]
        found = found if np.delete(touched, (0, row)).any() else found - {"hits_others"}
    return found - {"bystanders_collide"}


def has_room(case):
    """The adversary stays well on the road, and touches nobody in its log."""
    row, box = adversarys_box(case)
    inner = case.road.drivable.buffer(-0.4)
    touched = np.delete(touches_in(case, case.log)[row], row)
    return not touched.any() and shapely.covers(inner, shapely.points(corners(box))).all()


def agree(verdicts):
    """The device accepts nothing that it has to find unclean, and what is clean with some room."""
    verdicts = [(case, set(flaws(case)), accepted) for case, accepted in verdicts]
    assert not [spoilt for case, found, accepted in verdicts if accepted and (spoilt := for_the_device(case, found))]
    clean = [accepted for case, found, accepted in verdicts if not found and has_room(case)]
    assert clean
    assert sum(clean) >= 0.97 * len(clean)


def test_the_device_accepts_what_the_host_calls_clean():
    agree(both_verdicts(0, 1, 80))


@pytest.mark.slow
def test_the_device_accepts_what_the_host_calls_clean_in_hundreds_of_scenes():
    """Runs 400 random scenes, or $REGENTS_SCENES of them."""
    agree(both_verdicts(1, int(os.environ.get("REGENTS_SCENES", "400")) // 200, 200))


@pytest.mark.parametrize("beside_m", [0.0, 3.0])
def test_who_appears_on_top_of_the_ego_is_not_hit_by_it(beside_m):
    """The attack has moved the ego to that place, which is free in the log."""
    made = absent(scene((0.0, 0.0, 10.0), (50.0, beside_m, 10.0)), (1, slice(40)))
    moved = replace(made.tracks, x=made.tracks.x + np.array([[50.0], [0.0]]))
    world = to_world(made)
    _, contacts = accepted(world, driven_in(world, made, moved), SearchedAgents.only(1, len(world.valid)))
    assert first_contact(made.agents, moved) is None
    assert not np.asarray(contacts).any()


@pytest.mark.slow
def test_what_the_search_accepts_is_what_the_exact_boxes_call_clean():
    found = list(attack([platoon(seed=1)], FOCUSED_COST.but(nearest=3), "log_replay"))
    crashes = [spoilt for case in found if (spoilt := flaws(case)) is not None]
    assert crashes
    assert not any(crashes)


@pytest.mark.slow
def test_who_has_no_start_is_searched_from_the_log_alone():
    far = scene((0, 0, 10), (60, 6.4, 10))
    few = REGENTS_FOCUSED.but(iterations=3)
    once, thrice = (next(attack([far], few.but(attempts=n), "log_replay")).attack for n in (1, 3))
    assert (once.outcome, once.iterations) == ("no_collision", 3)
    assert (thrice.outcome, thrice.iterations) == ("no_collision", 6)  # a descent, and a search that samples


def test_at_least_one_attempt_is_made():
    with pytest.raises(RegentsError, match="attempts is 0, expected 1 to 1000"):
        REGENTS_FOCUSED.but(attempts=0)


@pytest.mark.slow
@pytest.mark.parametrize(("near_m", "least", "most"), [(0.0, 10, 500), (4.0, 0, 10)])
def test_a_search_that_stands_still_ends_at_the_end_of_its_patience(near_m, least, most):
    """The adversary is far ahead on the other side of the road and comes no nearer, so its patience is short."""
    far = scene((0, 0, 10), (90, 6.4, 10), (95, 3.2, 10))
    patience = 10
    config = REGENTS_FOCUSED.but(nearest=1, patience=patience, near_m=near_m)
    found = next(attack([far], config, "log_replay")).attack
    distances = found.cost_history["ego"]  # of the last attempt
    assert found.outcome == "no_collision"
    assert least < len(distances) < most
    assert min(distances[-patience:]) > 0.98 * min(distances[:-patience], default=0.0)


def test_who_is_further_away_waits_less():
    config = REGENTS_FOCUSED.but(patience=100, near_m=4.0)
    least = np.array([0.0, 4.0, 8.0, 40.0, np.inf])
    assert updates_to_wait(config, least) == pytest.approx([100, 100, 50, 10, 0])
    assert updates_to_wait(config.but(near_m=0.0), least) == 100


def test_who_is_further_away_has_to_come_down_as_fast_as_it_needs_to_get_near():
    """Coming from 20 m within 500 updates takes 3.2 m per 100 updates; a near adversary needs to gain only 2 %."""
    config = REGENTS_FOCUSED.but(patience=100, near_m=4.0)
    least = np.float32(20.0)
    assert [bool(decreases_enough(config, cost, least, 500)) for cost in (19.37, 19.35)] == [False, True]
    assert [bool(decreases_enough(config, cost, np.float32(4.0), 500)) for cost in (3.93, 3.91)] == [False, True]
    assert bool(decreases_enough(config.but(near_m=0.0), 19.5, least, 500))
    assert bool(decreases_enough(config, 1e4, np.float32(np.inf), 500)), "the first cost is always the least so far"


def test_where_none_samples_patience_is_the_same_everywhere():
    setup = AttackSetup(REGENTS_FOCUSED.but(sampled=0), LogReplay(), "log_replay", None)
    assert setup.with_due_patience().config.steps.near_m == 0.0
    sampling = AttackSetup(REGENTS_FOCUSED, LogReplay(), "log_replay", None)
    assert sampling.with_due_patience() == sampling


def test_patience_is_none_or_some():
    with pytest.raises(RegentsError, match="patience is -1, expected 0 to 100000: iterations without progress, or 0"):
        REGENTS_FOCUSED.but(patience=-1)
