"""SUMO step by step: a process of its own plays cases one after the other, and is told where the ego goes.

SUMO may crash, and holds one simulation per process; here a crash is an error and nothing else.
"""

import multiprocessing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.planners.interface import Snapshot
from regents_cosim.replays.ego_driver import EgoState
from regents_cosim.replays.sumo.drivers import DriverParameters
from regents_cosim.replays.sumo.replay import replay_in_sumo
from regents_cosim.scenario import Scenario
from regents_cosim.system.foreign_code import OwnSignal
from regents_cosim.system.processes import begin_child, end_with_this_process, has_ended, starting

_START_S = 120.0  # the imports of a process, and the network of a city
_STEP_S = 30.0
_ATTACHED_STEP_S = 300.0  # programs are compiled in the first


@dataclass(frozen=True, eq=False)
class CaseToPlay:
    """A case to be played, the ego by the one that asks."""

    scenario: Scenario
    released: Mapping[int, DriverParameters]  # who SUMO drives, by index
    seed: int
    attach: Callable[[Any, str], Callable[[], dict[str, Any]]] | None = None  # says something after each step


class SumoAnswer(NamedTuple):
    """What is seen after a step, and what the attached code says of it."""

    seen: Snapshot
    said: dict[str, Any]


class SumoSession:
    """The process, and the conversation with it. Use it from one thread at a time."""

    def __init__(self) -> None:
        self._pipe: Any = None  # a connection while the process runs
        self._step_s = _STEP_S

    def begin(self, play: CaseToPlay) -> SumoAnswer:
        """Begin a case, in the middle of another one too. All agents at step 0. Raises SumoError."""
        if self._pipe is None:
            self._start()
        self._step_s = _STEP_S if play.attach is None else _ATTACHED_STEP_S
        return self._ask(play, _START_S + self._step_s, "when it began a case")

    def go(self, ego: EgoState) -> SumoAnswer:
        """All agents one step later, the ego as told. Raises SumoError."""
        if self._pipe is None:
            raise SumoError("SUMO is not running, expected a case to be begun first")
        return self._ask(ego, self._step_s, "in a step")

    def close(self) -> None:
        """End the process; twice does no harm."""
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
    """The case is broken off for another one; no error, so no Exception."""

    def __init__(self, play: CaseToPlay) -> None:
        self.play = play


class _Attached:
    """The code that is attached, if any, and what it said last."""

    def __init__(self, play: CaseToPlay) -> None:
        self._attach, self.said = play.attach, dict[str, Any]()

    def begin(self, sumo: Any, ego: str) -> Callable[[], None]:
        """Let it begin; what is to be called after each step."""
        watch = self._attach(sumo, ego) if self._attach is not None else dict[str, Any]

        def step() -> None:
            self.said = watch()

        return step


class _DriverBeyondPipe:
    """A driver at the other end of the pipe."""

    def __init__(self, pipe: Connection, attached: "_Attached") -> None:
        self._pipe, self._attached = pipe, attached

    def start(self, scenario: Scenario) -> None:
        """Nothing to prepare."""

    def advance(self, step: int, seen: Snapshot) -> EgoState:
        """Tell what is seen, and be told where the ego goes."""
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
        except (EOFError, OSError):  # none is there any more
            return


def _next_play(pipe: Connection) -> CaseToPlay:
    while not isinstance(asked := pipe.recv(), CaseToPlay):
        pipe.send("the case is over, expected another one to be begun")
    return asked


def _last_seen(play: CaseToPlay, pipe: Connection) -> SumoAnswer:
    """Play to the end; all steps but the last are told on the way."""
    attached = _Attached(play)
    tracks = replay_in_sumo(
        play.scenario, _DriverBeyondPipe(pipe, attached), released=play.released, seed=play.seed, attach=attached.begin
    ).tracks
    return SumoAnswer(Snapshot(**{name: getattr(tracks, name)[:, -1] for name in Snapshot._fields}), attached.said)
