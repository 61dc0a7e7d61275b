"""Host a planner in its own process, where it may raise, hang, exit or print, and loses only its drive.

The process imports no JAX. Questions and answers go over a pair of sockets, about 0.1 ms each, in messages of a fixed
schema and bounded length (`host_messages`, `message_socket`): whatever the planner does to its end, nothing of it is
executed here, and nothing waits past a deadline. The process is ended with all that it started (`process_group`).
"""

import math
import operator
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Protocol, TypeVar, runtime_checkable

import msgspec

from regents_cosim.errors import DriveError
from regents_cosim.planners.hosting import host_messages as messages
from regents_cosim.planners.hosting.message_socket import MessageError, MessageSocket
from regents_cosim.planners.hosting.object_transport import Pickled
from regents_cosim.planners.hosting.own_interpreter import FOLDER, LOAD, OwnInterpreter
from regents_cosim.planners.hosting.process_group import ProcessGroup
from regents_cosim.planners.interface import Placement, Scene, Snapshot, can_be_at
from regents_cosim.planners.time_limits import Deadlines
from regents_cosim.system.processes import python_flags
from regents_cosim.system.user_code import searched_first

_LAST_WORDS_S = 2.0  # longest time that a process may take to end after it closes its socket
_STACK_S = 0.5  # longest time that a process may take to report its stack
_STACK_BYTES = 1 << 16
_SERVE = "from regents_cosim.planners.hosting.host_server import serve; serve(int(connection), int(stacks))"
# The process searches modules where this process does, in folders of users last until it has what it needs itself,
_BOOT = (
    "import sys; connection, stacks, count, *places = sys.argv[1:]; del sys.argv[1:]; "
    "sys.path[:] = places[int(count):] + places[:int(count)]; "
    f"import regents_cosim.planners.hosting.host_server; sys.path[:] = places; {_SERVE}"
)
# or in an environment of its own.
_BOOT_ELSEWHERE = f"import sys; {LOAD}connection, stacks = sys.argv[1:]; del sys.argv[1:]; {_SERVE}"

_Expected = TypeVar("_Expected", messages.PlannerMade, messages.Done, messages.Decided)


@runtime_checkable
class QuestionServer(Protocol):
    """A server of questions: `host_server` in its own process, or in this one."""

    def ask(self, question: bytes, timeout_s: float) -> bytes:
        """The answer. Raises TimeoutError, EOFError, OSError, MessageError."""
        ...

    def stack(self) -> str:
        """The planner's present stack."""
        ...

    def outcome(self) -> str:
        """How it ended."""
        ...

    def end(self) -> None:
        """End it; a thread that waits for an answer gets an error."""
        ...


class HostProcess:
    """The host of a planner; use it from one thread at a time, though any thread may close it."""

    def __init__(
        self,
        name: str,
        patience: Deadlines | None = None,
        planner: str | Pickled | None = None,
        here: Callable[[], QuestionServer] | None = None,
    ) -> None:
        """`patience` is shared by all processes of a planner; `planner` makes it, by default its name.

        With `here` the planner is served in this process, by what that makes.
        """
        self._name, self._patience = name, patience or Deadlines()
        made_of = name if planner is None else planner
        elsewhere = OwnInterpreter.named(made_of) if isinstance(made_of, str) else None
        self._serving = here or partial(_ServingProcess, elsewhere and elsewhere.python)
        self._planner = elsewhere.planner if elsewhere else made_of
        self._running: QuestionServer | None = None
        self._batches = self._closed = False
        self._asked = 0  # number of the last question
        self._told: list[Scene] = []  # scenes that were sent to the process

    def reset(self, scenes: Sequence[Scene]) -> None:
        """Begin a drive in each of `scenes`. Raises DriveError."""
        self._patience.check()
        running = self._running or self._start()
        # An attack drives the same scenes dozens of times, and the map of a city takes 9 ms to send.
        known = len(scenes) == len(self._told) and all(map(operator.is_, scenes, self._told))
        self._told = list(scenes)
        question = messages.Reset(self._number(), None if known else self._told)
        try:
            self._ask(running, question, messages.Done, self._patience.reset_s, "in `reset`")
        except _HungError as failure:
            raise self._patience.hung(failure, in_reset=True) from failure
        self._patience.has_reset()

    def act(self, step: int, seen: Sequence[Snapshot], debug: bool = False) -> list[messages.Answer]:
        """Decisions for all scenes of the drive; with `debug` what the planner thought as well. Raises DriveError."""
        running, when = self._running, f"in `act` at step {step}"
        if running is None:
            raise DriveError(f"planner {self._name!r} was ended {when}")
        question = messages.Decide(self._number(), step, [messages.packed(one) for one in seen], debug)
        decided = self._ask(running, question, messages.Decided, self._patience.act_s, when)
        if len(decided.answers) != len(seen) or not all(map(_fits, decided.answers, self._told)):
            raise self._lost(running, f"broke the protocol {when}: no decision within the limits for each scene")
        return decided.answers

    def batches(self) -> bool:
        """Whether the planner drives many scenes at once. Raises DriveError where it cannot be made."""
        if self._running is None:
            self._start()
        return self._batches

    def close(self) -> None:
        """End the process, and all that it started, for good."""
        self._closed = True
        running, self._running = self._running, None
        if running is not None:
            running.end()

    def _number(self) -> int:
        """The number of the next question, which its answer has to repeat."""
        self._asked += 1
        return self._asked

    def _start(self) -> QuestionServer:
        self._patience.check()
        if self._closed:
            raise DriveError(f"planner {self._name!r} is not started any more: its process was closed")
        self._told = []
        try:
            running = self._running = self._serving()
        except OSError as error:
            raise DriveError(f"planner {self._name!r} has no process: {error}, expected room for one more") from error
        try:
            question = messages.Make(self._number(), self._planner)
            made = self._ask(running, question, messages.PlannerMade, self._patience.make_s, "when it was made")
            self._batches = made.batches
        except _HungError as failure:
            raise self._patience.hung(failure, in_reset=False) from failure
        except DriveError:
            self._running = None
            running.end()
            raise
        return running

    def _ask(
        self,
        running: QuestionServer,
        question: messages.Question,
        expected: type[_Expected],
        timeout_s: float,
        when: str,
    ) -> _Expected:
        try:
            reply = messages.replies.decode(running.ask(messages.encoder.encode(question), timeout_s))
        except TimeoutError:
            stack = running.stack()
            raise self._lost(running, f"gave no answer within {timeout_s:g} s {when}", stack, _HungError) from None
        except (EOFError, OSError) as error:
            raise self._lost(running, f"ended its process {when} ({running.outcome()})") from error
        except (MessageError, msgspec.MsgspecError) as error:
            raise self._lost(running, f"broke the protocol {when}: {error}") from error
        if reply.number != question.number:
            raise self._lost(running, f"broke the protocol {when}: an answer to another question")
        if isinstance(reply, messages.Raised):
            raise DriveError(f"planner {self._name!r} failed {when}: {reply.summary}", reply.trace)
        if not isinstance(reply, expected):
            raise self._lost(running, f"broke the protocol {when}: {type(reply).__name__} for an answer")
        return reply

    def _lost(
        self, running: QuestionServer, what: str, trace: str = "", kind: type[DriveError] = DriveError
    ) -> DriveError:
        """End a lost process, and make the error."""
        if self._running is running:
            self._running = None
        running.end()
        return kind(f"planner {self._name!r} {what}", trace)


