"""Somebody's planner in a process of its own, where it may raise, hang or exit and costs its drive only.

The process is spawned and imports no JAX. Questions and answers go through a pipe: about 0.1 ms
for each. What the planner prints goes to stderr, so that tables on stdout stay clean.
"""

import faulthandler
import multiprocessing
import operator
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from regents_cosim.errors import DriveError
from regents_cosim.planners.find import make_planner
from regents_cosim.planners.interface import (
    BatchPlanner,
    Control,
    Decision,
    Observation,
    Others,
    Placement,
    Planner,
    Scene,
    Seen,
    Waypoints,
)
from regents_cosim.planners.waypoints import follow
from regents_cosim.workers import main_hidden

START_S = 120.0  # the planner's imports, its construction and every `reset` may take so long
_TOLERANCE = 1e-6  # rounding beyond a limit


@dataclass(frozen=True)
class Answer:
    """A decision within the limits, and how long it took."""

    decision: Control | Placement
    seconds: float


class HostProcess:
    """The process, and the conversation with it. Use it from one thread at a time."""

    def __init__(self, name: str, act_timeout_s: float) -> None:
        self._name = name
        self._act_timeout_s = act_timeout_s
        self._pipe: Any = None  # a connection while the process runs
        self._batches = False
        self._told: list[Scene] = []  # what the process has been sent

    def reset(self, scenes: Sequence[Scene]) -> None:
        """Begin a drive in each of `scenes`. Raises DriveError."""
        if self._pipe is None:
            self._start()
        # An attack drives the same scenes dozens of times, and the map of a city takes 9 ms to send.
        known = len(scenes) == len(self._told) and all(map(operator.is_, scenes, self._told))
        self._told = list(scenes)
        self._ask(("reset", None if known else self._told), START_S, "in `reset`")

    def act(self, step: int, seen: Sequence[Seen]) -> list[Answer]:
        """Decisions for all scenes of the drive. Raises DriveError."""
        return self._ask(("act", step, list(seen)), self._act_timeout_s, f"in `act` at step {step}")

    def batches(self) -> bool:
        """Whether the planner drives many scenes at once. Raises DriveError where it cannot be made."""
        if self._pipe is None:
            self._start()
        return self._batches

    def close(self) -> None:
        """End the process."""
        if self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            os.unlink(self._stacks)
            self._pipe = None

    def _start(self) -> None:
        self._told = []
        context = multiprocessing.get_context("spawn")
        handle, self._stacks = tempfile.mkstemp(suffix=".txt")
        os.close(handle)
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._name, self._stacks), daemon=True)
        with main_hidden():
            self._process.start()
        theirs.close()
        try:
            self._batches = self._ask(("start",), START_S, "when it was made")
        except DriveError:
            self.close()
            raise

    def _ask(self, question: tuple[Any, ...], timeout_s: float, when: str) -> Any:
        assert self._pipe is not None
        try:
            self._pipe.send(question)
            if not self._pipe.poll(timeout_s):
                stack = self._stack()
                raise self._lost(f"gave no answer within {timeout_s:g} s {when}", stack)
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            self._process.join(timeout=5.0)
            code = self._process.exitcode
            raise self._lost(f"ended its process {when} (exit code {code})", "") from error
        if isinstance(answer, _Raised):
            raise DriveError(f"planner {self._name!r} failed {when}: {answer.summary}", answer.trace)
        return answer

    def _lost(self, what: str, trace: str) -> DriveError:
        """What to say of a process that is of no more use."""
        self.close()
        return DriveError(f"planner {self._name!r} {what}", trace)

    def _stack(self) -> str:
        """Where the planner is right now."""
        if not hasattr(signal, "SIGUSR1"):
            return ""
        os.kill(self._process.pid or 0, signal.SIGUSR1)
        time.sleep(0.2)
        with open(self._stacks) as file:
            return file.read()


# --- inside the process -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Raised:
    """An exception of the planner's, as text: its class may not exist elsewhere."""

    summary: str
    trace: str


