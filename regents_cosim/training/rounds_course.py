"""Runs the rounds of a training against fresh attacks, one after the other, and notes them in the ledger.

A round is done when its weights are on disk and the ledger has its result. Windows and attacks are steps of their own
(`runs.steps`), so that a killed run repeats at most one training and the windows that were at work.

A planner that learns from crashes alone learns to stand. So each crash is also taught as its harmless neighbour
(`evaluation.reduction.harmless`), in which so little of the attack is left that the planner has to drive on.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean

import msgspec

from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.evaluation.crashes.scores import count_windows, is_telling
from regents_cosim.evaluation.drives.driving import DriveResult, score
from regents_cosim.evaluation.reduction.harmless import harmless_neighbours
from regents_cosim.evaluation.statistics import mcnemar, mean_interval
from regents_cosim.planners.aim_bev.network_inputs import shown_to
from regents_cosim.planners.aim_bev.weights_file import BY_PLANNER
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.coverage import archive_of
from regents_cosim.runs.growing import SuiteIntake
from regents_cosim.runs.ledger import DoneUnit, Ledger, WorkUnit
from regents_cosim.runs.window_job import AttackRun, Still
from regents_cosim.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import Progress
from regents_cosim.training.before_after import BeforeAfterRow, before_after, hold_back, windows_among
from regents_cosim.training.failed_drives import failed_drives, teachable
from regents_cosim.training.fresh_windows import FreshWindows
from regents_cosim.training.learning import AT_MOST_WORSE, AttackedAndOrdinary, EachEpoch, drives, learn
from regents_cosim.training.rounds_settings import Rounds


# The gate between two rounds of training, and the benefit of all of them on windows that no round has seen.
# The gate passes weights that drive ordinary traffic as well as before. Attacks on the planner before training
# flatter the planner after it, which is elsewhere and so is missed. So the planner after training is attacked again,
# in the same windows and for as long.
@dataclass(frozen=True, repr=False)
class Gate(ShortRepr):
    """The comparison of drives before and after, case by case. The means decide; the interval shows their certainty."""

    ordinary: int  # cases
    routes_before_percent: float  # mean share of the route that is driven
    routes_after_percent: float
    lost_points: float  # difference in the driven share of routes, mean over the cases
    lost_interval_points: tuple[float, float] | None  # 95 %; None for fewer than two cases
    collisions_before: int
    collisions_after: int
    p_value: float  # p-value of the hypothesis that both collide equally often (McNemar)
    passed: bool  # True if at most 2 points of route are lost, without more collisions

    @property
    def said(self) -> str:
        """The comparison in words."""
        low_high = self.lost_interval_points
        sure = f" ({low_high[0]:g} to {low_high[1]:g})" if low_high else ""
        return (
            f"{self.ordinary} ordinary routes {self.routes_before_percent:g} % -> {self.routes_after_percent:g} %, "
            f"{self.lost_points:g} points lost{sure}, collisions {self.collisions_before} -> {self.collisions_after}: "
            f"{'passed' if self.passed else 'not passed, the weights stay'}"
        )


def gate(before: Sequence[DriveResult], after: Sequence[DriveResult]) -> Gate:
    """Compare drives of the same cases in the same order. `before` are the drives of the planner before all rounds.

    Thereby small losses of several rounds cannot add up unnoticed.
    """
    lost = [a.completion - b.completion for a, b in zip(before, after, strict=True)]
    hits = [[drive.hits is not None for drive in drives] for drives in (before, after)]
    return Gate(
        ordinary=len(lost),
        routes_before_percent=_points(fmean(drive.completion for drive in before)),
        routes_after_percent=_points(fmean(drive.completion for drive in after)),
        lost_points=_points(fmean(lost)),
        lost_interval_points=_interval(lost),
        collisions_before=sum(hits[0]),
        collisions_after=sum(hits[1]),
        p_value=round(mcnemar(*hits), 4),
        passed=fmean(lost) <= AT_MOST_WORSE and sum(hits[1]) <= sum(hits[0]),
    )


def _interval(lost: Sequence[float]) -> tuple[float, float] | None:
    if len(lost) < 2:
        return None
    low, high = mean_interval(lost)
    return _points(low), _points(high)


def _points(share: float) -> float:
    return round(100.0 * share, 1)


Attacked = Sequence[Sequence[Scenario]]  # the results of an attack in each window

ORDINARY = "ordinary"
OLD_ATTACKS = "attacks on the weights before"
OWN_ATTACKS = "attacks on each"


def telling_crashes(attacked: Attacked) -> list[Scenario]:
    """The crashes with a lawful adversary that a careful driver would have avoided."""
    return [case for results in attacked for case in results if is_telling(case)]


def held_out_rows(
    windows: list[Scenario], attacked: tuple[Attacked, Attacked], weights: tuple[Path, Path], progress: Progress
) -> list[BeforeAfterRow]:
    """Score the weights before and after in the same windows: as recorded, with the old attacks, with attacks on each.

    `attacked` has the results of attacks on the weights before, and on those after. In the last two rows only crashes
    count that a careful driver avoids.
    """
    rows = before_after(ORDINARY, *_driven(windows, weights, progress))
    if old := telling_crashes(attacked[0]):
        rows += before_after(OLD_ATTACKS, *_driven(old, weights, progress))
    return rows + before_after(OWN_ATTACKS, *(list(map(attacked_drive, found)) for found in attacked))


def attacked_drive(results: Sequence[Scenario]) -> DriveResult:
    """The drive of the planner in one attacked window; a crash that is not telling does not count."""
    telling = next(filter(is_telling, results), None)
    case = telling or results[0]
    drive = score(case, case.tracks)
    return drive if telling else replace(drive, hits=None, step=None, collision_type=None)


def _driven(scenarios: list[Scenario], weights: tuple[Path, Path], progress: Progress) -> list[list[DriveResult]]:
    """The drives of the weights before and after, which may be the same."""
    by_weights = {one: drives(scenarios, one, progress) for one in dict.fromkeys(weights)}
    return [by_weights[one] for one in weights]


@dataclass(frozen=True)
class RoundLessons:
    """The lessons of all rounds so far."""

    crashes: tuple[Scenario, ...] = ()  # crashes to teach, each with the drive that avoids it
    harmless: tuple[Scenario, ...] = ()  # harmless neighbours of the taught crashes
    chosen_by: tuple[Scenario, ...] = ()  # crashes of every fifth window, which choose how much is kept
    windows: int = 0  # number of windows with such crashes

    @property
    def are_enough(self) -> bool:
        """Whether there are crashes to learn from, and crashes to choose by."""
        return bool(self.crashes and self.chosen_by)

    def with_round(self, crashes: Sequence[Scenario], planner: str, view_m: float, neighbours: bool) -> "RoundLessons":
        """Add the lessons of one more round for `planner`, which sees `view_m` [m] to each side."""
        found = teachable(list(failed_drives(crashes, (case.tracks for case in crashes), planner, view_m)))
        taught, chosen_by = hold_back(found, self.windows)
        beside = harmless_neighbours(taught) if neighbours else {}
        return RoundLessons(
            (*self.crashes, *taught),
            (*self.harmless, *beside.values()),
            (*self.chosen_by, *chosen_by),
            self.windows + len(windows_among(found)),
        )


_JUDGED = "held-out"


@dataclass(frozen=True, repr=False)
class RoundRow(ShortRepr):
    """The result of one round."""

    round: int
    windows: int  # windows that were attacked
    crashes: int  # windows with a crash that a careful driver avoids
    teachable: int  # crashes of all rounds so far that the planner could see coming and brake for
    harmless: int  # neighbours of these
    suite_cells: int  # cells of the map of behaviours that the suite fills by now
    kept_percent: float | None  # kept share of the change; None where there was too little to learn from
    gate: Gate | None  # result of the gate; None where nothing was learnt or kept

    @property
    def passed(self) -> bool:
        """Whether the next round continues from the weights of this one."""
        return self.gate is not None and self.gate.passed

    @property
    def said(self) -> str:
        """The result in one line."""
        found = (
            f"round {self.round}: crashes in {self.crashes} of {self.windows} windows; so far {self.teachable} could "
            f"be seen coming and braked for, {self.harmless} harmless neighbours"
        )
        if self.kept_percent is None:
            return f"{found}: too few to learn from"
        return f"{found}, {self.kept_percent:g} % kept; {self.gate.said if self.gate else 'the weights stay'}"


@dataclass(frozen=True)
class OrdinaryCases:
    """Recorded traffic to train on, to choose the kept share by, and for the gate; no window is in two of them."""

    taught: list[Scenario]
    chosen_by: list[Scenario]
    judged_by: list[Scenario]


@dataclass(frozen=True)
class RoundsCourse:
    """The inputs of the rounds, and the methods that run them."""

    rounds: Rounds
    begun_with: Path  # weights
    ordinary: OrdinaryCases
    traffic: FreshWindows
    folder: Path  # for the weights of each round
    suite: Path  # that grows
    still: Still | None
    ledger: Ledger
    progress: Progress
    each_epoch: EachEpoch

    def plan(self, *inputs: str) -> None:
        """Note the rounds in the ledger; `inputs` are digests of everything given."""
        names = [*(f"round-{number}" for number in self._numbers), _JUDGED]
        key = self.ledger.record.begun.identity.key(*inputs)
        self.ledger.plan("", [WorkUnit(name, key) for name in names])
        self._forget_lost()

    def go(self) -> None:
        """Run the rounds that are not done yet, and judge the result."""
        left = self.ledger.left()
        if set(left) != {self._unit(_JUDGED)} & set(left):
            self._go_through_rounds()
        if left:
            self._judge(self.last())

    def _go_through_rounds(self) -> None:
        """Go through all rounds in order; finished ones give the lessons of the later ones."""
        current, known = self.begun_with, RoundLessons()
        for number in self._numbers:
            attacked = self.traffic.attacked(number, "attacks", self.rounds.windows, self._run(current))
            view_m = shown_to(current).camera.view_m
            known = known.with_round(telling_crashes(attacked), planner_name(current), view_m, self.rounds.neighbours)
            if not self.ledger.record.is_done(self._unit(number)):
                cells = self._grow(attacked)
                self._note(number, self._learn(number, current, known, attacked, cells))
                self.progress.say(self._row(number).said)
            current = self._weights(number) if self._row(number).passed else current

    def rows(self) -> Iterator[RoundRow]:
        """The rows of all rounds, once they are done."""
        return map(self._row, self._numbers)

    def held_out(self) -> list[BeforeAfterRow]:
        """The scores on held-out windows, once they are known."""
        return msgspec.convert(self.ledger.record.done[_JUDGED].said["rows"], list[BeforeAfterRow])

    def last(self) -> Path:
        """The weights of the last round that passed the gate."""
        passed = [self._weights(row.round) for row in self.rows() if row.passed]
        return passed[-1] if passed else self.begun_with

    def _learn(self, number: int, current: Path, known: RoundLessons, attacked: Attacked, cells: int) -> RoundRow:
        """Train on the lessons of all rounds so far."""
        windows, crashes = len(attacked), count_windows(attacked, is_telling)
        found = RoundRow(number, windows, crashes, len(known.crashes), len(known.harmless), cells, None, None)
        if not known.are_enough:
            return found
        learnt = learn(
            known.crashes,
            [*self.ordinary.taught, *known.harmless],
            AttackedAndOrdinary(list(known.chosen_by), self.ordinary.chosen_by),
            current,
            self._weights(number),
            self.rounds.training,
            self.progress,
            self.each_epoch,
        )
        passed = self._gate(self._weights(number)) if learnt.kept else None
        return replace(found, kept_percent=round(100.0 * learnt.kept, 1), gate=passed)

    def _gate(self, weights: Path) -> Gate:
        pairs = (drives(self.ordinary.judged_by, one, self.progress) for one in (self.begun_with, weights))
        return gate(*pairs)

    def _grow(self, attacked: Attacked) -> int:
        """Add new kinds of crashes to the suite; return the number of cells that it fills then."""
        archive = archive_of(find_cases(self.suite), self.rounds.axes)
        SuiteIntake(self.suite, archive, self.still, self.rounds.verify).take(telling_crashes(attacked))
        return len(archive.elites)

    def _judge(self, current: Path) -> None:
        """Attack the weights before and after in windows that no round has seen."""
        last = self.rounds.rounds + 1
        attack = self.traffic.attacked
        one_crash = self.rounds.attack.but(adversaries="one")  # of each window is enough to judge by
        runs = [replace(self._run(one), config=one_crash) for one in (self.begun_with, current)]
        before = attack(last, "attacks on the weights before", self.rounds.held_out, runs[0])
        after = before
        if current != self.begun_with:
            after = attack(last, "attacks on the weights after", self.rounds.held_out, runs[1])
        windows = self.traffic.windows(last, self.rounds.held_out)
        rows = held_out_rows(windows, (before, after), (self.begun_with, current), self.progress)
        self.ledger.note(DoneUnit(self._unit(_JUDGED), (), {"rows": [asdict(row) for row in rows]}))

    def _run(self, weights: Path) -> AttackRun:
        return AttackRun(self.rounds.attack, PlannerUnderTest.of(planner_name(weights)), verify=False, pictures=False)

    def _note(self, number: int, row: RoundRow) -> None:
        weights = self._weights(number)
        said = {"row": asdict(row), "weights": sha256_of(weights) if row.passed else ""}
        self.ledger.note(DoneUnit(self._unit(number), (), said))

    def _row(self, number: int) -> RoundRow:
        return msgspec.convert(self.ledger.record.done[self._unit(number).name].said["row"], RoundRow)

    def _weights(self, number: int) -> Path:
        return self.folder / f"round-{number}.safetensors"

    def _unit(self, name: int | str) -> WorkUnit:
        wanted = name if isinstance(name, str) else f"round-{name}"
        return next(unit for unit in self.ledger.record.own if unit.name == wanted)

    def _forget_lost(self) -> None:
        """Forget rounds whose weights are missing or changed, and all later ones, so that they run again."""
        lost = False
        for number in (*self._numbers, _JUDGED):
            unit = self._unit(number)
            done = self.ledger.record.done.get(unit.name)
            lost = lost or done is None or (isinstance(number, int) and not self._is_there(number, done))
            if lost and done is not None:
                self.ledger.forget(unit.name)

    def _is_there(self, number: int, done: DoneUnit) -> bool:
        noted, weights = done.said["weights"], self._weights(number)
        return not noted or (weights.is_file() and sha256_of(weights) == noted)

    @property
    def _numbers(self) -> Sequence[int]:
        return range(1, self.rounds.rounds + 1)


def planner_name(weights: Path) -> str:
    """The name under which the planner with these weights is attacked."""
    ours = {file: name for name, file in BY_PLANNER.items()}
    return ours.get(weights, f"aim-bev:{weights}")
