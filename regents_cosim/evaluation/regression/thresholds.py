"""Expressions that define what fails a planner: a change of a metric, or an event. This module does not import JAX.

    expression = word { " " word }
    word       = event | limit
    limit      = metric ":" sign number [ "%" ]
    sign       = "-" | "+"
    event      = "telling" | "flawless" | metric that counts what must not happen

`collision` fails a planner that collides, whether or not its baseline does, and `telling` or `flawless` one with such
a collision.

`min_ttc_s:-5%` allows the metric to fall by at most 5 % of its baseline, `max_drac_m_s2:+0.5` to rise by at most 0.5,
`collision:+0` no additional collision. An undefined metric counts as the best value: an ego that meets no other has an
infinite time to collision.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from regents_cosim.checks.names import nearest
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.metrics import COMPARED
from regents_cosim.evaluation.regression.baseline import DriveOutcome

EVENTS = ("telling", "flawless", *(name for name, metric in COMPARED.items() if metric.event))

_LIMIT = re.compile(r"(?P<metric>[a-z_0-9]+):(?P<sign>[+-])(?P<number>\d+(\.\d*)?|\.\d+)(?P<percent>%?)")
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Threshold:
    """The limit on how much worse a metric may get."""

    metric: str
    allowed: float  # 0 or more, in the metric's unit, or as a share of its baseline
    relative: bool
    text: str  # as written by the user

    def violated(self, before: Mapping[str, float | None], now: Mapping[str, float | None]) -> str:
        """A message if the metric got worse by more than is allowed; else empty."""
        if self.metric not in before:
            return f"{self.text}: the baseline has no {self.metric} (accept it again)"
        was, is_ = (_value(self.metric, values.get(self.metric)) for values in (before, now))
        falls = COMPARED[self.metric].better == "more"
        change = self.allowed * abs(was) if self.relative and math.isfinite(was) else self.allowed
        bound = was - change if falls else was + change
        worse = is_ < bound - _ROUNDING if falls else is_ > bound + _ROUNDING
        if not worse:
            return ""
        moved = "fell" if falls else "rose"
        values = f"from {format_value(was)} to {format_value(is_)}, allowed to {format_value(bound)}"
        return f"{self.text}: {self.metric} {moved} {values}"


@dataclass(frozen=True)
class Forbidden:
    """An event that fails a planner in any case, whatever its baseline says."""

    event: str  # one of EVENTS

    def violated(self, now: DriveOutcome) -> str:
        """A message if it happened; else empty."""
        match self.event:
            case "telling" | "flawless" as grade:
                happened = getattr(now, grade) is True
            case "collision":
                happened = now.outcome == "collision"
            case metric:
                happened = (now.metrics.get(metric) or 0.0) > 0.0
        return f"{self.event}: expected none" if happened else ""


def parse_thresholds(expression: str) -> tuple[Threshold | Forbidden, ...]:
    """The words of an expression. Raises RegentsError that says which of them is wrong, and why."""
    return tuple(Forbidden(word) if word in EVENTS else _threshold(word) for word in expression.split())


def format_value(value: float | None) -> str:
    """A metric's value for people."""
    return "-" if value is None else "never" if math.isinf(value) else f"{value:.4g}"


def _threshold(word: str) -> Threshold:
    found = _LIMIT.fullmatch(word)
    if found is None:
        meant = " ".join(one for part in word.split(",") for one in nearest(part, EVENTS))
        raise RegentsError(
            f"threshold {word!r}{f' (did you mean {meant!r}?)' if meant else ''}, expected words separated by blanks: "
            "METRIC:-NUMBER or METRIC:+NUMBER, with % for a share of the baseline, e.g. min_ttc_s:-5% or collision:+0, "
            f"or one of {', '.join(EVENTS)}"
        )
    metric, sign = found["metric"], found["sign"]
    if metric not in COMPARED:
        raise RegentsError(f"threshold {word!r}: unknown metric {metric!r}, expected one of {', '.join(COMPARED)}")
    right = "-" if COMPARED[metric].better == "more" else "+"
    if sign != right:
        raise RegentsError(
            f"threshold {word!r}: of {metric} {COMPARED[metric].better} is better, so say how far it may "
            f"{'fall' if right == '-' else 'rise'}: {metric}:{right}{found['number']}{found['percent']}"
        )
    relative = bool(found["percent"])
    return Threshold(metric, float(found["number"]) / (100.0 if relative else 1.0), relative, word)


def _value(metric: str, measured: float | None) -> float:
    return COMPARED[metric].undefined if measured is None else measured
