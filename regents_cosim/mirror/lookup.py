"""Rows of a table by number, for numbers that are known to be in it.

An index in brackets is first counted from the end where it is negative, and answers NaN beyond: half a dozen
operations around each of an attack's look-ups, which cost as much to run and to compile as what they guard.
"""

from typing import Any

from jaxtyping import Array, Int, Shaped


def look_up(table: Shaped[Array, "row *rest"], row: Int[Array, "*axes"]) -> Shaped[Array, "..."]:
    """`table[row]` [*axes *rest]. Every `row` is at least 0 and less than their number, or anything may be found."""
    found: Any = table.at[row].get(mode="promise_in_bounds")
    return found
