"""What to say of a name that is not known: the nearest that are, or all."""

import difflib
from collections.abc import Iterable

_NEAR = 0.6  # the least likeness of a suggestion, from 0 to 1


def nearest(name: str, known: Iterable[str], number: int = 1) -> list[str]:
    """The known names most like `name`, whatever its case; none where none is like it."""
    by_small = {one.lower(): one for one in known}
    return [by_small[one] for one in difflib.get_close_matches(name.lower(), list(by_small), number, _NEAR)]


def did_you_mean(name: str, known: Iterable[str], prefix: str = "") -> str:
    """`did you mean merge?`, or `expected one of ...` where nothing is near; each shown with the prefix."""
    among = tuple(known)
    if near := nearest(name, among, 3):
        return f"did you mean {' or '.join(prefix + one for one in near)}?"
    return f"expected one of {', '.join(prefix + one for one in among)}"
