"""The process that hosts a planner: `host_process` starts, asks and ends it. It imports no JAX.

Whatever the planner prints goes to stderr, so that tables on stdout stay clean.
"""

import faulthandler
import fcntl
import math
import os
import resource
import secrets
import signal
import socket
import time
import traceback
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from regents_cosim.errors import RegentsError
from regents_cosim.geometry.lines import length_of
from regents_cosim.planners.find import make_planner
from regents_cosim.planners.hosting import host_messages as messages
from regents_cosim.planners.hosting.debug_message import debug_message
from regents_cosim.planners.hosting.message_socket import MessageSocket
from regents_cosim.planners.interface import (
    EXPECTED_PLACE,
    AgentState,
    BatchPlanner,
    Control,
    Debug,
    Decision,
    Observation,
    Others,
    Placement,
    Planner,
    Scene,
    Waypoints,
    can_be_at,
)
from regents_cosim.routes.route import AHEAD_S, LEAST_AHEAD_M, curvature_through
from regents_cosim.system import foreign_code as foreign
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.standard_streams import print_on


# Turn waypoints into a control: pure pursuit for the curvature, the pace of the points for the speed.
def follow(waypoints: Waypoints, ego: AgentState, scene: Scene) -> Control:
    """The control that brings `ego` along `waypoints`, within the limits of `scene`.

    The wanted speed is the mean pace up to the second point; the curvature leads through the first point that is far
    enough ahead (Coulter 1992).
    """
    points = np.asarray(waypoints.points, float)
    ahead = points - [ego.x, ego.y]
    horizon = min(len(points), 2)
    wanted = length_of(np.vstack([[0.0, 0.0], ahead[:horizon]])) / (horizon * waypoints.spacing_s)
    # Under constant acceleration the speed half-way through the horizon is the mean pace.
    accel = 2.0 * (wanted - ego.speed) / (horizon * waypoints.spacing_s)
    accel = max(accel, -ego.speed / scene.dt)
    return Control(
        float(np.clip(accel, -scene.max_accel, scene.max_accel)),
        float(np.clip(_curvature(ahead, ego), -scene.max_curvature, scene.max_curvature)),
    )


def _curvature(ahead: np.ndarray, ego: AgentState) -> float:
    away = np.hypot(*ahead.T)
    far_enough = np.flatnonzero(away >= max(LEAST_AHEAD_M, AHEAD_S * ego.speed))
    aim = int(far_enough[0]) if len(far_enough) else len(ahead) - 1
    if away[aim] < 0.1:
        return 0.0
    return curvature_through(float(ahead[aim, 0]), float(ahead[aim, 1]), ego.yaw)


_TOLERANCE = 1e-6  # tolerated rounding beyond a limit
_OURS = (__file__, foreign.__file__)
_MOST_DESCRIPTORS = 1024  # descriptors that are searched for a number that is hard to guess


def serve(connection: int, stacks: int) -> None:
    """Answer the questions on the socket `connection` until it closes; stacks of a hanging planner go to `stacks`."""
    faulthandler.register(signal.SIGUSR1, _hidden(stacks), all_threads=True)
    print_on()
    talk = MessageSocket(socket.socket(fileno=_hidden(connection)), limit_bytes=None)
    os.register_at_fork(after_in_child=talk.close)  # a fork must not answer as well
    served = ServedPlanner()
    while True:
        try:
            question = messages.questions.decode(talk.receive())
            talk.send(messages.encoder.encode(served.answered(question)))
        except (EOFError, OSError):  # the parent is gone, or this is a fork
            os._exit(0)


def _hidden(descriptor: int) -> int:
    """The descriptor under a number that code does not find by counting up."""
    most = min(resource.getrlimit(resource.RLIMIT_NOFILE)[0], _MOST_DESCRIPTORS)
    lowest = most // 2 + secrets.randbelow(most // 4)
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, lowest)
    os.close(descriptor)
    return moved


def _raised(number: int, error: BaseException) -> messages.Raised:
    """The error, with the planner's own part of its traceback."""
    place = error.__traceback__
    while place is not None and place.tb_frame.f_code.co_filename in _OURS:
        place = place.tb_next
    try:
        said = said_by(error)
        trace = "".join(traceback.format_exception(type(error), error, place)) if place is not None else ""
    except BaseException as second:  # raised by its `__str__`
        said, trace = f"{type(error).__name__}, whose text cannot be had: {type(second).__name__}", ""
    return messages.Raised(number, _sent(said, messages.SUMMARY_LIMIT), _sent(trace, messages.TRACE_LIMIT))


def _sent(text: str, limit: int) -> str:
    """At most `limit` characters, all of which can be encoded."""
    return messages.shortened(text, limit).encode(errors="backslashreplace").decode()[:limit]


class _PlannerRaisedError(Exception):
    """Wraps an error that a planner raised."""

    def __init__(self, error: BaseException) -> None:
        super().__init__()
        self.error = error