class _HungError(DriveError):
    """The planner gave no answer in time."""


class _ServingProcess:
    """A process that runs `host_server`, in the interpreter `python` if one is given."""

    def __init__(self, python: str | None) -> None:
        ours, theirs = socket.socketpair()
        self._stacks, stacks = os.pipe()
        given = (theirs.fileno(), stacks)
        fds = map(str, given)
        if python is None:
            of_users = searched_first()
            others = [place for place in sys.path if place not in of_users]
            command = [sys.executable, *python_flags(), "-c", _BOOT, *fds, str(len(of_users)), *of_users, *others]
        else:
            command = [python, "-P", "-c", _BOOT_ELSEWHERE, FOLDER, *fds]
        try:
            self._kept = ProcessGroup(command, pass_fds=given, stdin=subprocess.DEVNULL, stdout=2)
        except BaseException:
            ours.close()
            os.close(self._stacks)
            raise
        finally:
            theirs.close()
            os.close(stacks)
        self._talk = MessageSocket(ours)
        self._in_use = threading.Lock()  # guards the descriptors
        self._ended = False

    def ask(self, question: bytes, timeout_s: float) -> bytes:
        """The answer. Raises TimeoutError, EOFError, OSError, MessageError."""
        with self._in_use:
            if self._ended:
                raise EOFError
            if unasked := self._talk.unasked():
                raise MessageError(f"{unasked!r} unasked")
            deadline = time.monotonic() + timeout_s
            self._talk.send(question, deadline)
            return self._talk.receive(deadline)

    def stack(self) -> str:
        """The planner's present stack."""
        with self._in_use, suppress(OSError):
            if self._ended:
                return ""
            os.kill(self._kept.process.pid, signal.SIGUSR1)
            found = b""
            while len(found) < _STACK_BYTES and select.select([self._stacks], [], [], _STACK_S)[0]:
                if not (piece := os.read(self._stacks, _STACK_BYTES)):
                    break
                found += piece
            return messages.shortened(found.decode(errors="replace"), messages.TRACE_LIMIT)
        return ""

    def outcome(self) -> str:
        """How it ended."""
        return self._kept.outcome(_LAST_WORDS_S)

    def end(self) -> None:
        """Kill it with all that it started; a thread that waits for an answer gets an error."""
        self._kept.end()
        self._talk.hang_up()
        with self._in_use:
            if not self._ended:
                self._talk.close()
                os.close(self._stacks)
            self._ended = True


def _fits(answer: messages.Answer, scene: Scene) -> bool:
    """Whether an answer is one decision within the limits; the server's own check may be tampered with."""
    if answer.control is not None:
        accel, curvature = answer.control
        ok = answer.placement is None and abs(accel) <= scene.max_accel and abs(curvature) <= scene.max_curvature
    else:
        placed = answer.placement
        ok = placed is not None and can_be_at((scene.ego.x, scene.ego.y), Placement(*placed))
    return ok and 0.0 <= answer.seconds < math.inf and (answer.debug is None or answer.debug.sound)
