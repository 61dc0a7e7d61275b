"""The lessons of a round: crashes that a careful driver avoids and the planner can see coming, and their neighbours.

A planner that learns from crashes alone learns to stand. So each crash is also taught as its harmless neighbour
(`evaluation.reduction.harmless`), in which so little of the attack is left that the planner has to drive on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.reduction.harmless import harmless_neighbours
from regents_cosim.scenario import Scenario
from regents_cosim.training.before_after import hold_back, windows_among
from regents_cosim.training.failed_drives import failed_drives, teachable


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