class ServedPlanner:
    """The planner, and the scenes of its drive."""

    def __init__(self, planner: Planner | None = None) -> None:
        """Without a `planner`, the first question makes it."""
        self._given = planner
        self._scenes: list[Scene] = []
        self._before: list[AgentState | None] = []  # the egos at the previous step

    def answered(self, question: messages.Question) -> messages.Reply:
        """The answer to one question, or the error that the planner raised."""
        try:
            with foreign_code(_PlannerRaisedError):
                return self._answer(question)
        except _PlannerRaisedError as failure:
            return _raised(question.number, failure.error)
        except RegentsError as error:
            return _raised(question.number, error)

    def _answer(self, question: messages.Question) -> messages.Reply:
        match question:
            case messages.Make():
                self._planner: Planner = make_planner(question.planner) if self._given is None else self._given
                self._batches = self._planner if isinstance(self._planner, BatchPlanner) else None
                return messages.PlannerMade(question.number, self._batches is not None)
            case messages.Reset():
                self._reset(question.scenes)
                return messages.Done(question.number)
            case messages.Decide():
                return messages.Decided(question.number, self._act(question))

    def _reset(self, scenes: list[Scene] | None) -> None:
        """Begin the drives in `scenes`; None: in the scenes of the previous drive."""
        if scenes is not None:
            self._scenes = scenes
        self._before = [None] * len(self._scenes)
        if self._batches is not None:
            self._batches.reset_batch(list(self._scenes))
        else:
            (scene,) = self._scenes
            self._planner.reset(scene)

    def _act(self, question: messages.Decide) -> list[messages.Answer]:
        told = zip(self._scenes, map(messages.unpacked, question.seen), self._before, strict=True)
        observations = [_observation(scene, question.step, one, before) for scene, one, before in told]
        self._before = [observation.ego for observation in observations]
        begin = time.perf_counter()
        if self._batches is not None:
            made = self._batches.act_batch(observations)
            if not isinstance(made, Iterable):
                raise TypeError(f"`act_batch` returned a {type(made).__name__}, expected a list of decisions")
            decisions = list(made)
            if len(decisions) != len(observations):
                raise TypeError(f"`act_batch` gave {len(decisions)} decisions for {len(observations)} observations")
        else:
            decisions = [self._planner.act(observations[0])]
        seconds = (time.perf_counter() - begin) / len(observations)
        checked = [_checked(made, o) for made, o in zip(decisions, observations, strict=True)]
        return [_answer(decision, seconds, question.debug) for decision in checked]


def _observation(scene: Scene, step: int, seen: tuple[np.ndarray, ...], before: AgentState | None) -> Observation:
    x, y, yaw, speed, _, z = (float(values[0]) for values in seen)
    ego = replace(scene.ego, x=x, y=y, yaw=yaw, speed=speed, z=z)
    return Observation(scene, step, ego, Others(scene.others, *(values[1:] for values in seen)), before)


def _answer(decision: Control | Placement, seconds: float, with_debug: bool) -> messages.Answer:
    if isinstance(decision, Control):
        debug = None if decision.debug is None else debug_message(decision.debug)
        control = decision.accel, decision.curvature
        return messages.Answer(seconds, control, debug=debug if with_debug else None)
    return messages.Answer(seconds, placement=(decision.x, decision.y, decision.yaw, decision.speed))


def _checked(decision: Decision, observation: Observation) -> Control | Placement:
    """A decision as plain numbers. Raises TypeError or ValueError with what was expected."""
    debug = getattr(decision, "debug", None)
    if not isinstance(debug, Debug | None):
        raise TypeError(f"debug is a {type(debug).__name__}, expected a Debug or None")
    if isinstance(decision, Waypoints):
        points = np.asarray(decision.points)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise ValueError(f"waypoints of shape {list(points.shape)}, expected [point, 2] with at least one point")
        spacing_s = _number(decision.spacing_s, "spacing_s", "s", np.inf)
        if not np.isfinite(np.asarray(points, float)).all() or not spacing_s > 0:
            raise ValueError("waypoints that are not finite, or not a positive time apart")
        with np.errstate(over="ignore", invalid="ignore"):  # what is too far away has no finite control
            return _checked(replace(follow(decision, observation.ego, observation.scene), debug=debug), observation)
    if isinstance(decision, Control):
        scene = observation.scene
        return Control(
            _number(decision.accel, "accel", "m/s^2", scene.max_accel),
            _number(decision.curvature, "curvature", "1/m", scene.max_curvature),
            debug,
        )
    if isinstance(decision, Placement):
        x, y, yaw = (_number(getattr(decision, name), name, "", np.inf) for name in ("x", "y", "yaw"))
        placed = Placement(x, y, yaw, max(_number(decision.speed, "speed", "m/s", np.inf), 0.0))
        if not can_be_at((observation.scene.ego.x, observation.scene.ego.y), placed):
            raise ValueError(f"{placed}, {EXPECTED_PLACE}")
        return placed
    raise TypeError(f"`act` returned a {type(decision).__name__}, expected Control(accel, curvature) or Waypoints")


def _number(value: Any, name: str, unit: str, limit: float) -> float:
    shape = np.shape(value)
    if shape != ():
        raise ValueError(f"{name} of shape {list(shape)}, expected a single number")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise type(error)(f"{name}: {error}, expected a single number") from error
    if not math.isfinite(number):
        raise ValueError(f"{name} is {number}, expected a finite number")
    if abs(number) > limit + _TOLERANCE:
        raise ValueError(f"{name} {number:g} {unit} is beyond the limit, expected {-limit:g} to {limit:g}")
    return min(max(number, -limit), limit)
