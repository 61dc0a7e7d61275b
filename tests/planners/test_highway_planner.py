"""Agents of highway-env as planners under test, in any simulator."""

import copy
import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from bridged_drives import bridged_drive
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from places import ROOT
from scenes import platoon, scene
from shipped_cases import shipped_window

from regents_cosim.errors import DriveError, PlannerError, RegentsError
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.highway.gym import HighwayReplayEnv
from regents_cosim.replays.highway.replay import drive_in_highway
from regents_cosim.simulators.highway.agents import IDM_PARAMETERS, find_agent
from regents_cosim.simulators.highway.foresight import foreseen
from regents_cosim.system.user_code import import_named

SLOW_POLICY = """
class Zigzag:
    config = {"action": {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15]}, "policy_frequency": 2}

    def __init__(self):
        self.asked = 0

    def reset(self):
        self.asked = 0

    def act(self, observation):
        assert observation.shape == (5, 5)
        self.asked += 1
        return [0, 3, 2, 4][self.asked % 4]
"""


@pytest.fixture
def process(request):
    hosted = HostProcess(request.param)
    yield hosted
    hosted.close()


@pytest.mark.slow
@pytest.mark.parametrize("process", ["highway:idm"], indirect=True)
def test_it_drives_as_in_highway_env(process):
    for name in ("multilane", "roundabout-1"):
        case = shipped_window(name)
        native = drive_in_highway(case, "idm").tracks
        x, y, _, speed = bridged_drive(process, case)
        assert np.hypot(x - native.x[0], y - native.y[0]).max() < 1e-6
        assert speed == pytest.approx(native.speed[0], abs=1e-6)
        assert np.hypot(np.diff(x), np.diff(y)).sum() > 20.0


def test_what_intersection_changes_for_all_vehicles_does_not_reach_a_replay(monkeypatch):
    case = shipped_window("multilane")
    for name, value in IDM_PARAMETERS.items():
        monkeypatch.setattr(IDMVehicle, name, value)  # as they are at first, now and after this test
    first = drive_in_highway(case, "idm").tracks
    gymnasium.make("intersection-v2", disable_env_checker=True).reset(seed=0)
    assert {name: getattr(IDMVehicle, name) for name in IDM_PARAMETERS} != IDM_PARAMETERS, "as highway-env does"
    np.testing.assert_array_equal(drive_in_highway(case, "idm").tracks.x, first.x)


@pytest.mark.slow
@pytest.mark.parametrize("process", ["highway:random"], indirect=True)
def test_every_drive_is_the_same(process):
    case = platoon()
    first = bridged_drive(process, case)
    np.testing.assert_array_equal(bridged_drive(process, case), first)
    assert np.ptp(first[1]) > 0.01  # it steers


@pytest.mark.slow
def test_a_policy_decides_as_often_as_it_wants(tmp_path):
    file = tmp_path / "policy.py"
    file.write_text(SLOW_POLICY)
    process = HostProcess(f"highway:{file}:Zigzag")
    case = platoon()
    drives = [bridged_drive(process, case) for _ in range(2)]
    process.close()
    native = drive_in_highway(case, f"{file}:Zigzag").tracks
    for x, y, _, _ in drives:
        assert np.hypot(x - native.x[0], y - native.y[0]).max() < 1e-6
    assert np.ptp(native.y[0]) > 2.0  # it changes lanes


POLICIES = """
class Plain:
    def predict(self, observation):
        return [0.0, 0.0]


class WithState:
    def predict(self, observation, state=None, deterministic=False):
        assert deterministic
        return [0.0, 0.0], None


class WithAnything:
    def predict(self, observation, **how):
        assert how == {"deterministic": True}
        return [0.0, 0.0], None


class Recurrent:
    def predict(self, observation, state=None, deterministic=False):
        return [0.1 if state == 1 else 0.0, 0.0], (state or 0) + 1


class Continuous:
    config = {"action": {"type": "ContinuousAction", "acceleration_range": [-1e9, 1e9]}}


class Nothing(Continuous):
    def act(self, observation):
        pass


class NaN(Continuous):
    def act(self, observation):
        return [float("nan"), 0.0]


class NoConfig:
    def act(self, observation):
        return 1


class Beyond:
    config = {"action": {"type": "DiscreteMetaAction"}}

    def act(self, observation):
        return 17


class Rocket(Continuous):
    def act(self, observation):
        return [1.0, 0.0]


class Unknown(Rocket):
    config = {"observation": {"type": "Kinematcs"}}


class Often(Rocket):
    config = {"policy_frequency": "5"}


class Tall:
    from gymnasium.spaces import Box
    observation_space = Box(0, 1, (7,))

    def predict(self, observation):
        return [0.0, 0.0]
"""


