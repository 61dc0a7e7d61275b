"""Choose the agents of a scenario that a search may move, and the drives with which each search begins."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.accept import rules
from regents_cosim.attacks.accept.lawful import LawfulRoad, lawful_road, road_near_ego, under_the_law
from regents_cosim.attacks.attacked_cases import failure_of
from regents_cosim.attacks.descent.actions import to_actions
from regents_cosim.attacks.descent.costs import pooled_ego_distances
from regents_cosim.attacks.descent.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import Candidate, SearchJob
from regents_cosim.attacks.methods.moves import Descend, MakeMoves
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.attacks.starts.timed_drives import Start, followed, starts
from regents_cosim.attacks.starts.wanted_manoeuvres import LOOKED_THROUGH, of_wanted_manoeuvres
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.lane_centres import lane_centres
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.world import World, scene_origin, to_tracks, to_world
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, foreign, start
from regents_cosim.scenario.collisions import collides_since
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.ordinary import DrivingLimits

_LANES_AROUND_EGO_M = 60.0  # around its track: a candidate further away is no risk yet
_CONSIDERED = 3  # times as many candidates are considered as are searched


def candidates_of(setup: AttackSetup, scenario: Scenario, make: MakeMoves) -> list[Candidate]:
    """The searches for a scenario: one joint search, or some for each of the most promising candidates."""
    if scenario.attack is not None:
        raise RegentsError(
            f"case {scenario.id} was attacked already (by {scenario.attack.method}); attack the recorded window"
        )
    limits = limits_by_kind(scenario, setup.config)
    world = _world(setup, scenario, limits)
    memory = None
    if isinstance(setup.planner, JaxPlanner):
        scene = CompiledScene(scenario, world)
        memory = start(setup.planner, scene, setup.planner_name)
    allowed = np.array(may_attack(world, setup.config))
    allowed[: len(scenario.agents)] &= collides_since(scenario) == scenario.tracks.steps
    if setup.config.candidates.search == "joint":
        together = SearchJob(world, memory, SearchedAgents.among(jnp.asarray(allowed)))
        return [Candidate(scenario, lambda: together)]
    mere_look = without_candidate(setup.config, scenario, world, memory)
    nobody = Candidate(scenario, lambda: mere_look)
    if not allowed.any():
        return [nobody]
    nearest = _nearest(world, allowed, setup.config)
    ego = None
    if setup.config.tries.starts or setup.config.traffic.background == "reactive":
        driven = _unattacked(setup, scenario, mere_look, make)
        if driven is not None and driven.hit:
            return [nobody]
        if driven is not None and setup.config.tries.starts:
            ego = to_tracks(driven.motion, driven.controls, scenario)
    chosen = _most_promising(setup, scenario, nearest, ego, limits)[: setup.config.candidates.nearest]
    return [_candidate(setup.config, scenario, world, memory, *one) for one in chosen] or [nobody]


# A candidate, the drives with which its search may begin, and the wanted kinds of crash to which they lead.
_Begun = tuple[int, list[Start], frozenset[str]]


def _most_promising(
    setup: AttackSetup, scenario: Scenario, nearest: list[int], ego: Tracks | None, limits: Mapping[str, DrivingLimits]
) -> list[_Begun]:
    """The candidates, the most promising first; without the ego's track the nearest first, and none has a start."""
    if ego is None:
        return [(agent, [], frozenset()) for agent in nearest]
    found = [(agent, *_starts(setup, scenario, agent, ego, limits[scenario.agents[agent].kind])) for agent in nearest]
    found.sort(key=lambda one: -max((start.promise for start in one[1]), default=-np.inf))
    return [one for one in found if one[1]] if setup.chooses_drives else found


def _candidate(
    config: AttackConfig,
    scenario: Scenario,
    world: World,
    memory: Any,
    agent: int,
    found: list[Start],
    kinds: frozenset[str],
) -> Candidate:
    """The searches for one agent, from each of the starts `found` and from the log."""

    def make_job() -> SearchJob:
        road = lawful_road(scenario, agent) if config.bound else None
        return search_job(config, scenario, world, memory, SearchedAgents.only(agent, len(world.valid)), road)

    def make_starts(job: SearchJob) -> list[ControlArrays]:
        return followed(scenario, job, found, config.tries.starts)

    return Candidate(scenario, make_job, make_starts, len(found), kinds)


