"""Runs drives of one planner through the cases of suites ahead of their use.

A test item needs one case at a time, while all cores work on the following ones. A planner that raises or hangs fails
only its own case; SUMO runs in separate processes.
"""

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from regents_cosim.cases.files import load_case, load_header
from regents_cosim.evaluation.drives.driving import DriveResult, drive_and_keep, drive_each
from regents_cosim.evaluation.drives.metrics import COMPARED
from regents_cosim.evaluation.regression.baseline import DriveOutcome
from regents_cosim.mirror.programs.jax_settings import require_device
from regents_cosim.plain_text import printable
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import Simulator, check, controllers_of
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.workers import cores, local_processes

_DIGITS = 4  # digits of a metric: on another machine a drive is equal to more digits


class DrivesAhead:
    """The drives of one planner in one simulator; `close` ends running ones."""

    def __init__(
        self,
        planner: AnyPlanner,
        where: Simulator = "mirror",
        act_timeout_s: float = ACT_TIMEOUT_S,
        workers: int | None = None,
    ) -> None:
        """Raises PlannerError where the planner cannot be found.

        `workers` cases are driven at a time, by default one per core; in highway-env one.
        """
        require_device()
        check(where, act_timeout_s=act_timeout_s)
        self.planner = PlannerUnderTest.of(planner)
        self.where: Simulator = where
        self._act_timeout_s = act_timeout_s
        self._driver = MirrorController(self.planner, act_timeout_s)
        self._in_highway = controllers_of(self.planner, act_timeout_s) if where == "highway" else None
        # highway-env draws with pygame, which does not support threads
        side_by_side = 1 if where == "highway" else workers or cores()
        self._pool = ThreadPoolExecutor(side_by_side)
        self._processes = local_processes(side_by_side)  # for SUMO
        self._begun: dict[Path, Future[tuple[DriveResult, DriveOutcome]]] = {}

    def close(self) -> None:
        """Cancel drives that have not begun, and end all processes."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._driver.__exit__(None, None, None)
        self._processes.shutdown(wait=False)
        if self._in_highway is not None:
            self._in_highway.__exit__(None, None, None)
        self._pool.shutdown(wait=True)

    def begin(self, folders: Iterable[Path]) -> None:
        """Drive these cases as soon as a core is free, in this order."""
        for folder in folders:
            if folder not in self._begun:
                self._begun[folder] = self._pool.submit(self._drive_folder, folder)

    def of(self, folder: Path) -> DriveOutcome:
        """The planner's outcome in the case of that folder. Raises CaseError for one that cannot be read."""
        return self._result(folder)[1]

    def drive(self, case: Path | Scenario) -> DriveResult:
        """The drive through a case, with its scores."""
        return self._drive(case) if isinstance(case, Scenario) else self._result(case)[0]

    def _result(self, folder: Path) -> tuple[DriveResult, DriveOutcome]:
        self.begin([folder])
        return self._begun[folder].result()

    def _drive_folder(self, folder: Path) -> tuple[DriveResult, DriveOutcome]:
        scenario = load_case(folder)
        drive = self._drive(scenario)
        return drive, outcome_of_drive(drive, load_header(folder).hash, scenario.dt)

    def _drive(self, scenario: Scenario) -> DriveResult:
        if self.where == "mirror":
            return drive_and_keep(scenario, self._driver)[0]
        among = self._act_timeout_s, self.where, self._processes, self._in_highway
        return next(drive_each([scenario], self.planner, *among))


def outcome_of_drive(drive: DriveResult, digest: str, dt: float) -> DriveOutcome:
    """A drive in the form of baselines: the outcome and the metrics, rounded to four decimals."""
    if drive.error:
        return DriveOutcome(digest, "planner_error", error=_in_lines(drive))
    measured = {name: getattr(drive, metric.field) for name, metric in COMPARED.items()}
    return DriveOutcome(
        hash=digest,
        outcome="rear_ended" if drive.rear_ended else "collision" if drive.collision else "no_collision",
        agent=drive.hits,
        step=drive.step,
        time_s=None if drive.step is None else round(drive.step * dt, 6),
        collision_type=drive.collision_type,
        telling=drive.verdict and drive.verdict.telling,
        flawless=drive.verdict and drive.verdict.flawless,
        metrics={name: None if of is None else round(float(of), _DIGITS) for name, of in measured.items()},
    )


def _in_lines(failed: DriveResult) -> str:
    """The text of `DriveOutcome.error`, which is printed as it is."""
    lines = [" ".join(failed.error.split()), *failed.trace.splitlines()]
    return "\n".join(printable(line, limit=None) for line in lines)