@pytest.fixture(scope="module")
def policies(tmp_path_factory):
    file = tmp_path_factory.mktemp("policies") / "policies.py"
    file.write_text(POLICIES)
    return file


@pytest.mark.parametrize("name", ["Plain", "WithState", "WithAnything"])
def test_a_policy_predicts_as_it_is_documented(policies, name):
    tracks = drive_in_highway(platoon(), f"{policies}:{name}").tracks
    assert np.ptp(tracks.speed[0]) < 1e-6
    assert np.ptp(tracks.x[0]) > 20.0


def test_a_policy_gets_back_what_it_remembers_until_the_next_start(policies):
    agent = find_agent(f"{policies}:Recurrent")
    env = HighwayReplayEnv.for_agent({}, platoon())
    env.reset()
    for _ in range(2):
        agent.start(env, 0)
        assert [agent.act(None)[0] for _ in range(4)] == [0.0, 0.1, 0.0, 0.0]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Nothing", "answered None, expected an action"),
        ("NaN", "answered .nan, 0.0., expected an action"),
        ("NoConfig", r"answered 1, expected numbers of shape \[2\], as in a ContinuousAction: its `config` names"),
        ("Beyond", "answered 17, expected a whole number from 0 to 4, as in a DiscreteMetaAction"),
        ("Rocket", "at 1e.08 m/s, expected a place within 50 km of the start, a speed of at most 100000 m/s"),
    ],
)
def test_a_policy_without_an_action_or_with_an_impossible_one_fails_its_case_only(policies, name, said):
    with pytest.raises(DriveError, match=said):
        drive_in_highway(platoon(), f"{policies}:{name}")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Unknown", r"Unknown': the type of observation in its `config` is '\w+', (expected one of|did you mean) "),
        ("Often", "policy_frequency '5' Hz, expected a divisor of 10 Hz"),
    ],
)
def test_settings_that_highway_env_does_not_take_are_refused_in_one_line(policies, name, said):
    with pytest.raises(RegentsError, match=said):
        drive_in_highway(platoon(), f"{policies}:{name}")


def test_the_traffic_of_a_training_does_not_matter_in_a_case(tmp_path):
    file = tmp_path / "trained.py"
    file.write_text(
        "class Brakes:\n"
        "    config = {'action': {'type': 'ContinuousAction'}, 'lanes_count': 3, 'reward': {'speed': 1}}\n"
        "    act = lambda self, observation: [-1.0, 0.0]\n"
    )
    assert drive_in_highway(platoon(), f"{file}:Brakes").tracks.speed[0, -1] < 1.0


CAMERA = {
    "observation": {"type": "GrayscaleObservation", "observation_shape": (60, 60), "stack_size": 1,
                    "weights": [0.3, 0.6, 0.1], "scaling": 2.0},
    "vehicles_count": 5,
}  # fmt: skip


def test_a_camera_sees_the_road_ahead_and_not_who_attacks():
    case = scene((0.0, 0.0, 10.0), (12.0, 3.2, 10.0), steps=6)
    seen = []
    for role in ("background", "adversary"):
        agents = (case.agents[0], replace(case.agents[1], role=role))
        env = HighwayReplayEnv.for_agent(CAMERA, replace(case, agents=agents))
        seen.append(env.reset(seed=0)[0])
    np.testing.assert_array_equal(*seen)
    assert len(np.unique(seen[0])) > 3
    assert env.road.vehicles[1].color == (100, 200, 255), "that of highway-env's own vehicles"


def test_one_that_was_trained_for_other_observations_is_told_of_config(policies):
    with pytest.raises(PlannerError, match=r"trained with observation_space Box\(0.0, 1.0, \(7,\).*`config`"):
        drive_in_highway(platoon(), f"{policies}:Tall")


def test_an_agent_that_cannot_be_found():
    with pytest.raises(PlannerError, match="'idmm' not found, did you mean idm"):
        PlannerUnderTest.of("highway:idmm")
    with pytest.raises(PlannerError, match="'my.zip' is a file: .* named highway:my.zip"):
        PlannerUnderTest.of("my.zip")


SEARCHES = """
import json
from pathlib import Path


class Keeps:
    def act(self, observation):
        return [0.0, 0.0]


class Searches:
    def __init__(self):
        self.expected = []

    def act(self, observation, env):
        env.step([1.0, 0.1])
        self.expected += [[float(one.position[0]), float(one.speed)] for one in env.road.vehicles[1:]]
        Path(__file__).with_name("expected.json").write_text(json.dumps(self.expected))
        return [0.0, 0.0]
"""


