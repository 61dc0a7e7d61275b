"""`regents bench`: the numbers of the README, on any traffic."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.evaluation.statistics import wilson
from regents_cosim.mirror.bicycle import Controls, clip, controls_between
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import World, to_world
from regents_cosim.replays.verify import Replay
from regents_cosim.scenario import Scenario


@dataclass(frozen=True)
class ReconstructionRow:
    """How far roll-outs of the estimated controls are from the recorded tracks."""

    network: str
    windows: int
    agents: int
    smooth_mean_cm: float
    smooth_p99_cm: float
    smooth_max_cm: float
    local_mean_cm: float
    local_p99_cm: float


@dataclass(frozen=True)
class SuccessRow:
    """How often an attack on originally collision-free windows ended in a collision."""

    method: str
    ego: str
    n: int  # windows without a collision before the attack
    colliding_before: int
    no_candidate: int
    successes: int
    success_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    attributed_percent: float  # of n: the ego met an agent that the attack changed
    rear_end_percent: float  # of the successes: an adversary ran into the back of the ego
    sumo_verified: int  # of the successes: the same contact at the same step in SUMO's positions
    sumo_lists: int  # of the successes: SUMO's own list of collisions holds the pair


def reconstruction_row(network: str, scenarios: Sequence[Scenario]) -> ReconstructionRow:
    """Position errors over all agents and valid steps of `scenarios`."""
    smooth, local = [], []
    for scenario in scenarios:
        world = to_world(scenario)
        smooth.append(_errors(world, world.controls))
        local.append(_errors(world, clip(controls_between(world.log, world.dt))))
    fitted, differences = 100.0 * np.concatenate(smooth), 100.0 * np.concatenate(local)
    return ReconstructionRow(
        network=network,
        windows=len(scenarios),
        agents=sum(len(scenario.agents) for scenario in scenarios),
        smooth_mean_cm=float(fitted.mean()),
        smooth_p99_cm=float(np.percentile(fitted, 99)),
        smooth_max_cm=float(fitted.max()),
        local_mean_cm=float(differences.mean()),
        local_p99_cm=float(np.percentile(differences, 99)),
    )


def success_row(config: AttackConfig, ego: str, attacked: Iterable[Scenario], replays: Sequence[Replay]) -> SuccessRow:
    """Success as the papers count it: collisions among the originally collision-free windows.

    `replays` are those of the collisions in SUMO.
    """
    records = [scenario.attack for scenario in attacked if scenario.attack is not None]
    before = sum(record.outcome == "already_colliding" for record in records)
    hits = [record.collision for record in records if record.outcome == "collision" and record.collision]
    n = len(records) - before
    low, high = wilson(len(hits), n)
    return SuccessRow(
        method=config.method,
        ego=ego,
        n=n,
        colliding_before=before,
        no_candidate=sum(record.outcome == "no_candidate" for record in records),
        successes=len(hits),
        success_percent=_percent(len(hits), n),
        interval_percent=(round(100 * low, 1), round(100 * high, 1)),
        attributed_percent=_percent(sum(hit.attributed for hit in hits), n),
        rear_end_percent=_percent(sum(hit.kind == "rear_end_by_adversary" for hit in hits), len(hits)),
        sumo_verified=sum(replay.verified for replay in replays),
        sumo_lists=sum(replay.reports_same_pair for replay in replays),
    )


def _errors(world: World, controls: Controls) -> Float[np.ndarray, " sample"]:
    """Distance [m] of the roll-out to the log at every valid step."""
    motion = roll_out_background(world, controls)
    miss = np.hypot(np.asarray(motion.x - world.log.x, float), np.asarray(motion.y - world.log.y, float))
    return miss[np.asarray(world.valid)]


def _percent(part: int, whole: int) -> float:
    return round(100.0 * part / whole, 1) if whole else 0.0
