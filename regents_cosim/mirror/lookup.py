"""Look up rows of a table by numbers that are known to be within it.

An index in brackets counts from the end where it is negative, and gives NaN beyond the end: half a dozen operations
around each look-up of an attack, which cost as much to run and to compile as the look-up itself.
"""

from typing import Any

from jaxtyping import Array, Int, Shaped


def look_up(
    table: Shaped[Array, "row *rest"], row: Int[Array, "..."] | tuple[Int[Array, "..."], ...]
) -> Shaped[Array, "..."]:
    """`table[row]`; every `row` must lie in the table, otherwise the result is undefined.

    A tuple has the numbers along each of the first axes of the table.
    """
    found: Any = table.at[row].get(mode="promise_in_bounds")
    return found
