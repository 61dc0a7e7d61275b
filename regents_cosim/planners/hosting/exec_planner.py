"""`exec:COMMAND`: a planner in any language that reads questions from stdin and answers on stdout, in JSON lines.

The command is split as a shell would, without a shell, and started once for many scenes. Every
question is one line and wants one line in answer; nothing else may go to stdout (stderr is free).
Frame: the map's own (x east, y north, metres), box centres, yaw counter-clockwise from +x.

A drive begins with `{"reset": SCENE}`, answered by `{"ok": true}`. SCENE has

- `id`; `dt` [s] between two questions; `steps`, the instants of the scene, one more than the questions;
- `ego`, a STATE: where the drive begins; `target` [x, y] [m]: where it should end;
- `others` [{`id`, `kind`, `length` [m], `width` [m]}]: all others that may turn up;
- `max_accel` [m/s^2] and `max_curvature` [1/m] of an answer, to either side;
- `lanes` [{`id`, `centre` [[x, y], ...] [m] in the direction of travel, `height` [m] of each of its points,
  `width` [m], `speed_limit` [m/s], `junction` (inside one), `left` and `right` (the lane one may change to, or null)}];
- `connections` [{`source`, `target`: lanes; `signal` (whose light holds there, or null), `link`}];
- `route`, from the start to the target and beyond: `points` [[x, y], ...] [m], one every metre, with `width` [m] and
  `speed_limit` [m/s] of each (null: not known); `lanes`, `changes`, `lights` and `meetings` as in `Scene.route`.

Every step asks `{"act": SIGHT}`. SIGHT has

- `step` (from 0) and `time_s` [s] since the beginning; `target` as before;
- `ego`, a STATE; its `acceleration` [m/s^2] and `yaw_rate` [rad/s] over the last step;
- `others` [STATE, ...]: those who are there now;
- `leader` {`agent`: a STATE, `gap` [m]}, who is next on the route, or null;
- `lights_ahead` [{`gap` [m] to the stop line, `lane`, `to_lane`, `shows`}] on the route;
- `lights` [{`lane` and `to_lane`: the way it is for; `x`, `y` [m]: the stop line;
  `shows`: SUMO's letter, r red, y yellow, g/G green, u red-yellow, s stop, o/O off}].

STATE is {`id`, `kind`, `x` [m], `y` [m], `yaw` [rad], `speed` [m/s], `length` [m], `width` [m], `z` [m] of the road
under it}. Kinds are car, truck, bus, motorcycle, bicycle, pedestrian and other. The answer is one of

- `{"accel": 0.5, "curvature": 0.01}` [m/s^2], [1/m] positive to the left, held until the next step;
- `{"waypoints": [[x, y], ...], "spacing_s": 0.5}`: where the ego should be after 1, 2, ... times `spacing_s` (0.5 if
  left out);
- one of these two with `"debug": {"candidates": [PATH, ...], "costs": [..], "chosen": PATH, "predictions": [PATH, ..],
  "text": ".."}`, each of them optional, PATH as `waypoints`: what films and the player show of it (`Debug`);
- `{"error": "why"}`, also to a reset: the planner gives this scene up.

After an answer of any other kind the command is ended, and started again for the next scene. When
its stdin ends it has a second to leave. POSIX only.
"""

import os
import select
import shlex
import shutil
import subprocess
import sys
import threading
import weakref
from collections import deque
from dataclasses import fields
from typing import IO, Any

import msgspec
import numpy as np

from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import PlannerError
from regents_cosim.planners.hosting.process_group import ProcessGroup
from regents_cosim.planners.interface import Control, Debug, Observation, Scene, Waypoints

_LINE_BYTES = 1 << 20  # of an answer, and of a line of stderr that is kept whole
_LAST_LINES = 20  # lines of stderr that a failure quotes
_QUOTED = 200  # characters of an answer that an error quotes
_LAST_WORDS_S = 2.0  # longest time that a command may take to end after it closes its stdout


