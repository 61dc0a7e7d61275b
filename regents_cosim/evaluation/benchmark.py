"""`regents bench`: the numbers of the README, on any traffic."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.evaluation.clean import cleanness
from regents_cosim.evaluation.deviation import deviation
from regents_cosim.evaluation.statistics import wilson
from regents_cosim.mirror.bicycle import Controls, clip
from regents_cosim.mirror.dynamics import controls_between
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
    search: str  # joint, or per-candidate
    background: str  # log, or reactive
    ego: str
    n: int  # windows without a collision before the attack
    colliding_before: int
    no_candidate: int
    successes: int  # windows with a collision after it, as the papers count
    success_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    clean: int  # windows with at least one clean collision (`clean.Cleanness`)
    clean_percent: float
    clean_interval_percent: tuple[float, float]
    collisions: int  # all that were found: a search per candidate finds several in a window
    unattributed_percent: float  # of the collisions: the ego met an agent that the attack had not changed
    rear_end_percent: float  # of the collisions: somebody ran into the back of the ego
    off_road_percent: float  # of the collisions: the adversary left the road before
    hits_others_percent: float  # of the collisions: the adversary touched somebody else before
    deviation_m: float  # mean distance of the adversary to its log, up to the collision
    sumo_verified: int  # of the collisions: the same contact at the same step in SUMO's positions
    sumo_lists: int  # of the collisions: SUMO's own list of collisions holds the pair


def reconstruction_row(network: str, scenarios: Sequence[Scenario]) -> ReconstructionRow:
    """Position errors over all agents and valid steps of `scenarios`."""
    smooth, local = [], []
    for scenario in scenarios:
        world = to_world(scenario)
        smooth.append(_errors(world, world.controls))
        local.append(_errors(world, clip(controls_between(world.dynamics, world.log, world.dt))))
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


def success_row(
    config: AttackConfig, ego: str, attacked: Sequence[Sequence[Scenario]], replays: Sequence[Replay]
) -> SuccessRow:
    """Scores of an attack: `attacked` holds the results of each window, `replays` those of the collisions in SUMO."""
    outcomes = [{case.attack.outcome for case in results if case.attack} for results in attacked]
    n = sum("already_colliding" not in found for found in outcomes)
    successes = sum("collision" in found for found in outcomes)
    flaws = [[flaw for flaw in map(cleanness, results) if flaw] for results in attacked]
    clean = sum(any(flaw.clean for flaw in found) for found in flaws)
    every = [flaw for found in flaws for flaw in found]
    return SuccessRow(
        method=config.label,
        search=config.search,
        background=config.background,
        ego=ego,
        n=n,
        colliding_before=len(outcomes) - n,
        no_candidate=sum("no_candidate" in found for found in outcomes),
        successes=successes,
        success_percent=_percent(successes, n),
        interval_percent=_interval(successes, n),
        clean=clean,
        clean_percent=_percent(clean, n),
        clean_interval_percent=_interval(clean, n),
        collisions=len(every),
        unattributed_percent=_percent(sum(not flaw.attributed for flaw in every), len(every)),
        rear_end_percent=_percent(sum(flaw.rear_ends_ego for flaw in every), len(every)),
        off_road_percent=_percent(sum(flaw.off_road for flaw in every), len(every)),
        hits_others_percent=_percent(sum(flaw.hits_others for flaw in every), len(every)),
        deviation_m=_mean_deviation([case for results in attacked for case in results]),
        sumo_verified=sum(replay.verified for replay in replays),
        sumo_lists=sum(replay.reports_same_pair for replay in replays),
    )


def _mean_deviation(attacked: Iterable[Scenario]) -> float:
    """Mean over the adversaries [m]."""
    found = [one.mean_m for one in map(deviation, attacked) if one]
    return round(float(np.mean(found)), 2) if found else 0.0


_roll_out = eqx.filter_jit(roll_out_background)


def _errors(world: World, controls: Controls) -> Float[np.ndarray, " sample"]:
    """Distance [m] of the roll-out to the log at every valid step."""
    motion = _roll_out(world, controls)
    miss = np.hypot(np.asarray(motion.x - world.log.x, float), np.asarray(motion.y - world.log.y, float))
    return miss[np.asarray(world.valid)]


def _interval(successes: int, n: int) -> tuple[float, float]:
    low, high = wilson(successes, n)
    return round(100.0 * low, 1), round(100.0 * high, 1)


def _percent(part: int, whole: int) -> float:
    return round(100.0 * part / whole, 1) if whole else 0.0
