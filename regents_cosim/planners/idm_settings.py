"""IDM with other settings than its defaults, named `idm:SETTING=NUMBER,...`, such as `idm:time_headway=0.2`."""

import math
from dataclasses import fields

from regents_cosim.errors import PlannerError
from regents_cosim.planners.idm import IDM


def idm_with(settings: str) -> IDM:
    """IDM with the given settings, which are fields of `IDM`. Raises PlannerError for an unknown one."""
    return IDM(**dict(_setting(word) for word in settings.split(",")))


def _setting(word: str) -> tuple[str, float]:
    name, _, number = word.partition("=")
    known = [field.name for field in fields(IDM)]
    if name not in known:
        raise PlannerError(f"idm has no setting {name!r}, expected idm:SETTING=NUMBER with one of {', '.join(known)}")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise PlannerError(f"idm:{name} is {number!r}, expected a number of 0 or more")
    return name, value
