"""`regents/SumoReplay-v0`: a case in a real SUMO as an environment, the ego driven by an agent."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box, Dict, MultiBinary
from jaxtyping import Float

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.mirror.programs.forked import require_own_threads
from regents_cosim.mirror.world import scene_origin
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.planners.closed_loop import move_by
from regents_cosim.planners.interface import Placement, Snapshot
from regents_cosim.replays.episode import AttackedEpisodes, Contacts, RecordedPath, choose_case, require_known
from regents_cosim.replays.sumo.replay import CaseToPlay
from regents_cosim.replays.sumo.session import SumoSession
from regents_cosim.reports.drawing.camera import centred
from regents_cosim.reports.drawing.film import Backdrop
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_moving
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.simulators.sumo.drivers import background_drivers
from regents_cosim.system.progress import DOING, progress_for


def attach_adversary(method: str, replan_s: float, sumo: Any, ego: str) -> Callable[[], dict[str, Any]]:
    """Attach a live adversary to a simulation, against an ego whose driver is unknown.

    It runs in SUMO's process. The returned function reports the adversary after each step.
    """
    from regents_cosim.live import Adversary

    config = live_config(method, samples=False)  # for many episodes
    adversary = Adversary(
        sumo, ego, "observed", config, replan_s=replan_s, horizon_s=_HORIZON_S, judged=False, tell=lambda _: None
    )
    DOING.tell_once(progress_for(True).say)

    def watch() -> dict[str, Any]:
        adversary.step()
        return {"adversary": adversary.adversary or "", "attacks": adversary.tally.attacks}

    return watch


BACKGROUNDS = ("log", "reactive", "live")
_HORIZON_S = 5.0  # that a live adversary looks ahead
_PX_PER_M = 6.0
_ZOOM = 2  # drawn larger by this factor, then reduced

Observation = dict[str, np.ndarray]


class SumoReplayEnv(gymnasium.Env[Any, np.ndarray]):
    """A case in SUMO, which runs in a separate process, so that there may be many environments.

    Configuration and options of `reset`: `case` (a folder) or `suite` (a folder of cases, from which the seed draws
    one); without either, the cases that come with the package. `background` log: all others follow the case. reactive:
    only the adversary does, SUMO drives the rest. live: SUMO drives all others, and in one of `every` episodes an
    adversary attacks the agent (`method` and `replan_s` as in `LiveAdversary`, whose `info` it has too). The episode
    ends with the ego's first contact, or with the case.

    Action, in [-1, 1]: acceleration and curvature (positive turns left) as shares of 7.6 m/s^2 and 0.3 /m, for one step
    of the case; the ego moves as it does for planners.

    Observation, float32:
    - `ego` [4]: x, y relative to the start [m], yaw counter-clockwise from east [rad], speed [m/s]
    - `others` [neighbours, 8]: the nearest, sorted by distance: centre ahead and to the left of the ego's [m], velocity
      relative to the ego's, ahead and to the left [m/s], cosine and sine of the yaw relative to the ego's, length and
      width [m]; 0 for unused rows
    - `present` [neighbours]: 1 for used rows, 0 for unused ones
    - `target` [2]: the ego's destination, ahead and to the left [m]
    - `time` [1]: the elapsed share of the case

    Rewards: progress along the recorded path (1 for all of it) and -1 for a collision.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """The defaults of all configuration keys."""
        return {
            "case": "",
            "suite": "",
            "background": "log",
            "method": "focused-live",  # of the live adversary
            "every": 1,  # one of this many episodes has it
            "replan_s": 0.5,  # between plans
            "neighbours": 8,
            "collision_reward": -1.0,
            "progress_reward": 1.0,
            "screen_width": 600,  # [px]
            "screen_height": 600,
        }

    def __init__(self, config: dict[str, Any] | None = None, render_mode: str | None = None) -> None:
        """Raises RegentsError for an unknown key or an invalid value."""
        require_known(config or {}, self.default_config(), "configuration key")
        self.config = self.default_config() | (config or {})
        background, neighbours = self.config["background"], self.config["neighbours"]
        require(
            background in BACKGROUNDS,
            f"background {background!r}, expected one of {', '.join(BACKGROUNDS)}",
            RegentsError,
        )
        require(
            isinstance(neighbours, int) and neighbours > 0,
            f"neighbours {neighbours!r}, expected a whole number above 0",
            RegentsError,
        )
        require(
            render_mode in (None, "rgb_array"), f"render_mode {render_mode!r}, expected None or rgb_array", RegentsError
        )
        self.render_mode = render_mode
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = Dict(
            {
                "ego": _numbers(4),
                "others": _numbers(neighbours, 8),
                "present": MultiBinary(neighbours),
                "target": _numbers(2),
                "time": Box(0.0, 1.0, (1,), np.float32),
            }
        )
        method, replan_s = self.config["method"], self.config["replan_s"]
        LiveSettings(replan_s, _HORIZON_S)  # checks the values
        live_config(method)
        self._attach = partial(attach_adversary, method, replan_s)
        self._episodes = AttackedEpisodes(self.config["every"])
        self._session = SumoSession()
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a case: that of `options`, of the configuration, or one drawn from a suite by the seed.

        Raises RegentsError for a case that cannot be played, and in a process that was forked from one in which JAX
        has run; SumoError where SUMO refuses.
        """
        require_own_threads()
        require_known(options or {}, ("case", "suite"), "option")
        super().reset(seed=seed)
        self._attacked = self._episodes.begin(seed)
        pool = options if options and any(options.values()) else self.config
        self.scenario = choose_case(pool.get("case"), pool.get("suite"), self.np_random)
        self._over = True  # until SUMO has begun
        answer = self._session.begin(self._case_to_play())
        self._frames, self._said = [answer.seen], answer.said
        self._origin = np.array([*scene_origin(self.scenario), 0.0, 0.0])
        self._half_length = jnp.array([0.5 * self.scenario.ego.length], jnp.float32)
        self._dt = jnp.float32(self.scenario.dt)
        self._path, self._progress = RecordedPath(self.scenario), 0.0
        self._contacts, self._hit = Contacts(self.scenario.agents), None
        self._contacts.at(self.seen)
        self._over, self._ground = False, None
        return self._observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Make one step of the case. Raises RegentsError where the episode is over, SumoError where SUMO dies."""
        require_own_threads()
        require(not self._over, "the episode is over, expected a reset before the next step", RegentsError)
        push = np.asarray(action, float).reshape(-1)
        require(
            push.shape == (2,) and bool(np.isfinite(push).all()),
            f"action {action!r}, expected two finite numbers: acceleration and curvature as shares of their limits",
            RegentsError,
        )
        self._over = True  # stays so if SUMO dies
        answer = self._session.go(self._moved(np.clip(push, -1.0, 1.0)))
        self._frames.append(answer.seen)
        self._said = answer.said
        now = self.seen
        self._progress = self._path.advance(np.array([now.x[0], now.y[0]]))
        touching = np.flatnonzero(self._contacts.at(now))
        self._hit = self.scenario.agents[touching[0]].id if len(touching) else None
        terminated = self._hit is not None
        truncated = len(self._frames) == self.scenario.tracks.steps
        self._over = terminated or truncated
        reward = sum(self.config[name] * value for name, value in self._rewards().items())
        return self._observation(), float(reward), terminated, truncated, self._info() | {"action": action}

    def render(self) -> np.ndarray | None:
        """Draw the traffic around the ego, [height, width, 3] uint8; needs no display."""
        if self.render_mode is None:
            gymnasium.logger.warn('nothing to render, expected render_mode="rgb_array" when the environment is made')
            return None
        require(hasattr(self, "scenario"), "nothing to render, expected a reset first", RegentsError)
        now, scene = self.seen, PicturedCase.of(self._so_far())
        size = self.config["screen_width"], self.config["screen_height"]
        if self._ground is None:
            view = centred(np.array([now.x[0], now.y[0]]), _PX_PER_M, size)
            self._ground = Backdrop(scene, view, _ZOOM), view
        ground, first = self._ground
        middle = first.left + 0.5 * first.width / first.px_per_m, first.top - 0.5 * first.height / first.px_per_m
        moved = (np.array([now.x[0], now.y[0]]) - middle) * [_PX_PER_M, -_PX_PER_M]
        view = first.shifted(*np.rint(moved).astype(int).tolist())
        canvas = ground.under(view)
        draw_moving(scene, canvas, view, len(self._frames) - 1)
        return np.asarray(canvas.finish())

    def close(self) -> None:
        """End SUMO; may be called twice."""
        self._session.close()
        self._over = True

    @property
    def seen(self) -> Snapshot:
        """The current state of all agents in the order of the case, as SUMO reports it (map frame, float64)."""
        return self._frames[-1]

    def _case_to_play(self) -> CaseToPlay:
        """The case and the agents that SUMO drives in it. With a live adversary the recorded crash is left out."""
        background, seed = self.config["background"], int(self.np_random.integers(2**31))
        attach = None
        if background == "live":
            self.scenario = self.scenario.before_attack()
            attach = self._attach if self._attacked else None
        released = () if background == "log" else background_drivers(self.scenario)
        return CaseToPlay(self.scenario, released, seed, attach=attach)

    def _said_live(self) -> dict[str, Any]:
        """The part of `info` about a live adversary."""
        if self.config["background"] != "live":
            return {}
        return {"attacked": self._attacked, "adversary": "", "attacks": 0} | self._said

    def _moved(self, share: Float[np.ndarray, " 2"]) -> Placement:
        ego = np.array([values[0] for values in self.seen[:4]]) - self._origin
        control = float(share[0]) * ACCEL_LIMIT, float(share[1]) * CURVATURE_LIMIT
        ahead = move_by(self.scenario.dynamics, self._half_length, self._dt, ego, control) + self._origin
        return Placement(*ahead.tolist())

    def _rewards(self) -> dict[str, float]:
        return {"collision_reward": float(self._hit is not None), "progress_reward": self._progress}

    def _info(self) -> dict[str, Any]:
        return {
            "speed": float(self.seen.speed[0]),
            "crashed": self._hit is not None,
            "rewards": self._rewards(),
            "case": self.scenario.id,
            "step": len(self._frames) - 1,
            "contact": self._hit,
            **self._said_live(),
        }

    def _observation(self) -> Observation:
        now, begin = self.seen, self._frames[0]
        x, y, yaw, speed = (float(values[0]) for values in now[:4])
        away = np.hypot(now.x - x, now.y - y)
        near = [index for index in np.argsort(away, kind="stable").tolist() if index > 0 and now.valid[index]]
        near = near[: self.config["neighbours"]]
        others = np.zeros((self.config["neighbours"], 8), np.float32)
        present = np.zeros(self.config["neighbours"], np.int8)
        turn = now.yaw[near] - yaw
        others[: len(near), 0:2] = np.stack(ahead_and_left(np, now.x[near] - x, now.y[near] - y, yaw), axis=-1)
        others[: len(near), 2] = now.speed[near] * np.cos(turn) - speed
        others[: len(near), 3] = now.speed[near] * np.sin(turn)
        others[: len(near), 4:6] = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        sizes = [(self.scenario.agents[index].length, self.scenario.agents[index].width) for index in near]
        others[: len(near), 6:8] = np.array(sizes).reshape(-1, 2)
        present[: len(near)] = 1
        goal_x, goal_y = self.scenario.target
        return {
            "ego": np.array([x - begin.x[0], y - begin.y[0], yaw, speed], np.float32),
            "others": others,
            "present": present,
            "target": np.array(ahead_and_left(np, goal_x - x, goal_y - y, yaw), np.float32),
            "time": np.array([(len(self._frames) - 1) / (self.scenario.tracks.steps - 1)], np.float32),
        }

    def _so_far(self) -> Scenario:
        """The case as played so far; afterwards the ego stands still and all others are absent."""
        missing = self.scenario.tracks.steps - len(self._frames)
        ego_alone = self.seen._replace(valid=np.arange(len(self.scenario.agents)) == 0)
        columns = (np.stack(values, axis=1) for values in zip(*self._frames, *[ego_alone] * missing, strict=True))
        tracks = Tracks(**dict(zip(Snapshot._fields, columns, strict=True)))
        return replace(self.scenario, tracks=tracks, attack=None, log=None, judgement=None, evasion=None)


def _numbers(*shape: int) -> Box:
    return Box(-np.inf, np.inf, shape, np.float32)
