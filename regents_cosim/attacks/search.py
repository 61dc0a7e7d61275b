"""One search, compiled as a whole: of the method as its papers have it, or as its public code does."""

from typing import Any

from jaxtyping import Array, Int

from regents_cosim.attacks.descent import Descent, ExtraCost
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.published import PublishedDescent
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.attacks.universal import AttackedPlanners, UniversalDescent
from regents_cosim.mirror.bicycle import Controls
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.rollout import LoopPlanner
from regents_cosim.mirror.world import World


def set_up(
    world: World,
    planner: LoopPlanner,
    memory: Any,
    config: AttackConfig,
    searched: SearchedAgents,
    start: Controls | None = None,
    extra_cost: ExtraCost | None = None,
) -> Descent:
    """The descent that `config` asks for, on `planner` (with its `memory` of the scene) in `world`."""
    kind = PublishedDescent if config.as_published else Descent
    kind = UniversalDescent if isinstance(planner, AttackedPlanners) else kind
    return kind.of(world, planner, memory, searched, config, start, extra_cost)


@compiled
def descend(
    world: World,
    planner: LoopPlanner,
    memory: Any,
    config: AttackConfig,
    searched: SearchedAgents,
    iterations: Int[Array, ""],
    start: Controls | None = None,
    extra_cost: ExtraCost | None = None,
) -> SearchResult:
    """Attack `planner` in `world` with the controls of `searched`, up to a collision or the last of `iterations`.

    The search begins with the actions `start` [searched step], or with the logged ones. `config` is what
    `AttackConfig.compiled` leaves, so that the number of iterations needs no program of its own.
    """
    descent = set_up(world, planner, memory, config, searched, start, extra_cost)
    return descent.result(descent.advance(descent.begin(), iterations))
