"""Suggest known names in place of an unknown one."""

import difflib
from collections.abc import Iterable

_NEAR = 0.6  # least similarity of a suggestion, from 0 to 1


def nearest(name: str, known: Iterable[str], number: int = 1) -> list[str]:
    """Up to `number` known names similar to `name`, upper and lower case alike; empty where none is similar."""
    by_small = {one.lower(): one for one in known}
    return [by_small[one] for one in difflib.get_close_matches(name.lower(), list(by_small), number, _NEAR)]


def did_you_mean(name: str, known: Iterable[str], prefix: str = "") -> str:
    """A hint such as `did you mean merge?`, or the full list where no name is similar; `prefix` precedes names."""
    among = tuple(known)
    if near := nearest(name, among, 3):
        return f"did you mean {' or '.join(prefix + one for one in near)}?"
    return f"expected one of {', '.join(prefix + one for one in among)}"
