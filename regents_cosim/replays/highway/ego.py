"""The bridge `highway:AGENT`: an agent of highway-env drives the ego, and highway-env's vehicle model moves it.

A separate environment runs beside the host's simulation, in the planner's process, with the case's map and all others
at their observed places. The agent decides as often as its configuration says (`policy_frequency`), highway-env's
controllers and physics do the rest, and the resulting pose is the planner's answer.
"""

from typing import Any

import numpy as np

from regents_cosim.geometry.frames import HighwayPose, Pose, from_highway, to_highway
from regents_cosim.planners.interface import Observation, Others, Placement, Scene
from regents_cosim.replays.highway.gym import HighwayReplayEnv
from regents_cosim.routes.to_target import way_to_target
from regents_cosim.scenario.scenario import Agent, Provenance, Scenario, Tracks
from regents_cosim.simulators.highway.agents import find_agent

_SEED = 0  # of random agents, so that every drive is the same


class HighwayEgo:
    """Drives the ego as the agent would in highway-env."""

    def __init__(self, agent: str) -> None:
        """`agent` is idm, mdp, random, or the name of a policy. Raises PlannerError."""
        self._agent = find_agent(agent)
        self._env: Any = None

    def reset(self, scene: Scene) -> None:
        """Start again; the environment is built at the first step, when all agents are known."""
        ego, road = scene.ego, scene.road
        lanes = way_to_target(road, Pose(ego.x, ego.y, ego.yaw), ego.z, scene.target) if road.lanes else []
        self._way = [lane.centre for lane in lanes] or [scene.route.points]

    def act(self, observation: Observation) -> Placement:
        """The placement of the ego by highway-env."""
        if observation.step == 0:
            seen = self._begin(observation)
        else:
            seen = None
            self._place_others(observation.others, observation.scene.dt)
        env, dt = self._env, observation.scene.dt
        if observation.step % self._decides_every == 0:
            seen = env.observation_type.observe() if seen is None else seen
            env.action_type.act(self._agent.act(seen))
        env.road.act()
        ego: Any = env.vehicle
        ego.step(dt)
        env.steps, env.time = observation.step + 1, (observation.step + 1) * dt
        x, y = ego.position.tolist()
        pose = from_highway(HighwayPose(x, y, float(ego.heading)))
        return Placement(float(pose.x), float(pose.y), float(pose.yaw), max(float(ego.speed), 0.0))

    def _begin(self, observation: Observation) -> Any:
        """Build the environment with all agents at the start, and return the agent's first observation."""
        case = _case(observation, self._way)
        if self._env is None:
            self._env = HighwayReplayEnv.for_agent(self._agent.config, case)
        env = self._env
        seen, _ = env.reset(seed=_SEED, options={"case": case})
        self._decides_every = env.config["simulation_frequency"] // env.config["policy_frequency"]
        self._agent.start(env, _SEED)
        return seen

    def _place_others(self, others: Others, dt: float) -> None:
        road = self._env.road
        x, y, heading = to_highway(Pose(others.x, others.y, others.yaw))
        states = np.stack([x, y, heading, others.speed])
        for index, vehicle in enumerate(road.cast):
            vehicle.states, vehicle.valid = states[:, [index]], others.valid[[index]]
            vehicle.place()
        road.look(dt)


def _case(observation: Observation, way: list[np.ndarray]) -> Scenario:
    """The initial state as a case: the poses of all agents, and the ego's route in place of its track."""
    scene, ego, others = observation.scene, observation.ego, observation.others
    ahead = np.concatenate([[[ego.x, ego.y]], *way])
    first = np.arange(len(ahead)) == 0
    names = ("x", "y", "yaw", "speed", "z")
    x, y, yaw, speed, z = (
        np.concatenate([[np.full(len(ahead), getattr(ego, name))], getattr(others, name)[:, None] * first])
        for name in names
    )
    x[0], y[0] = ahead.T
    valid = np.concatenate([[np.ones(len(ahead), bool)], others.valid[:, None] & first])
    return Scenario(
        id=scene.id,
        dt=scene.dt,
        agents=(Agent(ego.id, ego.kind, ego.length, ego.width, "ego"), *others.agents),
        tracks=Tracks(x, y, yaw, speed, valid, z=z),
        target=scene.target,
        road=scene.road,
        provenance=Provenance(source="", file="", sha256="", begin_s=0.0),
    )
