"""Where searches begin: drives that meet the ego and keep to the law."""

import itertools
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from crossing_scenes import LANE_Y, Car, road, scenario, straight
from params import slow
from scenes import crash, moved, moving, platoon, scene
from shipped_cases import shipped_window

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.candidates import candidates_of
from regents_cosim.attacks.descent.actions import to_controls
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.engines import by_program
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.attacks.starts.drive_lines import SPACING_M, ContactRange, lines_ahead
from regents_cosim.attacks.starts.marked_lines import marked_lines
from regents_cosim.attacks.starts.meeting import MeetingPair
from regents_cosim.attacks.starts.timed_drives import followed, starts
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import wrap
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import scene_origin, to_world
from regents_cosim.norms.limits import OVER_LIMIT
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.scenario.scenario import Signal, Tracks
from regents_cosim.verdicts.law.lawful_ways import lawful_area, lawful_lanes
from regents_cosim.verdicts.law.offences import law_of
from regents_cosim.verdicts.ordinary import CAR

WINDOWS = ("crossing-1", "signals-1", *map(slow, ("roundabout-1", "merge")))


def ego_of(made):
    return Tracks(*(values[:1] for values in (made.tracks.x, made.tracks.y, made.tracks.yaw, made.tracks.speed)),
                  valid=made.tracks.valid[:1])  # fmt: skip


def nearest(made, count=6):
    away = np.hypot(made.tracks.x - made.tracks.x[0], made.tracks.y - made.tracks.y[0])
    away = np.where(made.tracks.valid, away, np.inf).min(axis=1)
    return np.argsort(away, kind="stable")[1 : count + 1].tolist()


def along(made, agent, start):
    """The tracks of all agents, with `agent` on its start."""
    tracks, there = made.tracks, made.tracks.valid[agent]
    names = ("x", "y", "yaw", "speed")
    rows = {name: np.where(there, getattr(start, name), getattr(tracks, name)[agent]) for name in names}
    return replace(moved(made, agent, **rows), accel=None, curvature=None)


@pytest.fixture(scope="module", params=WINDOWS)
def found(request):
    """A window, and the starts of the vehicles that come nearest to its ego."""
    made = shipped_window(request.param)
    chosen = {agent: starts(made, agent, ego_of(made), 6, CAR) for agent in nearest(made)}
    assert sum(map(len, chosen.values())) > 3
    return made, [(agent, start) for agent, some in chosen.items() for start in some]


def boxes(made, tracks):
    return [np.broadcast_to(values, tracks.x.shape) for values in replace(made, tracks=tracks).boxes]


def test_a_start_meets_the_ego_when_it_says(found):
    made, drives = found
    for agent, start in drives:
        tracks = along(made, agent, start)
        sides = boxes(made, tracks)
        mine = Boxes(*(values[agent] for values in sides))
        hits = overlap(mine, Boxes(*sides)) & tracks.valid & tracks.valid[agent]
        assert int(np.argmax(hits[0])) == start.meets
        assert start.contact[0] == pytest.approx(start.meets * made.dt)


def test_a_start_keeps_to_its_way_and_breaks_no_law(found):
    """Judged by the rules of the verdict, except where the drive begins."""
    made, drives = found
    for agent, start in drives:
        area = lawful_area(made, agent)
        there = made.tracks.valid[agent] & (np.arange(made.tracks.steps) <= start.meets)
        centres = shapely.points(start.x[there], start.y[there])
        assert shapely.distance(area, centres).max() < 0.5
        law = law_of(crash(made, along(made, agent, start)))
        assert not {offence.name for offence in law.adversary} & {"red_light", "speeding", "against_direction"}