class _Answer(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """All fields that an answer may have; the combination is checked with the question."""

    ok: bool | None = None
    accel: float | None = None
    curvature: float | None = None
    waypoints: list[tuple[float, float]] | None = None
    spacing_s: float = 0.5
    debug: dict[str, Any] | None = None
    error: str | None = None


class ExecPlanner:
    """A planner behind a command, which starts with the first scene."""

    def __init__(self, command: str) -> None:
        """Raises PlannerError where there is no such command."""
        try:
            self._words = shlex.split(command)
        except ValueError as error:
            raise PlannerError(f"planner 'exec:{command}': {error}, expected words as in a shell") from error
        if not self._words:
            raise PlannerError("planner 'exec:' names no command, expected for example `exec:python my_planner.py`")
        if shutil.which(self._words[0]) is None:
            raise PlannerError(
                f"planner 'exec:{command}': {self._words[0]!r} is neither an executable file nor on the PATH"
            )
        self._running: _CommandProcess | None = None

    def reset(self, scene: Scene) -> None:
        """Send the scene. Raises PlannerError."""
        if self._running is None:
            self._running = _CommandProcess(self._words)
            self._end = weakref.finalize(self, self._running.end)
        answer = self._ask("reset", _told(scene))
        if answer.ok is not True:
            raise self._given_up(f'answered {_said(answer)} to `reset`, expected {{"ok": true}}')

    def act(self, observation: Observation) -> Control | Waypoints:
        """Ask for a decision. Raises PlannerError."""
        answer = self._ask("act", _seen(observation))
        unknown = set(answer.debug or ()) - {field.name for field in fields(Debug)}
        if unknown:
            raise self._given_up(f"answered with a `debug` of unknown keys: {', '.join(sorted(unknown))}")
        debug = None if answer.debug is None else Debug(**answer.debug)
        if answer.waypoints is not None and answer.accel is None and answer.curvature is None:
            return Waypoints(np.array(answer.waypoints, float).reshape(-1, 2), answer.spacing_s, debug)
        if answer.accel is not None and answer.curvature is not None and answer.waypoints is None:
            return Control(answer.accel, answer.curvature, debug)
        raise self._given_up(
            f'answered {_said(answer)} to `act`, expected {{"accel": .., "curvature": ..}} or {{"waypoints": [..]}}'
        )

    def _ask(self, verb: str, what: dict[str, Any]) -> _Answer:
        assert self._running is not None
        try:
            line = self._running.ask(msgspec.json.encode({verb: what}, enc_hook=np.ndarray.tolist) + b"\n")
        except (BrokenPipeError, EOFError):
            raise self._given_up(f"ended instead of answering `{verb}`") from None
        except _UnaskedError as error:
            raise self._given_up(f"wrote {_quoted(error.text)} unasked, expected one line for every question") from None
        try:
            answer = from_json(line, _Answer)
        except msgspec.MsgspecError as error:
            raise self._given_up(f"answered {_quoted(line)} to `{verb}`, expected one JSON object: {error}") from None
        if answer.error is not None:
            raise PlannerError(f"the command gave `{verb}` up: {answer.error}")
        return answer

    def _given_up(self, what: str) -> PlannerError:
        """End the command, and make an error from its last lines on stderr."""
        self._running = None
        how, stderr = self._end() or ("", [])
        failure = PlannerError(f"the command {what} ({how})")
        if stderr:
            failure.add_note("The last lines of its stderr:\n" + "".join(stderr).rstrip())
        return failure


class _UnaskedError(Exception):
    """The command wrote more than it was asked for."""

    def __init__(self, text: bytes) -> None:
        super().__init__(text)
        self.text = text


class _CommandProcess:
    """The process of a command, with all processes that it starts."""

    def __init__(self, words: list[str]) -> None:
        pipe = subprocess.PIPE
        self._kept = ProcessGroup(words, stdin=pipe, stdout=pipe, stderr=pipe)
        process = self._kept.process
        assert process.stdin
        assert process.stdout
        assert process.stderr
        self._pipes = (process.stdin, process.stdout)
        self._to, self._from = process.stdin.fileno(), process.stdout.fileno()
        self._unread, self._at_end = b"", False
        self._last_lines: deque[str] = deque(maxlen=_LAST_LINES)
        self._listener = threading.Thread(target=self._pass_on, args=(process.stderr,), daemon=True)
        self._listener.start()

    def ask(self, line: bytes) -> bytes:
        """The answer to one line; waits for ever, as the process that hosts this one has the time limit."""
        if select.select([self._from], [], [], 0.0)[0]:
            self._read()
            raise _UnaskedError(self._unread)
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._to, rest) :]
        while b"\n" not in self._unread:
            if len(self._unread) > _LINE_BYTES:
                raise _UnaskedError(self._unread[:_QUOTED])
            self._read()
        answer, _, self._unread = self._unread.partition(b"\n")
        if self._unread:
            raise _UnaskedError(self._unread)
        return answer

    def end(self) -> tuple[str, list[str]]:
        """End it with all that it started; returns how it ended, and the last lines of its stderr."""
        how = self._kept.outcome(_LAST_WORDS_S if self._at_end else 0.0)
        self._kept.end()
        self._listener.join(_LAST_WORDS_S)
        for pipe in self._pipes:
            pipe.close()
        return how, list(self._last_lines)

    def _read(self) -> None:
        some = os.read(self._from, 1 << 16)
        if not some:
            self._at_end = True
            raise EOFError
        self._unread += some

    def _pass_on(self, stderr: IO[bytes]) -> None:
        with stderr:
            for line in iter(lambda: stderr.readline(_LINE_BYTES), b""):
                text = line.decode(errors="replace")
                self._last_lines.append(text)
                sys.stderr.write(text)


def _told(scene: Scene) -> dict[str, Any]:
    return {
        **_named(scene, "id", "dt", "steps", "ego", "target", "max_accel", "max_curvature"),
        "others": [_named(agent, "id", "kind", "length", "width") for agent in scene.others],
        **_named(scene.road, "lanes", "connections"),
        "route": _named(scene.route, "points", "width", "speed_limit", "lanes", "changes", "lights", "meetings"),
    }


def _seen(observation: Observation) -> dict[str, Any]:
    names = ("step", "time_s", "ego", "acceleration", "yaw_rate", "leader", "lights", "lights_ahead", "target")
    return {**_named(observation, *names), "others": list(observation.others)}


def _named(value: object, *names: str) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def _said(answer: _Answer) -> str:
    return _quoted(msgspec.json.encode(answer))


def _quoted(said: bytes) -> str:
    text = said.decode(errors="replace").strip()
    return repr(text if len(text) <= _QUOTED else text[:_QUOTED] + "...")
