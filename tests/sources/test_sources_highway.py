"""highway-env as a source: its roads, its traffic, its policies."""

import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import shapely
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork
from scenes import TIME, crash, moving, scene

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.errors import NoWindowError, PlannerError, RegentsError
from regents_cosim.geometry.frames import points_from_highway
from regents_cosim.replays.replay import replay
from regents_cosim.simulators.highway.environments import environments
from regents_cosim.simulators.highway.net import to_road_map
from regents_cosim.sources.highway import record_episodes, record_highway
from regents_cosim.sources.record import record
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated
from regents_cosim.verdicts.law.offences import law_of

WINDOWS = Windows(count=2, seed=0, horizon_s=3.0, company=1)


def network(name: str):
    environments()
    return gymnasium.make(name, disable_env_checker=True).unwrapped.road.network


def lanes_of(found):
    for begin, onward in found.graph.items():
        for end, lanes in onward.items():
            yield from (((begin, end, index), lane) for index, lane in enumerate(lanes))


def test_lanes_keep_their_sides_and_lead_on():
    road = to_road_map(network("merge-v1"))
    left, right = road.lane["a-b_0"], road.lane["a-b_1"]
    assert (left.right, right.left) == ("a-b_1", "a-b_0")
    assert left.centre[0, 1] > right.centre[0, 1]  # north of it, both lead east
    assert road.lane["b-c_1"].right is None  # one may not change onto the ramp
    assert {link.target for link in road.exits["k-b_0"]} == {"b-c_2"}


@pytest.mark.parametrize("name", ["roundabout-v1", "intersection-v2", "racetrack-v1", "u-turn-v1"])
def test_the_road_map_is_the_network(name):
    """A point beside a lane of highway-env lies as far beside the same lane of the map, and on the drivable area."""
    lanes = network(name)
    road = to_road_map(lanes)
    for (begin, end, index), lane in lanes_of(lanes):
        line = shapely.LineString(road.lane[f"{begin}-{end}_{index}"].centre)
        for along in np.linspace(1.0, lane.length - 1.0, 5):
            point = points_from_highway(np.asarray(lane.position(along, 1.2)))
            assert line.distance(shapely.Point(point)) == pytest.approx(
                1.2, abs=0.1
            )  # a sine lane measures across the road, not across itself
            assert road.contains(point[None]).all()


def test_a_lane_leads_on_across_a_gap_and_not_to_the_side_or_back():
    ring, track, merge = (to_road_map(network(name)) for name in ("roundabout-v1", "racetrack-v1", "merge-v1"))
    assert {link.target for link in ring.exits["ses-se_0"]} == {"se-ex_1"}
    assert {link.target for link in ring.exits["se-ex_1"]} == {"ex-ee_1", "ex-exs_0"}
    assert {link.target for link in ring.exits["se-ex_0"]} == {"ex-ee_0"}
    assert all(track.exits[lane.id] for lane in track.lanes), "it is closed"
    assert not merge.exits.get("b-c_2"), "it ends"
    assert not to_road_map(network("two-way-v0")).exits.get("a-b_1"), "one does not turn round"


def test_roads_side_by_side_that_do_not_meet_have_no_road_between_them():
    made = RoadNetwork()
    for y, begin in ((0.0, "a"), (9.0, "b"), (30.0, "c")):
        made.add_lane(begin, f"{begin} end", StraightLane([0.0, y], [100.0, y], width=4.0))
    made.add_lane("a end", "c", StraightLane([50.0, 0.0], [50.0, -40.0], width=4.0))
    road = to_road_map(made)
    inside = road.contains(points_from_highway(np.array([[20.0, 0.0], [20.0, 9.0], [20.0, 4.5], [52.2, -2.2]])))
    assert inside.tolist() == [True, True, False, True], "only the corner is filled"


def test_the_kind_that_is_asked_for_holds_in_highway_env_too():
    with pytest.raises(NoWindowError, match="of another kind than `ego_kind` truck"):
        record_episodes("merge-v1", "idm", replace(WINDOWS, count=1, horizon_s=1.0, ego_kind="truck"))


