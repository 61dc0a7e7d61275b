"""Attack one window, here or in a worker on another machine, and hand the results back."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from regents_cosim.attacks.attack import Engine, attack_each, engine_of, searched_together
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED, AttackConfig, preset
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.holds import Verified, verified_each
from regents_cosim.runs.identity import Identity, identity
from regents_cosim.runs.planner_files import digest_of, method_digest
from regents_cosim.runs.requests import WantedManoeuvres
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.workers import cores, local_processes
from regents_cosim.verdicts.judge import judge_each


@dataclass(frozen=True)
class AttackRun:
    """How every window is attacked, and what happens to the results."""

    config: AttackConfig
    planner: PlannerUnderTest
    batch: int = 32
    engine: Engine = "auto"
    act_timeout_s: float = ACT_TIMEOUT_S
    judge: bool = True
    verify: bool = True
    pictures: bool = True
    wanted: WantedManoeuvres | None = None  # crashes that are asked for; only these are kept, until there are enough

    @classmethod
    def of(cls, planner: AnyPlanner, method: str | AttackConfig = "", **others: Any) -> "AttackRun":
        """The attack on a planner, by name or as an object, by a method (the default: focused) or a configuration.

        `others` are the other fields. Raises RegentsError.
        """
        config = method if isinstance(method, AttackConfig) else preset(method or REGENTS_FOCUSED.method)
        return cls(config, PlannerUnderTest.of(planner), **others)

    def together(self) -> int:
        """The number of windows that share one computation. Raises PlannerError."""
        return searched_together(self.planner, self.config, self.engine, self.batch, self.act_timeout_s)

    def identity(self, traffic: dict[str, Any], together: int) -> Identity:
        """The identity of the run; `traffic` holds the options of the traffic by name."""
        mine = {"planner": self.planner.name, "act_timeout": self.act_timeout_s}
        mine |= {"judge": self.judge, "verify": self.verify, "pictures": self.pictures}
        mine |= {"engine": engine_of(self.engine)} | ({"batch": self.batch} if together > 1 else {})
        mine |= {"type": dict(self.wanted.counts)} if self.wanted else {}
        settings = {**traffic, **self.config.settings, **mine}
        code = {self.planner.name: digest_of(self.planner)}
        if own := method_digest(self.config):
            code[f"method {self.config.method}"] = own
        return identity("attack", settings, code)

    def attack(self, scenarios: Iterable[Scenario]) -> Iterator[list[Scenario]]:
        """Attack scenarios and yield the cases of each, judged. Raises RegentsError."""
        runs = attack_each(
            scenarios, self.config, self.planner, self.batch, engine=self.engine, act_timeout_s=self.act_timeout_s,
            wanted=self.wanted,
        )  # fmt: skip
        return (list(judge_each(results)) if self.judge else results for results in runs)


Still = Callable[[Scenario], bytes]  # gives a PNG of a case; a function of a module, so that workers find it


@dataclass(frozen=True, eq=False)
class AttackedWindow:
    """The results of one window."""

    cases: list[Scenario]
    verified: dict[str, Verified] = field(default_factory=dict)  # its crashes in SUMO, by case
    stills: dict[str, bytes] = field(default_factory=dict)  # pictures as PNG, by case
    promised: frozenset[str] | None = None  # wanted manoeuvres to which drives there lead; None: not known


def attack_window(run: AttackRun, still: Still | None, window: Scenario) -> AttackedWindow:
    """Search a window, and judge, verify and draw the results; runs in a worker process.

    Each process does once what does not depend on the window: it looks for compiled programs on its own disk, and
    starts its own SUMO.
    """
    sumo = _once_here()
    (cases,) = run.attack([window])
    verified = verified_each(crashes_of(cases), sumo) if run.verify else ()
    stills = {case.id: still(case) for case in cases} if still else {}
    return AttackedWindow(cases, {one[0].case: one for one in verified}, stills)


@cache
def _once_here() -> Executor:
    """The SUMO processes of this worker, one for each thread that works on a window; they live as long as it does."""
    return local_processes(cores())


def crashes_of(cases: Iterable[Scenario]) -> list[Scenario]:
    """The cases that end in a collision, which SUMO can replay."""
    return [case for case in cases if case.crash]


def has_failed(case: Scenario) -> bool:
    """Whether the planner failed in a case."""
    return case.attack is not None and bool(case.attack.planner_error)
