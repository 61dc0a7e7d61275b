"""Pedestrians replayed as SUMO's persons: exact everywhere, judged by our own boxes."""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from crossing_scenes import EGO, LANE_Y, scenario, straight
from params import slow
from walking_town import make_town

from regents_cosim.geometry.frames import wrap
from regents_cosim.replays.replay import replay
from regents_cosim.replays.sumo.replay import CaseToPlay, replay_in_sumo
from regents_cosim.replays.verify import compare
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Agent, Tracks
from regents_cosim.simulators.sumo.process import load_libsumo
from regents_cosim.sources.record import record
from regents_cosim.system.workers import local_processes, result_of, submit


@pytest.fixture(scope="module")
def in_sumo():
    with local_processes(1) as pool:
        yield lambda case, driver=None, released=(): result_of(
            submit(pool, replay_in_sumo, CaseToPlay(case, released), driver)
        )


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    found = record(make_town(tmp_path_factory.mktemp("town")), count=3, prefer="none", tell=lambda _: None)
    assert any(agent.kind == "pedestrian" for case in found for agent in case.agents)
    return found


def assert_exact(case, found):
    assert (found.tracks.valid == case.tracks.valid).all()
    for name in ("x", "y", "speed"):
        np.testing.assert_allclose(getattr(found.tracks, name), getattr(case.tracks, name), rtol=0, atol=1e-6)
    np.testing.assert_allclose(wrap(found.tracks.yaw - case.tracks.yaw), 0.0, atol=1e-7)


def test_recorded_persons_are_persons_again(windows, in_sumo):
    for case in windows:
        found = in_sumo(case)
        assert_exact(case, found)
        assert found.persons == {i for i, agent in enumerate(case.agents) if agent.kind == "pedestrian"}
        assert compare(case, found.tracks, found.collisions).verified


def roaming(case, seed, walkers=24):
    """Pedestrians that roam all over the window's place: the carriageway, corners, crossings and beyond."""
    rng, steps = np.random.default_rng(seed), case.tracks.steps
    heading = rng.uniform(-np.pi, np.pi, (walkers, 1)) + np.cumsum(rng.normal(0, 0.15, (walkers, steps)), axis=1)
    speed = np.clip(rng.uniform(0, 3, (walkers, 1)) + np.cumsum(rng.normal(0, 0.1, (walkers, steps)), axis=1), 0, 3)
    begin = case.tracks.x[0, 0], case.tracks.y[0, 0]
    x, y = (
        at + rng.uniform(-60, 60, (walkers, 1)) + np.cumsum(case.dt * speed * turn(heading), axis=1)
        for at, turn in zip(begin, (np.cos, np.sin), strict=True)
    )
    there = np.ones((walkers, steps), bool)
    there[::5, :7] = there[1::5, -9:] = there[2::5, 30:40] = False
    columns = (np.where(there, values, 0.0) for values in (x, y, wrap(heading), speed))
    rows = {"x": 0, "y": 1, "yaw": 2, "speed": 3}
    mixed = list(columns)
    tracks = Tracks(
        **{name: np.vstack([getattr(case.tracks, name)[:1], mixed[k]]) for name, k in rows.items()},
        valid=np.vstack([case.tracks.valid[:1], there]),
    )
    sizes = rng.uniform(0.1, 1.5, (walkers, 2))
    agents = tuple(Agent(f"w{i:02}", "pedestrian", *map(float, size)) for i, size in enumerate(sizes))
    return replace(case, agents=(case.ego, *agents), tracks=tracks, overlaps=())


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
def test_whoever_roams_is_where_the_case_says(windows, in_sumo, seed):
    case = roaming(windows[0], seed)
    assert_exact(case, in_sumo(case))


class Looks:
    """Looks at SUMO's own persons while it drives."""

    def start(self, made):
        self.made = made

    def advance(self, step, seen):
        sumo = load_libsumo()
        on_foot = [agent for agent in self.made.agents if agent.kind == "pedestrian"]
        assert sorted(sumo.person.getIDList()) == sorted(agent.id for agent in on_foot)
        assert {(sumo.person.getLength(a.id), sumo.person.getWidth(a.id)) for a in on_foot} == {(0.4, 0.6)}
        assert len(sumo.vehicle.getIDList()) == len(self.made.agents) - len(on_foot)
        return seen.x[0], seen.y[0], seen.yaw[0], seen.speed[0]


def stepping_out(start_y=-8.0):
    """A pedestrian walks north into the way of the ego."""
    ego = straight("ego", -14.0, LANE_Y, 0.0, 10.0)
    walker = straight("walker", 0.0, start_y, np.pi / 2, 3.0, length=0.4, width=0.6, kind="pedestrian")
    return scenario(ego, straight("behind", -40.0, LANE_Y, 0.0, 10.0), walker)


def test_they_are_persons_of_their_size(in_sumo):
    in_sumo(stepping_out(), Looks())


@pytest.mark.slow
def test_a_person_is_hit_at_the_same_step_and_sumo_does_not_notice(in_sumo):
    made = stepping_out(-5.0)
    agent, step = first_contact(made.agents, made.tracks)
    assert made.agents[agent].id == "walker"
    found = in_sumo(made)
    result = compare(made, found.tracks, found.collisions)
    assert (result.verified, result.found) == (True, ("walker", step))
    assert not result.reports_same_pair  # which is why our own boxes are the judge


@pytest.mark.slow
def test_where_sumo_drives_others_they_are_vehicles_and_it_is_said(in_sumo):
    made = stepping_out()
    found = in_sumo(made, released={1})
    assert found.persons == set()
    assert found.tracks.valid[2].all()
    assert replay(made, background="reactive").as_vehicles == ("walker",)
    assert replay(made).as_vehicles == ()


@pytest.mark.slow
def test_networks_that_no_person_may_use_have_them_too(in_sumo):
    made = scenario(EGO, straight("walker", 0.0, 9.0, 1.0, 1.4, length=0.4, width=0.6, kind="pedestrian"))
    net = made.road.sumo_net

    closed = gzip.compress(gzip.decompress(net).replace(b"<lane id=", b'<lane disallow="pedestrian" id='))
    made = replace(made, road=replace(made.road, sumo_net=closed))
    assert_exact(made, in_sumo(made))