def test_a_recording_is_what_highway_env_drove():
    first, second = record_episodes("merge-v1", "idm", replace(WINDOWS, radius_m=400.0))
    assert (first.ego.id, second.ego.id) == ("e000.ego", "e001.ego")
    assert first.dt == 0.1
    assert first.tracks.steps == 31
    assert first.provenance.source == "highway"
    assert {agent.kind for agent in first.agents} == {"car", "other"}  # the end of the ramp is an obstacle
    # forward Euler: the next position follows from the speed
    step = np.hypot(np.diff(first.tracks.x[0]), np.diff(first.tracks.y[0]))
    np.testing.assert_allclose(step, first.tracks.speed[0, :-1] * first.dt, atol=1e-9)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_cases_in_any_process():
    job = "merge-v1", "random", WINDOWS
    here, there = record_episodes(*job), run_isolated(record_episodes, *job)
    assert [content_hash(s) for s in here] == [content_hash(s) for s in there]
    other = record_episodes(*job[:2], replace(WINDOWS, seed=1))
    assert [content_hash(s) for s in here] != [content_hash(s) for s in other]


@pytest.mark.parametrize(
    ("environment", "policy"),
    [("merge-v1", "mdp"), ("racetrack-v1", "idm"), ("two-way-v0", "random"), ("two-way-v0", "idm")],
)
def test_other_environments_and_policies(environment, policy):
    found = record_episodes(environment, policy, replace(WINDOWS, count=1))
    assert found[0].id.startswith(environment)
    assert len(found[0].agents) >= 2


def test_a_policy_of_the_user_s(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Fast:\n"
        "    config = {'action': {'type': 'DiscreteMetaAction', 'target_speeds': [20, 25, 30]}}\n"
        "    def act(self, observation):\n"
        "        assert observation.shape == (5, 5)\n"
        "        return 3\n"
    )
    job = "merge-v1", f"{tmp_path / 'mine.py'}:Fast", replace(WINDOWS, count=1)
    assert record_episodes(*job)[0].tracks.speed[0, -1] > 29.0


@pytest.mark.parametrize("environment", ["merge-v1", "two-way-v0"])
def test_continuous_actions_are_recorded_where_the_reward_takes_none(environment, tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Keeps:\n"
        "    config = {'action': {'type': 'ContinuousAction'}, 'observation': {'type': 'Kinematics'}}\n"
        "    act = lambda self, seen: [0.0, 0.0]\n"
    )
    (found,) = record_episodes(environment, f"{tmp_path / 'mine.py'}:Keeps", replace(WINDOWS, count=1, horizon_s=2.0))
    assert np.ptp(found.tracks.x[0]) > 10.0


WEAVES = """
import numpy as np
from highway_env.envs.highway_env import HighwayEnvFast


class Weaves:
    config = {
        "observation": {"type": "Kinematics", "features": ["y", "heading"], "normalize": False},
        "action": {"type": "ContinuousAction"},
        "policy_frequency": 10,
    }

    def reset(self):
        self.lane = None

    def act(self, observation):
        y, heading = observation[0]
        self.lane = y if self.lane is None else self.lane
        return np.array([0.0, -0.6 if heading + 0.02 * (y - self.lane) > 0.0 else 0.6])


class Few(HighwayEnvFast):
    @classmethod
    def default_config(cls):
        return super().default_config() | {"vehicles_count": 3}


class Teleports(Few):
    def _simulate(self, action=None):
        super()._simulate(action)
        self.vehicle.position[1] += {0: 4.0, 10: -4.0}.get(self.steps % 20, 0.0)
"""


@pytest.fixture
def weaves(tmp_path):
    file = tmp_path / "weaves.py"
    file.write_text(WEAVES)
    return f"{file}:Weaves"


def test_a_policy_may_set_its_wheel_at_once_as_highway_env_lets_it(weaves):
    """Its way has kinks at every step that no other model of a vehicle can drive."""
    (made,) = record_episodes(weaves.replace(":Weaves", ":Few"), weaves, replace(WINDOWS, count=1))
    assert np.abs(np.diff(made.tracks.yaw[0])).min() > 0.2, "left and right by turns"
    assert replay(made, "highway", mode="actions").position_error_m.max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("where", ["highway", "mirror"])
