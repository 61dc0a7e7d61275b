"""Planners whose numbers their name sets, as in `idm:time_headway=0.2,max_accel=1.5`."""

import math
from dataclasses import fields
from typing import Any

from regents_cosim.errors import PlannerError


def made_with(make: Any, name: str, settings: str) -> Any:
    """What the class `make` of the planner `name` makes with settings, which are fields of it.

    Raises PlannerError for an unknown one.
    """
    return make(**dict(_setting(name, _numbers_of(make), word) for word in settings.split(",")))


def _numbers_of(make: Any) -> list[str]:
    """The fields that are numbers."""
    return [one.name for one in fields(make) if isinstance(one.default, float)]


def _setting(planner: str, known: list[str], word: str) -> tuple[str, float]:
    name, _, number = word.partition("=")
    if name not in known:
        raise PlannerError(
            f"{planner} has no setting {name!r}, expected {planner}:SETTING=NUMBER with one of {', '.join(known)}"
        )
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise PlannerError(f"{planner}:{name} is {number!r}, expected a number of 0 or more")
    return name, value
