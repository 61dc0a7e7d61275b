"""How much of a fine-tuning to keep: the share that avoids most crashes and costs ordinary traffic next to nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from regents_cosim.evaluation.drives.driving import DriveResult

SHARES = (0.25, 0.5, 0.75, 1.0)  # of the way from the weights before to those after
AT_MOST_WORSE = 0.02  # of ordinary routes


@dataclass(frozen=True)
class Mixture:
    """A share of a fine-tuning, and how its weights drive the cases to choose by."""

    share: float
    collisions: int  # in attacked cases
    completion: float  # of ordinary routes, 0 to 1


def mixture(share: float, attacked: Sequence[DriveResult], ordinary: Sequence[DriveResult]) -> Mixture:
    """The scores that count for the choice."""
    collisions = sum(drive.hits is not None for drive in attacked)
    return Mixture(share, collisions, fmean(drive.completion for drive in ordinary))


def best(before: Mixture, mixtures: Sequence[Mixture]) -> Mixture:
    """The mixture with fewest collisions of those that lose at most 2 points of ordinary routes; `before` is one.

    Among equals the one that changes least.
    """
    bearable = [m for m in (before, *mixtures) if m.completion >= before.completion - AT_MOST_WORSE]
    return min(bearable, key=lambda m: (m.collisions, m.share))
