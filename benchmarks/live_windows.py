"""Windows that go on in SUMO's live traffic: a planner at the wheel, and an adversary that aims while they do.

Attacks begin within the window. One that has begun is carried out to its end, which may come later: an adversary that
looks eight seconds ahead meets the ego up to eight seconds after it began.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.scores import is_clean, is_flawless, is_telling
from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.live.adversary import Adversary
from regents_cosim.live.search.plan import plan_of_case
from regents_cosim.live.search.plans import OBSERVED
from regents_cosim.live.settings import HORIZON_S
from regents_cosim.planners.controllers import PlannerControllers
from regents_cosim.replays.sumo.replay import CaseToPlay, replay_in_sumo
from regents_cosim.routes.ego_route import logged_way
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.simulators.sumo.drivers import background_drivers
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.workers import run_each

ALL = "all"
LIVE_WINDOWS = (
    "place",
    "n",
    "attacked",
    "crashes",
    "interval_percent",
    "clean",
    "clean_interval_percent",
    "telling",
    "flawless",
)


@dataclass(frozen=True, eq=False)
class LiveWindow:
    """A case that begins again as it did before its attack; SUMO drives all but the ego from its first step on."""

    case: Scenario
    planner: str
    expected: str  # how the adversary expects the ego to react
    method: AttackConfig | str
    seed: int  # of SUMO's dice
    recorded: bool = False  # the adversary begins as the case has it
    attacked: bool = True


@dataclass(frozen=True, eq=False)
class LiveWindowEnd:
    """How it went."""

    met: str | None  # the road user that the ego touched first
    attacks: int = 0
    case: Scenario | None = None  # the crash with its adversary, judged
    told: tuple[str, ...] = ()

    @property
    def crash(self) -> bool:
        """Whether the first that the ego touched was its adversary."""
        attack = self.case.attack if self.case is not None else None
        return attack is not None and attack.collision is not None and attack.collision.agent == self.met


@dataclass(frozen=True)
class LiveWindowsRow:
    """Windows of one place, or all."""

    place: str
    n: int  # windows in which the planner meets none as long as it is not attacked
    met_unattacked: int  # the others
    failed: int  # for which SUMO or the planner gave no answer; in none of the other columns
    attacked: int
    crashes: int
    crash_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    clean: int
    clean_percent: float
    clean_interval_percent: tuple[float, float]
    telling: int
    flawless: int
    met_another: int  # than the adversary


def drive_window(window: LiveWindow) -> LiveWindowEnd:
    """Drive one. Call it in a worker process. Raises DriveError, SumoError."""
    scenario, attached = _going_on(window.case.before_attack(), HORIZON_S), _Attached(window)
    with PlannerControllers(window.planner) as controllers, controllers.lend() as controller:
        play = CaseToPlay(scenario, background_drivers(scenario), window.seed, attach=attached)
        seen = replay_in_sumo(play, controller).tracks
    contact = first_contact(scenario.agents, seen)
    return attached.end(None if contact is None else scenario.agents[contact[0]].id)


def _going_on(scenario: Scenario, seconds: float) -> Scenario:
    """Extend a scenario by `seconds`, during which only the ego is marked as present; SUMO drives the others on."""
    steps = round(seconds / scenario.dt)

    def longer(values: np.ndarray) -> np.ndarray:
        return np.pad(values, ((0, 0), (0, steps)), "edge")

    tracks = scenario.tracks
    valid = longer(tracks.valid)
    valid[1:, tracks.steps :] = False
    moved = {name: longer(getattr(tracks, name)) for name in ("x", "y", "yaw", "speed", "z")}
    return replace(scenario, tracks=Tracks(**moved, valid=valid))


def drive_windows(
    cases: Sequence[Scenario],
    planner: str,
    expected: str = "",
    method: AttackConfig | str = "focused-live",
    seed: int = 0,
    recorded: bool = False,
    progress: Progress = SILENT,
) -> list[tuple[LiveWindowEnd | RegentsError, LiveWindowEnd | RegentsError]]:
    """Each of `cases` as it was before any attack, left alone and attacked; if so told, first as it is `recorded`."""
    jobs = [
        LiveWindow(case, planner, expected or planner, method, seed + index, recorded, attacked)
        for index, case in enumerate(cases)
        for attacked in (False, True)
    ]
    ends = list(progress.each(run_each(drive_window, jobs), "driving", len(jobs)))
    return list(zip(ends[::2], ends[1::2], strict=True))


def live_rows(
    cases: Sequence[Scenario], ends: Sequence[tuple[LiveWindowEnd | RegentsError, LiveWindowEnd | RegentsError]]
) -> list[LiveWindowsRow]:
    """A row for each place, and one for all."""
    places = dict.fromkeys(case.provenance.file for case in cases)
    pairs = list(zip(cases, ends, strict=True))
    rows = [_row(place, [end for case, end in pairs if case.provenance.file == place]) for place in places]
    return [*rows, _row(ALL, ends)] if len(rows) > 1 else rows


def _row(place: str, ends: Sequence[tuple[LiveWindowEnd | RegentsError, ...]]) -> LiveWindowsRow:
    driven = [(a, b) for a, b in ends if isinstance(a, LiveWindowEnd) and isinstance(b, LiveWindowEnd)]
    attacked = [end for alone, end in driven if alone.met is None]
    crashes = [end.case for end in attacked if end.crash and end.case is not None]
    n, hit, clean = len(attacked), len(crashes), sum(map(is_clean, crashes))
    return LiveWindowsRow(
        place=place,
        n=n,
        met_unattacked=len(driven) - n,
        failed=len(ends) - len(driven),
        attacked=sum(end.attacks > 0 for end in attacked),
        crashes=hit,
        crash_percent=percent(hit, n),
        interval_percent=percent_interval(hit, n),
        clean=clean,
        clean_percent=percent(clean, n),
        clean_interval_percent=percent_interval(clean, n),
        telling=sum(map(is_telling, crashes)),
        flawless=sum(map(is_flawless, crashes)),
        met_another=sum(end.met is not None and not end.crash for end in attacked),
    )


class _Attached:
    """The adversary of one window; it lets go with the first crash, and where the run ends."""

    def __init__(self, window: LiveWindow) -> None:
        self._window, self._left = window, window.case.tracks.steps  # of the window; below 0 once that is over
        self._ends = -round(HORIZON_S / window.case.dt)  # where the run does
        self._adversary: Adversary | None = None
        self._told: list[str] = []

    def __call__(self, sumo: Any, ego: str) -> Callable[[], bool]:
        """Attach it to the simulation; what is to be called after each step."""
        case = self._window.case
        if self._window.attacked:
            plan = plan_of_case(case, float(sumo.simulation.getTime())) if self._window.recorded else None
            # `expected` is the planner that drives, so its route is known as well; `observed` knows neither.
            route = None if self._window.expected == OBSERVED else logged_way(case.before_attack())
            whole_s = (case.tracks.steps - 1) * case.dt  # what was recorded may meet the ego as late as that
            self._adversary = Adversary(
                sumo, ego, self._window.expected, self._window.method, horizon_s=whole_s if plan else HORIZON_S,
                source=case.provenance.file, seed=self._window.seed, plan=plan, route=route, tell=self._told.append,
                attack_when=lambda _: self._left > 0,
            )  # fmt: skip
        return self._step

    def end(self, met: str | None) -> LiveWindowEnd:
        """How the window ended, whose ego `met` that vehicle first."""
        if self._adversary is None:
            return LiveWindowEnd(met)
        cases, tally = self._adversary.cases, self._adversary.tally
        return LiveWindowEnd(met, tally.attacks, cases[-1] if cases else None, tuple(self._told))

    def _step(self) -> bool:
        """After each step: whether the run goes on."""
        self._left -= 1
        adversary = self._adversary
        if adversary is None:
            return True
        adversary.step()
        over = self._left <= 0 and adversary.adversary is None
        if over or adversary.tally.crashes or self._left == self._ends:
            adversary.detach()
            return False
        return True