def _serve(pipe: Connection, name: str, stacks: str) -> None:
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    with open(stacks, "w") as file:
        if hasattr(signal, "SIGUSR1"):
            faulthandler.register(signal.SIGUSR1, file)
        seat = _Seat(name)
        while True:
            try:
                question = pipe.recv()
            except EOFError:
                return
            try:
                answer = seat.answer(*question)
            except BaseException as error:  # somebody else's code, `sys.exit` included
                answer = _raised(error)
            pipe.send(answer)


def _raised(error: BaseException) -> _Raised:
    """The error, and the part of its traceback that is the planner's own."""
    summary = " ".join(f"{type(error).__name__}: {error}".split())
    place = error.__traceback__
    while place is not None and place.tb_frame.f_code.co_filename == __file__:
        place = place.tb_next
    trace = "".join(traceback.format_exception(type(error), error, place)) if place is not None else ""
    return _Raised(summary, trace)


class _Seat:
    """The planner, and the scenes that it drives in."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._scenes: list[Scene] = []

    def answer(self, verb: str, *given: Any) -> Any:
        """The answer to one question."""
        return getattr(self, f"_{verb}")(*given)

    def _start(self) -> bool:
        self._planner: Planner = make_planner(self._name)
        return isinstance(self._planner, BatchPlanner)

    def _reset(self, scenes: list[Scene] | None) -> None:
        """None: the scenes of the drive before."""
        if scenes is not None:
            self._scenes = scenes
        if isinstance(self._planner, BatchPlanner):
            self._planner.reset_batch(list(self._scenes))
        else:
            (scene,) = self._scenes
            self._planner.reset(scene)

    def _act(self, step: int, seen: list[Seen]) -> list[Answer]:
        observations = [_observation(scene, step, one) for scene, one in zip(self._scenes, seen, strict=True)]
        begin = time.perf_counter()
        if isinstance(self._planner, BatchPlanner):
            decisions = list(self._planner.act_batch(observations))
            if len(decisions) != len(observations):
                raise TypeError(f"`act_batch` gave {len(decisions)} decisions for {len(observations)} observations")
        else:
            decisions = [self._planner.act(observations[0])]
        seconds = (time.perf_counter() - begin) / len(observations)
        return [Answer(_checked(made, o), seconds) for made, o in zip(decisions, observations, strict=True)]


def _observation(scene: Scene, step: int, seen: Seen) -> Observation:
    x, y, yaw, speed = (float(values[0]) for values in seen[:4])
    ego = replace(scene.ego, x=x, y=y, yaw=yaw, speed=speed)
    return Observation(scene, step, ego, Others(scene.others, *(values[1:] for values in seen)))


def _checked(decision: Decision, observation: Observation) -> Control | Placement:
    """A decision as plain numbers. Raises TypeError or ValueError with what was expected."""
    if isinstance(decision, Waypoints):
        points = np.asarray(decision.points)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise ValueError(f"waypoints of shape {list(points.shape)}, expected [point, 2] with at least one point")
        if not np.isfinite(np.asarray(points, float)).all() or not decision.spacing_s > 0:
            raise ValueError("waypoints that are not finite, or not a positive time apart")
        return follow(decision, observation.ego, observation.scene)
    if isinstance(decision, Control):
        scene = observation.scene
        return Control(
            _number(decision.accel, "accel", "m/s^2", scene.max_accel),
            _number(decision.curvature, "curvature", "1/m", scene.max_curvature),
        )
    if isinstance(decision, Placement):
        x, y, yaw = (_number(getattr(decision, name), name, "", np.inf) for name in ("x", "y", "yaw"))
        return Placement(x, y, yaw, max(_number(decision.speed, "speed", "m/s", np.inf), 0.0))
    raise TypeError(f"`act` returned a {type(decision).__name__}, expected Control(accel, curvature) or Waypoints")


def _number(value: Any, name: str, unit: str, limit: float) -> float:
    shape = np.shape(value)
    if shape != ():
        raise ValueError(f"{name} of shape {list(shape)}, expected a single number")
    number = float(value)
    if not np.isfinite(number):
        raise ValueError(f"{name} is {number}, expected a finite number")
    if abs(number) > limit + _TOLERANCE:
        raise ValueError(f"{name} {number:g} {unit} is beyond the limit, expected {-limit:g} to {limit:g}")
    return float(np.clip(number, -limit, limit))
