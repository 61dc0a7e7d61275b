"""When a search that comes no nearer to the ego is given up.

It ends when the ego's cost has not come down for a while, `AttackConfig.patience`. Where `near_m` is given, the further
away a search is, the less it waits, and the more it has to come down: at least so fast that it would be near by its
last update. Histories of 141 searches that sample and 98 descents show why: those that end in a crash come near within
a few dozen updates, or are near from the start. Those that creep nearer from far away never get there.
"""

from typing import Any

from regents_cosim.attacks.presets import AttackConfig

_PROGRESS = 0.02  # share of the ego's cost by which it has to come down at least for the search to go on


def waits(config: AttackConfig, least: Any) -> Any:
    """How many updates a search whose ego's cost has come down to `least` [m, an array] waits until it comes nearer."""
    return config.patience * _nearness(config, least)


def comes_down(config: AttackConfig, cost: Any, least: Any, left: Any) -> Any:
    """Whether the ego's cost [m] has come down from its `least` by enough, with so many updates `left`."""
    nearness = _nearness(config, least)
    pace = (1.0 - nearness) * config.patience * nearness / left
    return cost < (1.0 - _PROGRESS - (pace - _PROGRESS) * (pace > _PROGRESS)) * least


def _nearness(config: AttackConfig, least: Any) -> Any:
    """1 for all that are near, less for others."""
    return config.near_m / least.clip(min=config.near_m) if config.near_m else 1.0
