"""Look up rows of a table by numbers that are known to be within it.

An index in brackets counts from the end where it is negative, and is held to the table: half a dozen operations around
each look-up of an attack, which cost more to trace and to compile than the look-up itself.
"""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

_Tree = TypeVar("_Tree")


def look_up(
    table: Shaped[Array, "row *rest"], row: Int[Array, "..."] | tuple[Int[Array, "..."], ...]
) -> Shaped[Array, "..."]:
    """`table[row]`; every `row` must lie in the table, otherwise the result is undefined.

    A tuple has the numbers along each of the first axes of the table.
    """
    if not isinstance(row, tuple) and jnp.ndim(row) == 0:
        return jax.lax.dynamic_index_in_dim(table, row, keepdims=False, allow_negative_indices=False)
    found: Any = table.at[row].get(mode="promise_in_bounds", wrap_negative_indices=False)
    return found


def rows_of(values: _Tree, row: Int[Array, "..."]) -> _Tree:
    """The rows of all arrays of a tree, numbered as in `look_up`."""
    return jax.tree.map(lambda table: look_up(table, row), values)


def interpolate(
    table: Shaped[Array, "row *rest"], before: Any, after: Any, part: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Between two entries of a table, at a `part` from 0 to 1 of the way; numbers as in `look_up`."""
    return look_up(table, before) * (1.0 - part) + look_up(table, after) * part
