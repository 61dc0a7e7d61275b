"""Confidence intervals and tests."""

from collections.abc import Sequence
from math import inf, sqrt
from statistics import fmean, stdev

_Z = 1.959964  # of the normal distribution, for 95 %


def wilson(successes: int, n: int) -> tuple[float, float]:
    """95 % interval of a share of `successes` in `n` trials; (0, 1) for n = 0.

    Source: Wilson 1927, the score interval, which is also right near 0 and 1.
    """
    if n == 0:
        return 0.0, 1.0
    share, slack = successes / n, _Z * _Z / n
    middle = (share + slack / 2) / (1 + slack)
    half = _Z * sqrt(share * (1 - share) / n + slack / (4 * n)) / (1 + slack)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % interval of the mean, by the normal distribution; infinitely wide for fewer than two values."""
    if len(values) < 2:
        return -inf, inf
    middle = fmean(values)
    half = _Z * stdev(values) / sqrt(len(values))
    return middle - half, middle + half


def mcnemar(first: Sequence[bool], second: Sequence[bool]) -> float:
    """P value of the hypothesis that two methods succeed equally often on the same trials; 1 where they never differ.

    Source: McNemar 1947, in its exact form: a binomial test on the trials in which exactly one of them succeeds.
    """
    from scipy.stats import binomtest  # its import takes half a second, which other commands do not need

    only_first = sum(a and not b for a, b in zip(first, second, strict=True))
    only_second = sum(b and not a for a, b in zip(first, second, strict=True))
    if only_first + only_second == 0:
        return 1.0
    return float(binomtest(only_first, only_first + only_second, 0.5).pvalue)


def percent(part: int, whole: int) -> float:
    """A share in percent, rounded as in tables; 0 of 0 is 0."""
    return round(100.0 * part / whole, 1) if whole else 0.0


def percent_interval(part: int, whole: int) -> tuple[float, float]:
    """The 95 % interval of a share in percent (`wilson`)."""
    low, high = wilson(part, whole)
    return round(100.0 * low, 1), round(100.0 * high, 1)
