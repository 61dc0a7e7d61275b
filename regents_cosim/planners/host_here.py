"""Host a planner in this process, for an object that cannot leave it.

It is asked and checked as in a process of its own (`host_process`), and an error costs only its drive. But nothing can
end it: a planner that hangs hangs this process, and one that crashes below Python ends this process.
"""

from regents_cosim.planners.host_messages import encoder, questions
from regents_cosim.planners.host_process import HostProcess, QuestionServer
from regents_cosim.planners.host_server import ServedPlanner
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.patience import Deadlines


class HostInThisProcess(HostProcess):
    """A host whose planner is in this process; use it from one thread at a time."""

    def __init__(self, name: str, planner: Planner, patience: Deadlines | None = None) -> None:
        super().__init__(name, patience)
        self._here = planner

    def _serving(self) -> QuestionServer:
        return _HostInThisProcess(ServedPlanner(self._here))


class _HostInThisProcess:
    """Serves questions and answers through the same bytes as a process, so that the planner gets exact copies."""

    def __init__(self, served: ServedPlanner) -> None:
        self._served, self._asked = served, 0

    def number(self) -> int:
        self._asked += 1
        return self._asked

    def ask(self, question: bytes, timeout_s: float) -> bytes:
        """The answer, however long it takes."""
        return encoder.encode(self._served.answered(questions.decode(question)))

    def stack(self) -> str:
        return ""

    def outcome(self) -> str:
        return "it is in this process"

    def end(self) -> None:
        """Do nothing, as the object is the caller's."""