def test_a_search_tries_actions_in_a_copy_that_does_not_tell_what_the_others_will_do(tmp_path):
    """A car that begins to brake hard in the log is expected to keep its speed."""
    file = tmp_path / "searches.py"
    file.write_text(SEARCHES)
    case = scene((0.0, 0.0, 10.0), (40.0, 3.2, 10.0), steps=6)
    speed = 10.0 - np.arange(6)
    x = 40.0 + np.cumsum([0.0, *(0.1 * speed[:-1])])
    tracks = replace(case.tracks, x=np.stack([case.tracks.x[0], x]), speed=np.stack([case.tracks.speed[0], speed]))
    braking = replace(case, tracks=tracks)
    drives = [drive_in_highway(braking, f"{file}:{name}").tracks for name in ("Keeps", "Searches")]
    np.testing.assert_array_equal(drives[0].x, drives[1].x)  # the drive is as without a search
    expected = np.array(json.loads((tmp_path / "expected.json").read_text()))
    assert expected[:, 0] == pytest.approx(x[:-1] + 0.1 * speed[:-1], abs=0.05)
    assert expected[:, 1] == pytest.approx(speed[:-1], abs=0.2)


@pytest.fixture
def opened():
    """The environment of an ordinary window."""
    env = HighwayReplayEnv({"case": shipped_window("multilane"), "action": {"type": "DiscreteMetaAction"}})
    env.reset(seed=0)
    return env


def test_a_copy_finds_the_neighbours_that_highway_env_finds(opened):
    copied = foreseen(opened)
    found = 0
    for _ in range(20):
        for vehicle in copied.road.vehicles:
            neighbours = copied.road.neighbour_vehicles(vehicle)
            assert neighbours == Road.neighbour_vehicles(copied.road, vehicle)
            found += sum(neighbour is not None for neighbour in neighbours)
        copied.step(1)
    assert found > 100


def test_what_is_tried_in_a_copy_of_a_copy_changes_neither_of_the_others(opened):
    first = foreseen(opened)
    second = copy.deepcopy(first)
    before = [np.array([vehicle.position for vehicle in env.road.vehicles]) for env in (opened, first)]
    second.step(1)
    for env, places in zip((opened, first), before, strict=True):
        np.testing.assert_array_equal([vehicle.position for vehicle in env.road.vehicles], places)
    first.step(1)
    pairs = zip(first.road.vehicles, second.road.vehicles, strict=True)
    assert all(np.array_equal(one.position, other.position) and one is not other for one, other in pairs)
    assert second.scenario is first.scenario  # nothing in it changes


def test_a_copy_holds_no_tracks_of_the_others(opened):
    copied = foreseen(opened)
    for case in (copied.scenario, copied.config["case"]):
        assert [agent.role for agent in case.agents] == ["ego"]
        assert case.attack is None
    assert copied.scenario.tracks.steps == opened.scenario.tracks.steps


@pytest.fixture
def tree_search():
    return import_named(str(ROOT / "examples/tree_search.py"), "the example")


def test_the_example_of_a_tree_search_is_rewarded_for_speed_up_to_the_limit(tree_search, opened):
    worths = [tree_search.worth(speed, 10.0) for speed in (0.0, 5.0, 10.0, 10.5, 11.0, 12.0, 20.0)]
    assert worths == pytest.approx([0.0, 0.5, 1.0, 0.75, 0.5, 0.0, 0.0])
    env, limit = tree_search.Rewarded(opened), opened.vehicle.lane.speed_limit
    earned = []
    for speed in (0.5 * limit, limit, 1.5 * limit):
        opened.vehicle.speed = opened.vehicle.target_speed = speed
        earned.append(env.step(1)[1])
    assert max(earned) == earned[1] <= 1.0
    assert min(earned) == earned[2] >= 0.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_tree_search_of_rl_agents_drives_and_keeps_to_the_limit():
    pytest.importorskip("rl_agents.agents.tree_search.deterministic", reason="rl-agents lies on no path")
    case = shipped_window("multilane")
    tracks = drive_in_highway(case, f"{ROOT / 'examples/tree_search.py'}:Search").tracks
    assert np.ptp(tracks.x[0]) > 50.0
    assert tracks.speed[0, 20:].max() < max(lane.speed_limit for lane in case.road.lanes) + 0.5
