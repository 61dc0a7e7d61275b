"""Runs SUMO step by step in a separate process that plays cases one after the other; the caller moves the ego.

SUMO may crash, and allows one simulation per process; here a crash only raises an error.
"""

from collections.abc import Callable, Generator
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from regents_cosim.errors import SumoError
from regents_cosim.planners.interface import Placement, Snapshot
from regents_cosim.replays.sumo.replay import CaseToPlay, Played, play_in_sumo
from regents_cosim.replays.sumo.stage import SumoReplay
from regents_cosim.system.processes import Worker

_START_S = 120.0  # for the imports of a process and the network of a city
_STEP_S = 30.0
_ATTACHED_STEP_S = 300.0  # the first step compiles programs


class SumoAnswer(NamedTuple):
    """The state after a step, and the report of the attached code; the whole replay once the case is over."""

    seen: Snapshot
    said: Any
    replay: SumoReplay | None = None


class SumoSession:
    """The process with SUMO. Use it from one thread at a time."""

    def __init__(self) -> None:
        self.worker: Worker | None = None  # while the process runs
        self._step_s: float | None = _STEP_S

    def begin(self, play: CaseToPlay) -> SumoAnswer:
        """Begin a case, ending the current one if any, and return all agents at step 0. Raises SumoError."""
        if self.worker is None:
            self.worker = Worker()
        self._step_s = _STEP_S if play.attach is None else _ATTACHED_STEP_S
        first_s = _START_S + self._step_s
        if play.gui:  # the user may stop it, and closes it at the end
            self._step_s = None
        return self._ask(self.worker, first_s, "when it began a case", _begin, play)

    def go(self, ego: Placement | None) -> SumoAnswer:
        """Move the ego to the given state, and return all agents one step later. Raises SumoError.

        None at the last step ends the case; the answer then has its replay.
        """
        if self.worker is None:
            raise SumoError("SUMO is not running, expected a case to be begun first")
        return self._ask(self.worker, self._step_s, "in a step", _go, ego)

    def play(self, play: CaseToPlay) -> Played:
        """Play a whole case: as `play_in_sumo`, whose simulation runs in the process."""
        answer = self.begin(play)
        while answer.replay is None:
            answer = self.go((yield answer.seen))
        return answer.replay

    def close(self) -> None:
        """End the process; may be called twice."""
        if self.worker is not None:
            self.worker.close()
            self.worker = None

    def _ask(self, worker: Worker, timeout_s: float | None, when: str, job: Callable[..., Any], *args: Any) -> Any:
        worker.begin(job, *args)
        try:
            return worker.result(timeout_s)
        except TimeoutError as error:
            self.close()
            raise SumoError(f"SUMO's process gave no answer within {timeout_s:g} s {when}") from error
        except BrokenExecutor as error:
            self.close()
            code = worker.exit_code
            raise SumoError(f"SUMO's process died {when} (exit code {code}); the next reset starts another") from error


# --- inside the process -----------------------------------------------------------------------


@dataclass
class _PlayedCase:
    """The case that the process plays."""

    steps: Generator[Snapshot, Placement | None, SumoReplay]
    said: Any = field(default_factory=dict)  # last report of the attached code
    seen: Snapshot | None = None  # last state


_played: _PlayedCase | None = None


def _begin(play: CaseToPlay) -> SumoAnswer:
    global _played
    if _played is not None:
        _played.steps.close()

    def attach(sumo: Any, ego: str) -> Callable[[], None]:
        assert play.attach is not None
        watch = play.attach(sumo, ego)

        def step() -> None:
            case.said = watch()

        return step

    attached = None if play.attach is None else attach
    case = _played = _PlayedCase(play_in_sumo(replace(play, attach=attached)))
    return _go(None)


def _go(ego: Placement | None) -> SumoAnswer:
    case = _played
    assert case is not None
    try:
        case.seen = case.steps.send(ego)
    except StopIteration as over:
        if over.value is None:
            raise SumoError("the case is over, expected another one to be begun") from None
        assert case.seen is not None
        return SumoAnswer(case.seen, case.said, over.value)
    return SumoAnswer(case.seen, case.said)
