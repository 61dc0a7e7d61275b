"""What a round teaches: the crashes that a careful driver avoids and the planner can see coming, and their neighbours.

A planner that learns from crashes alone learns to stand. So the scene of each crash is taught as well with so little of
the attack left that nothing is to be feared (`evaluation.reduction.harmless`): there it is to get on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.reduction.harmless import harmless_neighbours
from regents_cosim.scenario import Scenario
from regents_cosim.training.before_after import hold_back, windows_among
from regents_cosim.training.failed_drives import failed_drives, teachable


@dataclass(frozen=True)
class RoundLessons:
    """Of all rounds so far."""

    crashes: tuple[Scenario, ...] = ()  # each with the drive that avoids it
    harmless: tuple[Scenario, ...] = ()  # neighbours of these
    chosen_by: tuple[Scenario, ...] = ()  # such crashes in every fifth window: these choose how much is kept
    windows: int = 0  # in which there are any

    @property
    def are_enough(self) -> bool:
        """Whether there is something to learn from, and something to choose by."""
        return bool(self.crashes and self.chosen_by)

    def with_round(self, crashes: Sequence[Scenario], planner: str, view_m: float, neighbours: bool) -> "RoundLessons":
        """With what `planner` learns from the crashes of one more round; it sees `view_m` to each side."""
        found = teachable(list(failed_drives(crashes, (case.tracks for case in crashes), planner, view_m)))
        taught, chosen_by = hold_back(found, self.windows)
        beside = harmless_neighbours(taught) if neighbours else {}
        return RoundLessons(
            (*self.crashes, *taught),
            (*self.harmless, *beside.values()),
            (*self.chosen_by, *chosen_by),
            self.windows + len(windows_among(found)),
        )
