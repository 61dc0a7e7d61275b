"""Replays a Scenario in highway-env: agents follow their tracks, or highway-env's physics moves them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import DriveError, PlannerError
from regents_cosim.geometry.frames import HighwayPose, Pose, from_highway, to_highway
from regents_cosim.planners.interface import EXPECTED_PLACE, Placement, Snapshot, can_be_at
from regents_cosim.replays.ego_controller import EgoController, ask, decision
from regents_cosim.replays.highway.gym import HighwayReplayEnv, Mode, make_cast, network_of
from regents_cosim.replays.verify import ReportedCollision
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.simulators.highway import after_each_step
from regents_cosim.simulators.highway.agents import find_agent
from regents_cosim.simulators.highway.cast import ReplayRoad, ScriptedVehicle
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.process_kept import process_kept

_SEED = 0
_OWN_TYPE = "crashed"  # highway-env's word for a collision


@dataclass(frozen=True, eq=False)
class HighwayReplay:
    """The states that highway-env reports after each step, in the order of the scenario's agents."""

    tracks: Tracks  # box centres in the map's frame
    collisions: tuple[ReportedCollision, ...]  # of the ego, as highway-env detects them


def replay_in_highway(scenario: Scenario, driver: EgoController | None = None, mode: Mode = "track") -> HighwayReplay:
    """Replay `scenario`; `driver` places the ego step by step, otherwise it follows its track as the others do."""
    if driver is not None:
        ask(lambda: driver.start(scenario), "before the first step")
    road = ReplayRoad(network_of(scenario), np.random.default_rng(0))
    cast = make_cast(road, scenario, mode)
    if driver is not None:
        cast[0] = ScriptedVehicle(road, scenario, 0)
    road.enter(cast[0], cast[1:])
    film = _StateHistory(scenario)
    film.take(road)
    for step in range(scenario.tracks.steps - 1):
        if driver is not None:
            ego = decision(driver, step, film.last())
            cast[0].states[:, step + 1] = *to_highway(Pose(ego.x, ego.y, ego.yaw)), ego.speed
        road.step(scenario.dt)
        film.take(road)
    return film.finish(road)


def drive_in_highway(scenario: Scenario, agent_name: str, mode: Mode = "track") -> HighwayReplay:
    """Replay `scenario` with an agent of highway-env driving the ego among scripted vehicles.

    The episode continues after a crash, to its end. Raises PlannerError where the agent cannot be found, its `config`
    is refused, or it fails.
    """
    with process_kept():
        agent = find_agent(agent_name)
    with foreign_code(
        lambda error: PlannerError(f"highway-env refuses the `config` of {agent_name} ({said_by(error)})")
    ):
        env = HighwayReplayEnv.for_agent(agent.config, scenario, mode)
        observation, _ = env.reset(seed=_SEED)
    ask(lambda: agent.start(env, _SEED), "before the first step")
    film = _StateHistory(scenario)
    film.take(env.road)
    after_each_step(env.road, lambda: film.take(env.road))
    while len(film.frames) < scenario.tracks.steps:
        observation = ask(lambda seen=observation: env.step(agent.act(seen))[0], f"at step {len(film.frames) - 1}")
        placed = Placement(*film.frames[-1][0][:, 0].tolist())
        if not can_be_at((float(scenario.tracks.x[0, 0]), float(scenario.tracks.y[0, 0])), placed):
            raise DriveError(f"the planner drove to x {placed.x:g} m at {placed.speed:g} m/s, {EXPECTED_PLACE}")
    film.frames = film.frames[: scenario.tracks.steps]
    return film.finish(env.road)


class _StateHistory:
    """Collects states [4, agent] and presence of all agents per step, in the map's frame."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._row = {agent.id: row for row, agent in enumerate(scenario.agents)}
        self.frames: list[tuple[Float[np.ndarray, "4 agent"], np.ndarray]] = []

    def take(self, road: ReplayRoad) -> None:
        """Add the current step."""
        states, valid = np.zeros((4, len(self._row))), np.zeros(len(self._row), bool)
        for vehicle in road.vehicles:
            row = self._row[vehicle.name] if isinstance(vehicle, ScriptedVehicle) else 0
            x, y = vehicle.position.tolist()
            pose = from_highway(HighwayPose(x, y, float(vehicle.heading)))
            states[:, row] = *pose, max(float(vehicle.speed), 0.0)
            valid[row] = True
        self.frames.append((states, valid))

    def last(self) -> Snapshot:
        """All agents at the current step."""
        states, valid = self.frames[-1]
        x, y, yaw, speed = states
        return Snapshot(x, y, yaw, speed, valid, np.where(valid, self._scenario.heights(x, y), 0.0))

    def finish(self, road: ReplayRoad) -> HighwayReplay:
        """The replay with all steps that were collected."""
        x, y, yaw, speed = np.stack([states for states, _ in self.frames], axis=-1)
        valid = np.stack([there for _, there in self.frames], axis=-1)
        ego = self._scenario.ego.id
        hits = tuple(ReportedCollision(step, ego, other, _OWN_TYPE) for step, other in road.contacts)
        return HighwayReplay(self._scenario.with_heights(Tracks(x, y, yaw, speed, valid)), hits)