def test_a_start_is_driven_as_people_do(found):
    made, drives = found
    for agent, start in drives:
        there = made.tracks.valid[agent]
        x, y, yaw, speed = (values[there] for values in (start.x, start.y, start.yaw, start.speed))
        logged = made.tracks.speed[agent, there]
        limit = max(lane.speed_limit for lane in lawful_lanes(made, agent))
        assert speed.max() <= max(OVER_LIMIT * limit, 1.3 * logged.max(), 1.3 * 4.0) + 1e-6
        accel = np.diff(speed) / made.dt
        begun = (logged[min(3, len(logged) - 1)] - logged[0]) / (3 * made.dt)
        assert accel.max() <= max(CAR.accel, begun) + 1e-6
        assert accel.min() >= min(-CAR.braking, begun) - 1e-6
        for steps in range(1, 11):
            change = np.abs(accel[steps:] - accel[:-steps])[speed[steps + 1 :] > 0.0]  # who stops does so at once
            assert change.max(initial=0.0) <= min(CAR.jerk_at_once * steps * made.dt, CAR.jerk) + 1e-6
        upto = int(start.meets - np.argmax(there))
        sideways = np.abs(np.asarray(wrap(np.diff(yaw)))) / made.dt * 0.5 * (speed[1:] + speed[:-1])
        halves = np.convolve(sideways[:upto], np.full(5, 0.2), "valid")
        assert halves.max() <= CAR.lateral_accel + 1e-6
        assert np.abs(np.hypot(np.diff(x), np.diff(y)) / made.dt - 0.5 * (speed[1:] + speed[:-1])).max() < 0.5
        assert (x[0], y[0]) == pytest.approx((made.tracks.x[agent, there][0], made.tracks.y[agent, there][0]), abs=0.5)
        assert speed[0] == pytest.approx(logged[0])


@compiled
def driven(world, searched, actions):
    return roll_out_background(world, searched.put(world.controls, to_controls(actions)))


@pytest.mark.slow
def test_a_start_can_be_followed(found):
    made, drives = found
    world, origin = to_world(made), scene_origin(made)
    for agent in dict.fromkeys(agent for agent, _ in drives):
        mine = [start for one, start in drives if one == agent]
        job = SearchJob(world, None, SearchedAgents.only(agent, len(world.valid)))
        there = made.tracks.valid[agent]
        for start, actions in zip(mine, followed(made, job, mine, 6), strict=True):
            motion = driven(world, job.searched, actions)
            upto = there & (np.arange(made.tracks.steps) <= start.meets)
            off = np.hypot(motion.x[agent] + origin[0] - start.x, motion.y[agent] + origin[1] - start.y)
            assert off[upto].max() < 0.3


def test_a_change_of_lane_counts_from_where_it_shows():
    """Before that step, the candidate meets the ego even without the change of lane."""
    made, ego, changes = shipped_window("signals"), ego_of(shipped_window("signals")), 0
    for agent in nearest(made):
        pair = MeetingPair.of(made, agent, ego)
        begun = float(made.tracks.speed[agent, pair.first]), 0.0
        for line, touched in marked_lines(made, agent, pair, begun, CAR, earliest_s=1.5):
            assert touched.any()
            assert not touched[: int(line.shows_m / SPACING_M)].any()
            changes += line.shows_m > 0.0
    assert changes


def test_a_line_tells_whether_its_movement_gives_way_to_the_egos():
    """On `crossing` the road from west to east has priority."""
    from_west, from_south = straight("west", -40.0, -1.7, 0.0, 10.0), straight("south", 1.7, -40.0, np.pi / 2, 10.0)
    near = ContactRange.to(np.zeros(1), np.zeros(1), 20.0)
    for ego, other, yields in ((from_west, from_south, True), (from_south, from_west, False)):
        passes = {"x": ego.x + 3.0 * (ego.x - ego.x[0]), "y": ego.y + 3.0 * (ego.y - ego.y[0])}  # through the middle
        ego = replace(ego, **passes)
        lines = list(lines_ahead(scenario(ego, other), 1, near))
        assert lines
        assert {line.yields for line in lines if abs(line.heading[-1] - line.heading[0]) < 0.1} == {yields}