def test_a_policy_that_sets_its_wheel_at_once_drives(weaves, where):
    (made,) = record_episodes(weaves.replace(":Weaves", ":Few"), weaves, replace(WINDOWS, count=1))
    driven = replay(made, where, planner=f"highway:{weaves}")
    np.testing.assert_allclose(driven.replayed.tracks.x[0], made.tracks.x[0], atol=1e-3)


@pytest.mark.slow
def test_a_teleport_is_a_jump_in_highway_env_too(weaves):
    environment = weaves.replace(":Weaves", ":Teleports")
    with pytest.raises(NoWindowError, match=r"of (\d+) candidate egos in .*, \1 jumped"):
        record_episodes(environment, weaves, replace(WINDOWS, count=1, horizon_s=1.5))


@pytest.mark.slow
def test_files_beside_an_environment_and_a_policy_hide_no_module_of_the_worker(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("random", "tempfile"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('not for others')\n")
    (tmp_path / "env.py").write_text(
        "from highway_env.envs.merge_env import MergeEnv\nclass Own(MergeEnv): pass\n"
        "class Policy:\n    config = {}\n    def act(self, observation): return 1\n"
    )
    assert record_highway(f"{tmp_path}/env.py:Own", f"{tmp_path}/env.py:Policy", replace(WINDOWS, count=1))


OWN = """
from random import random

import numpy as np
from gymnasium import Env, Wrapper, make
from gymnasium.envs.registration import register
from highway_env.envs.highway_env import HighwayEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Obstacle, RoadObject


class Pedestrian(RoadObject):
    LENGTH, WIDTH = 0.5, 0.7

    def __init__(self, road, position):
        super().__init__(road, position, heading=1.57, speed=1.0)


class Truck(IDMVehicle):
    LENGTH = 6.0


class Own(HighwayEnv):
    @classmethod
    def default_config(cls):
        return super().default_config() | {"policy_frequency": 15, "vehicles_count": 6, "lanes_count": 1}

    def _create_road(self):
        self.config["lanes_count"] += 1  # another road in every episode
        super()._create_road()

    def _create_vehicles(self):
        super()._create_vehicles()
        ahead = self.vehicle.position + [30.0 + random() + np.random.random(), 0.0]
        ghost = Vehicle(self.road, self.vehicle.position)
        ghost.collidable = False
        self.road.vehicles += [Truck(self.road, ahead, speed=20.0), ghost]
        self.road.objects += [Pedestrian(self.road, ahead + [20.0, 8.0]), Obstacle(self.road, ahead + [400.0, 12.0])]


class NoneOfHighwayEnv(Env):
    def __init__(self):
        self.inside = make("highway-v0")


def dense():
    return Wrapper(make("highway-v0", config={"vehicles_count": 9, "simulation_frequency": 15}))


def convoy():
    return make("highway-fast-v0", config={"controlled_vehicles": 2})


register(id="own-v0", entry_point=Own, max_episode_steps=5)
"""


@pytest.fixture
def own(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN)
    return file


def test_an_environment_of_the_user_s_is_found_by_its_id_class_or_function(own):
    job = "idm", replace(WINDOWS, horizon_s=1.0)
    by_id, by_class = (record_episodes(f"{own}:{name}", *job) for name in ("own-v0", "Own"))
    assert [one.id for one in by_id] == ["own-v0-00002.5s-e000.ego", "own-v0-00003.5s-e001.ego"]
    np.testing.assert_array_equal(by_id[0].tracks.x, by_class[0].tracks.x)
    (made,) = record_episodes(f"{own}:dense", "idm", replace(WINDOWS, count=1, radius_m=5000.0))
    assert len(made.agents) == 10
    step = np.hypot(np.diff(made.tracks.x[0]), np.diff(made.tracks.y[0]))
    np.testing.assert_allclose(step, made.tracks.speed[0, :-1] * 0.1, atol=1e-9)


def test_everybody_who_can_be_hit_is_in_the_window_under_the_name_of_its_kind(own):
    first, second = record_episodes(f"{own}:Own", "idm", replace(WINDOWS, horizon_s=1.0, radius_m=5000.0))
    for window in (first, second):
        kinds = [agent.kind for agent in window.agents]
        assert {kind: kinds.count(kind) for kind in kinds} == {"car": 7, "other": 1, "pedestrian": 1, "truck": 1}
    assert len(second.road.lanes) == len(first.road.lanes) + 1, "each window has the road of its own episode"


def test_an_environment_that_cannot_be_had_is_explained(own):
    with pytest.raises(RegentsError, match="registers no 'Owm', and has no class or function of that name"):
        record_episodes(f"{own}:Owm", "idm", WINDOWS)
    with pytest.raises(RegentsError, match="NoneOfHighwayEnv, expected a subclass of highway-env's AbstractEnv"):
        record_episodes(f"{own}:NoneOfHighwayEnv", "idm", WINDOWS)
    with pytest.raises(RegentsError, match="HighwayEnvFast has 2 controlled vehicles, expected one, the ego"):
        record_episodes(f"{own}:convoy", "random", WINDOWS)
    with pytest.raises(RegentsError, match="'random:Random' cannot be made: AttributeError"):
        record_episodes("random:Random", "idm", WINDOWS)
    with pytest.raises(RegentsError, match="'nowhere:Own' cannot be imported: ModuleNotFoundError"):
        record_episodes("nowhere:Own", "idm", WINDOWS)


def test_a_policy_s_settings_do_not_change_the_length_of_a_step(tmp_path):
    file = tmp_path / "trained.py"
    file.write_text(
        "class Slow:\n"
        "    config = {'simulation_frequency': 15, 'policy_frequency': 1}\n"
        "    act = lambda self, observation: 1\n"
        "class Often(Slow):\n"
        "    config = {'simulation_frequency': 15, 'policy_frequency': 15}\n"
    )
    (made,) = record_episodes("merge-v1", f"{file}:Slow", replace(WINDOWS, count=1))
    step = np.hypot(np.diff(made.tracks.x[0]), np.diff(made.tracks.y[0]))
    np.testing.assert_allclose(step, made.tracks.speed[0, :-1] * 0.1, atol=1e-9)
    with pytest.raises(RegentsError, match="policy_frequency 15 Hz, expected a divisor of 10 Hz, .*: 1, 2, 5, 10"):
        record_episodes("merge-v1", f"{file}:Often", WINDOWS)


def test_who_cannot_drive_is_named(tmp_path):
    (tmp_path / "mine.py").write_text("def breaks(observation):\n    raise KeyError('lost')\n")
    with pytest.raises(PlannerError, match=r"breaks cannot drive in merge-v1 \(KeyError: 'lost'\)"):
        record_episodes("merge-v1", f"{tmp_path / 'mine.py'}:breaks", WINDOWS)
    with pytest.raises(PlannerError, match="policy idm cannot drive in parking-v0"):
        record_episodes("parking-v0", "idm", WINDOWS)


@pytest.mark.slow
def test_wrong_names_are_explained():
    with pytest.raises(RegentsError, match="did you mean merge-v1"):
        record("highway:merge-v2")
    with pytest.raises(PlannerError, match="did you mean .*idm"):
        record("highway:merge-v1", policy="imd")
    with pytest.raises(NoWindowError, match="12 of 12 episodes ended before 60 s"):
        record_episodes("merge-v1", "idm", replace(WINDOWS, count=1, horizon_s=60.0))


def test_the_levels_of_priority_of_an_intersection_tell_who_gives_way():
    road = to_road_map(network("intersection-v2"))
    told = {lane.id: lane.approach for lane in road.lanes if lane.approach}
    assert {name[:3] for name, approach in told.items() if approach == "priority"} == {"ir1", "ir3"}
    assert {name[:3] for name, approach in told.items() if approach == "yields"} == {"ir0", "ir2"}
    assert not any(lane.approach for lane in to_road_map(network("roundabout-v1")).lanes)
    for main, blamed in ((0, "adversary"), (1, "ego")):  # the agent on the main road, which lies along x
        made = scene((0, 0, 8), (0, 0, 8), road=road)
        for agent in (0, 1):
            way, beside = -32.0 + 8.0 * TIME, np.full(81, 2.0)  # on the right
            x, y = (way, -beside) if agent == main else (beside, way)
            made = moving(made, agent, x=x, y=y, yaw=np.full(81, 0.0 if agent == main else np.pi / 2))
        law = law_of(crash(made))
        assert "gives_no_way" not in law.unknown
        assert ["gives_no_way" in {one.name for one in done} for done in (law.adversary, law.ego)] == [
            blamed == "adversary",
            blamed == "ego",
        ]
