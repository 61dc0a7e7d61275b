"""Chooses the share of a fine-tuning to keep: it avoids most crashes, and costs ordinary traffic next to nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from regents_cosim.errors import RegentsError, require
from regents_cosim.evaluation.drives.driving import DriveResult

SHARES = (0.25, 0.5, 0.75, 1.0)  # shares of the way from the weights before to those after
AT_MOST_WORSE = 0.02  # largest loss of ordinary routes, as a share


@dataclass(frozen=True)
class Mixture:
    """A share of a fine-tuning, and the scores of its weights in the cases to choose by."""

    share: float
    collisions: int  # collisions in attacked cases
    completion: float  # driven share of ordinary routes, 0 to 1


def mixture(share: float, attacked: Sequence[DriveResult], ordinary: Sequence[DriveResult]) -> Mixture:
    """Score some drives for the choice."""
    collisions = sum(drive.hits is not None for drive in attacked)
    return Mixture(share, collisions, fmean(drive.completion for drive in ordinary))


def best(before: Mixture, mixtures: Sequence[Mixture]) -> Mixture:
    """Choose the mixture with fewest collisions among those that lose at most 2 points of ordinary routes.

    `before` is one of them. Among equals the one that changes the weights least is chosen.
    """
    bearable = [m for m in (before, *mixtures) if m.completion >= before.completion - AT_MOST_WORSE]
    return min(bearable, key=lambda m: (m.collisions, m.share))


def interpolate(before: dict[str, np.ndarray], after: dict[str, np.ndarray], share: float) -> dict[str, np.ndarray]:
    """`before` + `share` (`after` - `before`), array by array. Raises RegentsError where they hold different arrays.

    Thereby more is kept of what was known before. Source: WiSE-FT (Wortsman et al. 2022).
    """
    shapes = [{name: values.shape for name, values in weights.items()} for weights in (before, after)]
    require(shapes[0] == shapes[1], "weights of two different networks, expected the same arrays in both", RegentsError)
    mixed = {}
    for name, values in before.items():
        begun = values.astype(np.float32)
        mixed[name] = begun + np.float32(share) * (after[name].astype(np.float32) - begun)
    return mixed
