"""The values that a search passes from roll-out to roll-out, from update to update, and at its end."""

from typing import Any

import equinox as eqx
import numpy as np
import optax
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.methods.presets import AttackConfig
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

    def made(self, number: int) -> int:
        """How many of the first `number` were made: all, or those up to the one that is accepted."""
        accepted = np.asarray(self.accepted)[:number]
        return int(np.argmax(accepted)) + 1 if accepted.any() else number


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


# A search that comes no nearer to the ego is given up: it ends when the ego's cost has not decreased for a while
# (`AttackConfig.patience`). With `near_m`, a search further away waits less, and has to decrease faster: at least so
# fast that it would be near by its last update. Histories of 141 sampling searches and 98 descents show why: those that
# end in a crash come near within a few dozen updates, or are near from the start; those that slowly creep nearer never
# arrive.
_PROGRESS = 0.02  # least decrease of the ego's cost, as a share, for a search to go on


def updates_to_wait(config: AttackConfig, least: Any) -> Any:
    """The number of updates that a search whose ego's cost is `least` [m, an array] waits for a decrease."""
    return config.steps.patience * _nearness(config, least)


def decreases_enough(config: AttackConfig, cost: Any, least: Any, left: Any) -> Any:
    """Whether the ego's cost [m] has decreased enough from `least`, with `left` updates left."""
    nearness = _nearness(config, least)
    pace = (1.0 - nearness) * config.steps.patience * nearness / left
    return cost < (1.0 - _PROGRESS - (pace - _PROGRESS) * (pace > _PROGRESS)) * least


def _nearness(config: AttackConfig, least: Any) -> Any:
    """The nearness of a search: 1 for all that are near, less for others."""
    return config.steps.near_m / least.clip(min=config.steps.near_m) if config.steps.near_m else 1.0
