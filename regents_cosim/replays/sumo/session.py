"""Runs SUMO step by step in a separate process that plays cases one after the other; the caller moves the ego.

SUMO may crash, and allows one simulation per process; here a crash only raises an error.
"""

import multiprocessing
from collections.abc import Callable, Collection
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.planners.interface import Snapshot
from regents_cosim.replays.ego_controller import EgoState
from regents_cosim.replays.sumo.replay import replay_in_sumo
from regents_cosim.scenario import Scenario
from regents_cosim.system.foreign_code import OwnSignal
from regents_cosim.system.processes import begin_child, end_with_this_process, has_ended, starting

_START_S = 120.0  # for the imports of a process and the network of a city
_STEP_S = 30.0
_ATTACHED_STEP_S = 300.0  # the first step compiles programs


@dataclass(frozen=True, eq=False)
class CaseToPlay:
    """A case to play, with the ego moved by the caller."""

    scenario: Scenario
    released: Collection[int]  # agents that SUMO drives, by index
    seed: int
    attach: Callable[[Any, str], Callable[[], dict[str, Any]]] | None = None  # reports something after each step


class SumoAnswer(NamedTuple):
    """The state after a step, and the report of the attached code."""

    seen: Snapshot
    said: dict[str, Any]


class SumoSession:
    """The process and the connection to it. Use it from one thread at a time."""

    def __init__(self) -> None:
        self._pipe: Any = None  # a connection while the process runs
        self._step_s = _STEP_S

    def begin(self, play: CaseToPlay) -> SumoAnswer:
        """Begin a case, ending the current one if any, and return all agents at step 0. Raises SumoError."""
        if self._pipe is None:
            self._start()
        self._step_s = _STEP_S if play.attach is None else _ATTACHED_STEP_S
        return self._ask(play, _START_S + self._step_s, "when it began a case")

    def go(self, ego: EgoState) -> SumoAnswer:
        """Move the ego to the given state, and return all agents one step later. Raises SumoError."""
        if self._pipe is None:
            raise SumoError("SUMO is not running, expected a case to be begun first")
        return self._ask(ego, self._step_s, "in a step")

    def close(self) -> None:
        """End the process; may be called twice."""
        if self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            has_ended(self._process)
            self._pipe = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        end_with_this_process(self._process)
        with starting():
            self._process.start()
        theirs.close()

    def _ask(self, question: CaseToPlay | EgoState, timeout_s: float, when: str) -> SumoAnswer:
        try:
            self._pipe.send(question)
            if not self._pipe.poll(timeout_s):
                self.close()
                raise SumoError(f"SUMO's process gave no answer within {timeout_s:g} s {when}")
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            self._process.join(timeout=5.0)
            code = self._process.exitcode
            self.close()
            raise SumoError(f"SUMO's process died {when} (exit code {code}); the next reset starts another") from error
        if isinstance(answer, str):
            raise SumoError(answer)
        return answer


# --- inside the process -----------------------------------------------------------------------


class _NextCaseSignal(OwnSignal):
    """Ends a case in favour of the next one; not an error, so it does not derive from Exception."""

    def __init__(self, play: CaseToPlay) -> None:
        self.play = play


class _Attached:
    """The attached code, if any, and its last report."""

    def __init__(self, play: CaseToPlay) -> None:
        self._attach, self.said = play.attach, dict[str, Any]()

    def begin(self, sumo: Any, ego: str) -> Callable[[], None]:
        """Start the attached code, and return the function to call after each step."""
        watch = self._attach(sumo, ego) if self._attach is not None else dict[str, Any]

        def step() -> None:
            self.said = watch()

        return step


class _DriverBeyondPipe:
    """A driver in the process at the other end of the pipe."""

    def __init__(self, pipe: Connection, attached: "_Attached") -> None:
        self._pipe, self._attached = pipe, attached

    def start(self, scenario: Scenario) -> None:
        """Do nothing, since there is nothing to prepare."""

    def advance(self, step: int, seen: Snapshot) -> EgoState:
        """Send the observed state, and receive the ego's next state."""
        self._pipe.send(SumoAnswer(seen, self._attached.said))
        told = self._pipe.recv()
        if isinstance(told, CaseToPlay):
            raise _NextCaseSignal(told)
        return told


def _serve(pipe: Connection) -> None:
    begin_child()
    play: CaseToPlay | None = None
    while True:
        try:
            play = play or _next_play(pipe)
            pipe.send(_last_seen(play, pipe))
            play = None
        except _NextCaseSignal as another:
            play = another.play
        except RegentsError as error:
            pipe.send(str(error))
            play = None
        except (EOFError, OSError):  # the other process has ended
            return


def _next_play(pipe: Connection) -> CaseToPlay:
    while not isinstance(asked := pipe.recv(), CaseToPlay):
        pipe.send("the case is over, expected another one to be begun")
    return asked


def _last_seen(play: CaseToPlay, pipe: Connection) -> SumoAnswer:
    """Play to the end and return the last state; all earlier ones are sent on the way."""
    attached = _Attached(play)
    tracks = replay_in_sumo(
        play.scenario, _DriverBeyondPipe(pipe, attached), released=play.released, seed=play.seed, attach=attached.begin
    ).tracks
    return SumoAnswer(Snapshot(**{name: getattr(tracks, name)[:, -1] for name in Snapshot._fields}), attached.said)