def test_starts_differ_and_the_most_promising_is_first(found):
    _, drives = found
    for (agent, one), (other, two) in itertools.pairwise(drives):
        if agent == other:
            assert one.promise >= two.promise
            assert np.any(np.abs(np.subtract(one.contact, two.contact)) > (0.6, 2.0, np.deg2rad(30.0)))


def test_the_same_starts_are_found_again(found):
    made, drives = found
    agent = drives[0][0]
    again = starts(made, agent, ego_of(made), 6, CAR)
    for one, two in zip([start for of, start in drives if of == agent], again, strict=True):
        assert (one.meets, one.contact, one.promise) == (two.meets, two.contact, two.promise)
        np.testing.assert_array_equal(one.x, two.x)


def at_lights(letter):
    """The ego goes east through a crossing, while another car stands south of it; all lights always show one letter."""
    net = road("signals")
    lights = [link for links in net.exits.values() for link in links if link.signal]
    shown = letter * (1 + max(link.link for link in lights))
    signals = tuple(Signal(name, ((0, shown),)) for name in sorted({link.signal for link in lights}))
    lane = next(lane for lane in net.lanes if lane.id == "south_stop_0")
    (x, y), (x1, y1) = lane.centre[-1] - 12.0 * along_of(lane), lane.centre[-1]
    made = scene((-60, -1.7, 9.0), (x, y, 0.0), road=net, signals=signals)
    return moving(made, 1, yaw=np.arctan2(y1 - y, x1 - x))


def along_of(lane):
    way = lane.centre[-1] - lane.centre[-2]
    return way / np.hypot(*way)


def test_no_start_passes_a_red_light():
    red = at_lights("r")
    passed = {}
    for letter in "rG":
        made = at_lights(letter)
        found = starts(made, 1, ego_of(made), 12, CAR)
        laws = [law_of(replace(crash(made, along(made, 1, start)), signals=red.signals)) for start in found]
        passed[letter] = sum("red_light" in {offence.name for offence in law.adversary} for law in laws)
    assert passed["r"] == 0 < passed["G"]


def test_without_lanes_a_start_is_the_logged_path_at_another_time():
    made = platoon()
    made = replace(made, road=replace(made.road, lanes=()))
    found = [(agent, start) for agent in range(1, 9) for start in starts(made, agent, ego_of(made), 4, CAR)]
    assert found
    for agent, start in found:
        np.testing.assert_allclose(start.y, made.tracks.y[agent], atol=1e-9)
        assert np.abs(start.x - made.tracks.x[agent]).max() > 1.0


class Slower(JaxPlanner):
    """Drives straight on, and slows down from the log's 10 to 5 m/s."""

    def step(self, memory, sight, ego):
        return ControlArrays(jnp.where(ego.speed > 5.0, -2.0, 0.0), jnp.zeros(())), memory


@pytest.mark.slow
@pytest.mark.parametrize(("background", "collides"), [("reactive", False), ("log", True)])
def test_a_follower_that_reacts_to_a_slower_ego_is_no_crash_without_an_attack(background, collides):
    time = 0.1 * np.arange(81)
    there, still = np.ones(81, bool), np.zeros(81)
    ego, follower = (Car(name, x + 10.0 * time, LANE_Y + still, still, 10.0 + still, there)
                     for name, x in (("ego", -40.0), ("follower", -50.0)))  # fmt: skip
    crossing = Car("crossing", -LANE_Y + still, -90.0 + 10.0 * time, np.pi / 2 + still, 10.0 + still, there)
    made = scenario(ego, follower, crossing)
    config = REGENTS_FOCUSED.but(background=background, iterations=2)
    setup = AttackSetup(config, Slower(), "slower", None)
    assert any(one.looks for one in candidates_of(setup, made, by_program(setup))) is not collides
    outcomes = {one.attack.outcome for one in attack([made], config, Slower())}
    assert (outcomes == {"already_colliding"}) is collides
