"""Decide when a search that comes no nearer to the ego is given up.

It ends when the ego's cost has not decreased for a while (`AttackConfig.patience`). With `near_m`, a search further
away waits less, and has to decrease faster: at least so fast that it would be near by its last update. Histories of 141
sampling searches and 98 descents show why: those that end in a crash come near within a few dozen updates, or are near
from the start; those that slowly creep nearer never arrive.
"""

from typing import Any

from regents_cosim.attacks.methods.presets import AttackConfig

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
