"""What a search passes on: from one roll-out, from one update to the next, and at its end."""

from typing import Any

import equinox as eqx
import optax
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.separation import Box


class SearchResult(eqx.Module):
    """What an attack ended with."""

    motion: Motion  # [agent time] last roll-out, ego in row 0
    controls: ControlArrays  # [agent step] that made it, the ego's own in row 0
    changed: Bool[Array, " agent"]  # the attack moved this agent's controls
    hit: Bool[Array, ""]
    accepted: Bool[Array, ""]  # a hit of the kind that was looked for
    finite: Bool[Array, ""]
    any_candidate: Bool[Array, ""]
    iterations: Int[Array, ""]  # updates made
    history: Float[Array, "iteration term"]  # ego, pair and road cost before each update


class Looks(eqx.Module):
    """What was seen of drives that a search looked at, up to the first that is accepted."""

    cost: Float[Array, " start"]  # infinite where it is not finite, or none was looked at
    terms: Float[Array, "start term"]  # ego, pair and road cost
    accepted: Bool[Array, " start"]


class Rollout(eqx.Module):
    """What a roll-out shows."""

    motion: Motion  # [agent time]
    boxes: Box  # [agent time] of that motion
    ego_controls: ControlArrays  # [step]
    kept: Any  # by the planner, of this drive for the next one


class SearchState(eqx.Module):
    """What one pass of the loop hands to the next."""

    actions: ControlArrays  # [searched step] as shares of their limits
    adam: optax.OptState
    seen: Rollout  # of those actions, once it has `looked`; before that of the log
    looked: Bool[Array, ""]
    hit: Bool[Array, ""]  # the ego collides in what has been seen
    accepted: Bool[Array, ""]  # and the search has found what it looks for
    finite: Bool[Array, ""]
    iterations: Int[Array, ""]
    history: Float[Array, "iteration term"]
    least: Float[Array, ""]  # of the ego's cost, when it last came down by enough (`patience`)
    least_at: Int[Array, ""]  # the iteration of that
