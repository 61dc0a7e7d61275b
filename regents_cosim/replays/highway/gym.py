"""`regents/HighwayReplay-v0`: a case as an environment of highway-env, the ego driven by an agent."""

from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.road import RoadNetwork
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.frames import Pose, points_from_highway, to_highway
from regents_cosim.maps.roadmap import Lane
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.replays.episode import RecordedPath, choose_case, require_known
from regents_cosim.routes.route import route_of
from regents_cosim.routes.to_target import way_to_target
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.highway.cast import ActionVehicle, ReplayRoad, ScriptedVehicle
from regents_cosim.simulators.highway.environments import hide_roles, require_rate, sees_pictures
from regents_cosim.simulators.highway.own_motion import EXACT_M, controls_behind
from regents_cosim.simulators.highway.road import AROUND_M, build_network, route_along


@in_float32
def actions(scenario: Scenario) -> Float[np.ndarray, "2 agent step"]:
    """Accelerations [m/s^2] and curvatures [1/m] with which all agents keep to their tracks, 0 while absent.

    Tracks made by highway-env or by its twin are inverted exactly; others are fitted with the twin in the mirror.
    """
    tracks = scenario.tracks
    held = tracks.valid[:, :-1] & tracks.valid[:, 1:]
    lengths = np.array([agent.length for agent in scenario.agents])
    found, missed = controls_behind(tracks.x, tracks.y, tracks.yaw, tracks.speed, lengths, scenario.dt)
    found = np.where(held, found, 0.0)
    off = np.abs(np.cumsum(np.where(held, missed, 0.0), axis=1)).max(axis=1) > EXACT_M
    if off.any():
        from regents_cosim.mirror.world import to_roadless_world  # JAX is needed for fits only

        controls = to_roadless_world(scenario, "highway").controls
        fitted = np.stack([np.asarray(v, float)[: len(off)] for v in (controls.accel, controls.curvature)])
        found[:, off] = fitted[:, off]
    return found


Mode = Literal["track", "actions"]
MODES: tuple[Mode, ...] = ("track", "actions")
_SEEN_M = 100.0  # lanes as far as this from all tracks are in an agent's picture
_LOOK_EVERY = 5  # lanes are searched around every fifth point of the tracks
_LANE_WIDTH_M = 3.5  # on a map without lanes