def _starts(
    setup: AttackSetup, scenario: Scenario, agent: int, ego: Tracks, limits: DrivingLimits
) -> tuple[list[Start], frozenset[str]]:
    """The drives with which a search for an agent may begin, limited to wanted kinds of crash, and these kinds."""
    most, strict = setup.config.tries.starts, setup.config.bound
    if setup.wanted is None or not setup.chooses_drives:
        return starts(scenario, agent, ego, most, limits, strict), frozenset()
    found = starts(scenario, agent, ego, LOOKED_THROUGH * most, limits, strict)
    return of_wanted_manoeuvres(scenario, ego, agent, found, setup.wanted, most)


def _world(setup: AttackSetup, scenario: Scenario, limits: Mapping[str, DrivingLimits]) -> World:
    """The scene on the device, with what the configuration needs; the road only near the ego."""
    strict = setup.config.bound
    world = to_world(scenario, setup.dynamics(scenario), road=road_near_ego(scenario) if strict else None)
    if setup.config.traffic.background == "reactive":
        world = world.for_reactions(scenario)
    if setup.config.acceptance.accept == "telling":
        lanes = lane_centres(scenario, scene_origin(scenario), around_ego_m=_LANES_AROUND_EGO_M)
        world = replace(world, lanes=lanes)
    return with_bounds(world, scenario, setup.config, limits)


def without_candidate(config: AttackConfig, scenario: Scenario, world: World, memory: Any) -> SearchJob:
    """A mere look at the recorded traffic."""
    only = SearchedAgents.only(0, len(world.valid))
    none = replace(only, candidate=on_device(np.zeros(len(world.valid)), np.bool_))
    return search_job(config, scenario, world, memory, none, None)


def search_job(
    config: AttackConfig,
    scenario: Scenario,
    world: World,
    memory: Any,
    searched: SearchedAgents,
    road: LawfulRoad | None,
) -> SearchJob:
    """The search for one agent, on its own `road`; all of them, and the mere look, share one compiled program."""
    if config.bound:
        world = under_the_law(world, scenario, int(searched.first), road, config.acceptance.adversary_may)
    # With starts the log is given as one of them.
    start = None
    if config.tries.starts:
        mine = slice(first := int(searched.first), first + searched.count)
        own = jax.tree.map(lambda values: on_device(np.asarray(values)[mine], np.float32), world.controls)
        start = to_actions(own)
    return SearchJob(world, memory, searched, start)


@in_float32
def candidates_or_failure(setup: AttackSetup, scenario: Scenario, make: MakeMoves) -> "list[Candidate] | DriveError":
    """The searches for a scenario as in `candidates_of`, or the error of a planner that cannot drive there."""
    try:
        return candidates_of(setup, scenario, make)
    except DriveError as failure:
        return failure


def _unattacked(setup: AttackSetup, scenario: Scenario, mere_look: SearchJob, make: MakeMoves) -> SearchResult | None:
    """The ego's drive among recorded traffic; None where the planner fails, as the first attempt will report."""
    with foreign(setup.planner_name, scenario.id):
        (ended,) = make([(scenario, mere_look, Descend(mere_look.start))])
        driven = jax.block_until_ready(ended.found)
    if isinstance(driven, DriveError) or failure_of(setup.planner_name, scenario.id, ended):
        return None
    return driven if driven.finite else None


def _nearest(world: World, allowed: Bool[np.ndarray, " agent"], config: AttackConfig) -> list[int]:
    """The candidates that come nearest to the ego in the log, the nearest first."""
    distances = np.asarray(_logged_distances(world, config))
    order = np.argsort(np.where(allowed, distances, np.inf), kind="stable")
    considered = config.candidates.nearest * (_CONSIDERED if config.tries.starts else 1)
    return [int(agent) for agent in order[:considered] if allowed[agent]]


# Compiled as a whole, since op by op the first call of a process would compile each operation alone.
may_attack = compiled(rules.candidates)


@compiled
def _logged_distances(world: World, config: AttackConfig) -> Float[Array, " agent"]:
    return pooled_ego_distances(world, world.boxes(world.log), config)
