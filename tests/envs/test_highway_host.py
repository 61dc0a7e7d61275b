"""Vehicles of highway-env's own, taken into our hands and given back at any time, on all of its roads."""

import warnings

import gymnasium
import numpy as np
import pytest
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.envs.highway_host import HighwayControl, HighwayHost
from regents_cosim.live.predict.traffic import TrafficState
from regents_cosim.simulators import COLOURS

ENVIRONMENTS = sorted(
    name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("highway_env")
)


def roads(name: str, seeds: int):
    """An environment after so many resets, one after the other."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of older versions
        env = gymnasium.make(name, disable_env_checker=True)
        for seed in range(seeds):
            env.reset(seed=seed)
            env.action_space.seed(seed)
            yield env, np.random.default_rng(seed)
        env.close()


def held_at_random(env, host: HighwayHost, draw: np.random.Generator, steps: int) -> None:
    """Let the episode go on, while vehicles are taken, and given back a few steps later."""
    step, now_s, held = env.unwrapped.road.step, 0.0, None

    def watched(dt: float) -> None:
        nonlocal now_s, held
        frame = host.frame(now_s)
        if held is None and len(frame.ids) > 1 and draw.random() < 0.3:
            name = str(draw.choice(frame.ids[1:]))
            held = None if host.is_spared(name) else host.take(name, 5.0)
        elif held is not None and (draw.random() < 0.1 or held.name not in frame.number):
            held.give_back()
            held = None
        if held is not None:
            row = frame.number[held.name]
            held.place(*(float(values[row]) for values in (frame.x, frame.y, frame.yaw, frame.speed)))
        step(dt)
        now_s += dt

    env.unwrapped.road.step = watched
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            return


@pytest.mark.slow
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_vehicles_are_taken_and_given_back_at_any_time(name):
    for env, draw in roads(name, 2):
        held_at_random(env, HighwayHost(env.unwrapped, 100.0), draw, 8)


@given(st.lists(st.sampled_from(["take", "give back", "made to wait", "wait is over"]), max_size=12), st.booleans())
def test_a_junction_may_paint_who_waits_and_take_the_paint_off_at_any_time(events, is_red):
    """It deletes the colour of whoever has waited, and raises where there is none."""
    road = RegulatedRoad(RoadNetwork.straight_road_network(1), np_random=np.random.default_rng(0))
    vehicle = IDMVehicle(road, [0.0, 0.0])
    if is_red:
        vehicle.color = (255, 0, 0)
    road.vehicles.append(vehicle)
    held = None
    for event in (*events, "give back", "wait is over"):
        if event == "take" and held is None:
            held = HighwayControl("vehicle000", vehicle)
        elif event == "give back" and held is not None:
            held.give_back()
            held = None
        elif event == "made to wait":
            vehicle.color, vehicle.is_yielding, vehicle.yield_timer = RegulatedRoad.YIELDING_COLOR, True, 0
        elif event == "wait is over":
            vehicle.yield_timer = 10**6
            road.enforce_road_rules()
        if held is not None:
            held.place(0.0, 0.0, 0.0, 1.0)
            assert vehicle.color == COLOURS["adversary"]
    assert getattr(vehicle, "color", None) != COLOURS["adversary"]
    if is_red and "made to wait" not in events:
        assert vehicle.color == (255, 0, 0)


@pytest.mark.parametrize("observation", ["Kinematics", "GrayscaleObservation"])
def test_a_camera_does_not_see_who_attacks(observation):
    picture = {"observation_shape": (20, 20), "stack_size": 1, "weights": [0.3, 0.6, 0.1]}
    config = {"observation": {"type": observation, **(picture if observation != "Kinematics" else {})}}
    env = gymnasium.make("highway-fast-v0", config=config, disable_env_checker=True).unwrapped
    host, vehicle = HighwayHost(env, 100.0, ()), env.road.vehicles[1]
    held = host.take(host._name(vehicle), vehicle.LENGTH)
    held.place(*vehicle.position, vehicle.heading, vehicle.speed)
    assert (getattr(vehicle, "color", None) == COLOURS["adversary"]) is (observation == "Kinematics")
    assert held.give_back()
    assert not hasattr(vehicle, "color")


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_traffic_is_read_everywhere(name):
    for env, _ in roads(name, 2):
        host = HighwayHost(env.unwrapped, 100.0)
        assert isinstance(host.traffic(host.frame(0.0), 12, 5.0), TrafficState)


def test_the_users_own_agents_are_left_alone_and_who_else_is_to_be():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gymnasium.make("highway-v0", disable_env_checker=True, config={"controlled_vehicles": 3}).unwrapped
    env.reset(seed=0)

    def spared(spare=()):
        host = HighwayHost(env, 1000.0, spare)
        return {name: host.is_spared(name) for name in host.frame(0.0).ids[1:]}

    names = list(spared())
    assert sum(spared().values()) == 2
    others = [name for name, is_spared in spared().items() if not is_spared]
    assert spared([others[0]]) == spared() | {others[0]: True}
    assert all(spared(["IDMVehicle"]).values())
    ahead = spared(lambda vehicle: vehicle.position[0] > 350.0)
    assert set(ahead) == set(names)
    assert 2 < sum(ahead.values()) < len(names)