class HighwayReplayEnv(AbstractEnv):
    """The background of a case on its own map, with any action and observation type of highway-env.

    `mode` track: all others follow their tracks. `mode` actions: highway-env's own physics moves them. The episode ends
    with the ego's first collision, or with the case. Configuration and options of `reset`: `case` (a folder) or `suite`
    (a folder of cases, from which the seed draws one); without either, the cases that come with the package.

    Rewards: progress along the recorded path (1 for all of it) and -1 for a collision.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}

    @classmethod
    def for_agent(cls, settings: dict[str, Any], case: Scenario, mode: Mode = "track") -> "HighwayReplayEnv":
        """The environment of a case for an agent with these settings, without those of the traffic of its training."""
        known = cls.default_config()
        own = {name: value for name, value in settings.items() if name in known}
        # A camera without a place of its own in the settings has that of highway-env.
        camera = {"centering_position": AbstractEnv.default_config()["centering_position"]}
        return cls({**camera, **own, "case": case, "mode": mode})

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """The defaults of all configuration keys."""
        return super().default_config() | {
            "case": "",
            "suite": "",
            "mode": "track",
            "action": {"type": "ContinuousAction"},
            "policy_frequency": 10,  # [Hz]
            "simulation_frequency": 10,  # [Hz] always the rate of the case
            "collision_reward": -1.0,
            "progress_reward": 1.0,
            "screen_height": 600,
            "centering_position": [0.5, 0.5],
        }

    def configure(self, config: dict[str, Any] | None) -> None:
        """Update the configuration. Raises RegentsError for an unknown key."""
        require_known(config or {}, self.default_config(), "configuration key")
        mode = (config or {}).get("mode", "track")
        require(mode in MODES, f"mode {mode!r}, expected one of {', '.join(MODES)}", RegentsError)
        super().configure(config or {})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start a case: that of `options`, of the configuration, or one drawn from a suite by the seed."""
        require_known(options or {}, ("case", "suite", "config"), "option")
        self._asked = {name: value for name, value in (options or {}).items() if name != "config"}
        observation, info = super().reset(seed=seed, options=options)
        del info["action"]  # a random sample that was not executed
        return observation, info

    def _reset(self) -> None:
        pool = self._asked if self._asked.get("case") or self._asked.get("suite") else self.config
        self.scenario = with_lanes(choose_case(pool.get("case"), pool.get("suite"), self.np_random))
        frequency = round(1.0 / self.scenario.dt)
        require_rate(self.config["policy_frequency"], frequency)
        self.config["simulation_frequency"] = frequency
        network = network_of(self.scenario, _SEEN_M if sees_pictures(self) else AROUND_M)
        self.road = ReplayRoad(network, self.np_random)
        self._path, self._progress = RecordedPath(self.scenario), 0.0
        ego = self._make_ego(self.road)
        self.controlled_vehicles = [ego]
        others = make_cast(self.road, self.scenario, self.config["mode"])[1:]
        hide_roles(self, others)
        self.road.enter(ego, others)

    def _make_ego(self, road: ReplayRoad) -> Vehicle:
        """The vehicle that the action type drives, at the ego's first state and with its route."""
        tracks, agent = self.scenario.tracks, self.scenario.ego
        start = Pose(*(float(values[0, 0]) for values in (tracks.x, tracks.y, tracks.yaw)))
        x, y, heading = to_highway(start)
        ego = self.action_type.vehicle_class(road, [x, y], float(heading), float(tracks.speed[0, 0]))
        ego.LENGTH, ego.WIDTH = agent.length, agent.width
        ego.diagonal = float(np.hypot(agent.length, agent.width))
        way = way_to_target(self.scenario.road, start, float(tracks.z[0, 0]), self.scenario.target)
        ego.route = route_along(road.network, way)
        return ego

    def _simulate(self, action: Any = None) -> None:
        super()._simulate(action)
        self._progress = self._path.advance(points_from_highway(self.vehicle.position))

    def _rewards(self, action: Any) -> dict[str, float]:
        return {"collision_reward": float(self.vehicle.crashed), "progress_reward": self._progress}

    def _info(self, obs: Any, action: Any = None) -> dict[str, Any]:
        before = self.road.moment - self.config["simulation_frequency"] // self.config["policy_frequency"]
        contacts = [name for step, name in self.road.contacts if step > before]
        return {
            "speed": self.vehicle.speed,
            "crashed": self.vehicle.crashed,
            "action": action,
            "rewards": self._rewards(action),
            "case": self.scenario.id,
            "step": self.road.moment,
            "contact": contacts[0] if contacts else None,
        }

    def _reward(self, action: Any) -> float:
        return sum(self.config[name] * value for name, value in self._rewards(action).items())

    def _is_terminated(self) -> bool:
        return bool(self.vehicle.crashed)

    def _is_truncated(self) -> bool:
        return self.road.moment >= self.scenario.tracks.steps - 1


def network_of(scenario: Scenario, around_m: float = AROUND_M) -> RoadNetwork:
    """The network within `around_m` of the tracks of all agents."""
    tracks = scenario.tracks
    points = np.stack([tracks.x, tracks.y], axis=-1)[tracks.valid][::_LOOK_EVERY]
    return build_network(with_lanes(scenario).road, points, around_m)


def with_lanes(scenario: Scenario) -> Scenario:
    """The case, with a lane along the ego's route on a map without any: highway-env has no road without lanes."""
    if scenario.road.lanes:
        return scenario
    limit = max(float(scenario.tracks.speed[0, 0]), ASSUMED_LIMIT_M_S)
    lane = Lane("route", route_of(scenario).points, _LANE_WIDTH_M, limit)
    return replace(scenario, road=replace(scenario.road, lanes=(lane,)))


def make_cast(road: ReplayRoad, scenario: Scenario, mode: Mode) -> list[ScriptedVehicle]:
    """Scripted vehicles for all agents of `scenario`, the ego first."""
    rows = range(len(scenario.agents))
    if mode == "track":
        return [ScriptedVehicle(road, scenario, row) for row in rows]
    controls = actions(scenario)
    return [ActionVehicle(road, scenario, row, controls[:, row]) for row in rows]
