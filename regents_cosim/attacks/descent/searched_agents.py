"""The agents whose controls one descent may change: all candidates, or a single one.

A search over all candidates works on the rows of all agents, a search for one candidate on its row alone, so that the
others need no roll-out, no gradient and no state of the optimiser.
"""

from functools import partial
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, PyTree

from regents_cosim.mirror.programs.on_device import on_device

_Tree = TypeVar("_Tree", bound=PyTree)


class SearchedAgents(eqx.Module):
    """`count` rows of the agent axis from `first` on, and which of them are candidates."""

    candidate: Bool[Array, " agent"]
    first: Int[Array, ""]
    count: int = eqx.field(static=True)
    # their log is an attack already, and counts even if unchanged
    continues: bool = eqx.field(static=True, default=False)

    @staticmethod
    def among(candidate: Bool[Array, " agent"]) -> "SearchedAgents":
        """All candidates together."""
        return SearchedAgents(candidate, jnp.int32(0), candidate.shape[0])

    @staticmethod
    def only(agent: int, agents: int, continues: bool = False) -> "SearchedAgents":
        """One of `agents` agents; `continues` says that its log is an attack already."""
        candidate = on_device(np.arange(agents) == agent, np.bool_)
        return SearchedAgents(candidate, on_device(agent, np.int32), 1, continues)

    @property
    def are_all(self) -> bool:
        """Whether all agents have a row."""
        return self.count == self.candidate.shape[0]

    def rows(self, values: _Tree) -> _Tree:
        """The searched agents' rows of arrays [agent, ...]."""
        if self.are_all:
            return values
        part = partial(jax.lax.dynamic_slice_in_dim, allow_negative_indices=False)
        return jax.tree.map(lambda all_: part(all_, self.first, self.count), values)

    def put(self, values: _Tree, rows: _Tree) -> _Tree:
        """Arrays [agent, ...] with the rows of candidates replaced."""
        mine = self.rows(self.candidate)

        def replace(all_: Array, own: Array) -> Array:
            chosen = jnp.where(mine.reshape(-1, *(1,) * (all_.ndim - 1)), own, self.rows(all_))
            if self.are_all:
                return chosen
            return jax.lax.dynamic_update_slice_in_dim(all_, chosen, self.first, 0, allow_negative_indices=False)

        return jax.tree.map(replace, values, rows)
