"""The values that a search passes from roll-out to roll-out, from update to update, and at its end."""

from typing import Any

import equinox as eqx
import optax
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.separation import Box


class SearchResult(eqx.Module):
    """The result of a search."""

    motion: Motion  # [agent time] last roll-out, ego in row 0
    controls: ControlArrays  # [agent step] controls that made it, the ego's own in row 0
    changed: Bool[Array, " agent"]  # whether the attack moved this agent's controls
    hit: Bool[Array, ""]
    accepted: Bool[Array, ""]  # a hit of the wanted kind
    finite: Bool[Array, ""]
    any_candidate: Bool[Array, ""]
    iterations: Int[Array, ""]  # updates made
    history: Float[Array, "iteration term"]  # ego, pair and road cost before each update


class StartLooks(eqx.Module):
    """The results of looks at starts, up to the first that is accepted."""

    cost: Float[Array, " start"]  # infinite where it is not finite, or was not looked at
    terms: Float[Array, "start term"]  # ego, pair and road cost
    accepted: Bool[Array, " start"]


class Rollout(eqx.Module):
    """The result of a roll-out."""

    motion: Motion  # [agent time]
    boxes: Box  # [agent time] of that motion
    ego_controls: ControlArrays  # [step]
    kept: Any  # what the planner keeps of this drive for the next one


class SearchState(eqx.Module):
    """The state that one pass of the loop hands to the next."""

    actions: ControlArrays  # [searched step] as shares of their limits
    adam: optax.OptState
    seen: Rollout  # roll-out of those actions, once it has `looked`; before that the log
    looked: Bool[Array, ""]
    hit: Bool[Array, ""]  # the ego collides in the roll-out
    accepted: Bool[Array, ""]  # and it is the wanted collision
    finite: Bool[Array, ""]
    iterations: Int[Array, ""]
    history: Float[Array, "iteration term"]
    least: Float[Array, ""]  # the ego's cost at its last sufficient decrease (`patience`)
    least_at: Int[Array, ""]  # the iteration of that decrease
