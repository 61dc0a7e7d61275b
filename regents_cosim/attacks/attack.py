"""Scenarios in, attacked Scenarios out: one scenario per thread or many in one program, results as values."""

import dataclasses
import itertools
import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks import published
from regents_cosim.attacks.attempts import Candidate, Search, attempt
from regents_cosim.attacks.costs import pooled_ego_distances
from regents_cosim.attacks.descent import ExtraCost, Found, to_actions
from regents_cosim.attacks.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.job import Ended, Job
from regents_cosim.attacks.lanes import search_in_lanes
from regents_cosim.attacks.lawful import under_the_law
from regents_cosim.attacks.movers import Movers
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.pursuit import Drives, Request, in_compiled_loop, in_process, pursue
from regents_cosim.attacks.replanned import Traffic
from regents_cosim.attacks.rules import candidates
from regents_cosim.attacks.search import descend
from regents_cosim.attacks.starts import Start, followed, starts
from regents_cosim.attacks.universal import Several
from regents_cosim.checks.names import distinct_word, file_name, word
from regents_cosim.checks.ranges import Range
from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.mirror.bicycle import Controls, Motion
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.lane_centres import lane_centres
from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.world import World, scene_origin, to_tracks, to_world
from regents_cosim.planners.host_pool import HostPool
from regents_cosim.planners.host_process import HostProcess
from regents_cosim.planners.jax_planner import JaxPlanner, LoopScene, foreign, require_finite, start
from regents_cosim.planners.patience import ACT_TIMEOUT, ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario import ActTime, AttackRecord, Collision, Dynamics, Outcome, Scenario, Tracks
from regents_cosim.system.logged import logged
from regents_cosim.verdicts.judgement import is_telling

_LABEL = 40  # characters of a planner or an adversary in the id of a case
_CONSIDERED = 3  # times the candidates that are searched: so many are asked for ways that meet the ego
_COST_TERMS = ("ego", "pair", "road")
_BATCH = Range(1, 100_000, "scenarios on the device at once", whole=True)

Engine = Literal["auto", "threads", "lanes"]


def attack(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: AnyPlanner = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
    act_timeout_s: float = ACT_TIMEOUT_S,
    against: Sequence[AnyPlanner] = (),
) -> Iterator[Scenario]:
    """All results of `attack_each`, one after the other."""
    for results in attack_each(scenarios, config, planner, batch, extra_cost, engine, act_timeout_s, against):
        yield from results


def _ended(results: list[Scenario]) -> str:
    """For the log: how the searches on one scenario ended."""
    said = []
    for case in results:
        assert case.attack is not None
        hit = case.attack.collision
        with_whom = f" with {hit.agent} at step {hit.step}" if hit else ""
        said.append(f"{case.id}: {case.attack.outcome}{with_whom}, {case.attack.iterations} iterations")
    return "attacked " + "; ".join(said)


@logged(_ended)
def attack_each(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: AnyPlanner = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
    act_timeout_s: float = ACT_TIMEOUT_S,
    against: Sequence[AnyPlanner] = (),
) -> Iterator[list[Scenario]]:
    """Attack every scenario, in order; yields the results of each as soon as it is done.

    A joint search gives one result, a search per candidate one for every distinct adversary that
    succeeds, or one without a collision. The search never fails: how it ended is
    `attack.outcome`. At most `batch` scenarios are held on the device at once. Raises
    PlannerError where the planner cannot be found, RegentsError for a scenario that was attacked
    before.

    `engine` is "threads", one scenario per core, or "lanes", `batch` searches in one program;
    "auto" takes threads on a CPU and lanes on an accelerator. Lanes are for planners in JAX that
    drive in every iteration; others go by threads.

    A planner that is not in JAX drives in a process of its own, every `config.replan_every`
    iterations; one that fails, or takes more than `act_timeout_s` for a decision, costs its
    scenario only.

    `extra_cost` of (World, Motion [agent, time] with the ego in row 0, Controls [agent, step]) is
    added to the cost, to ask for more than a collision; it must be differentiable by JAX.

    `against` names more planners, in JAX too: then one adversary is to make all of them crash
    (`universal`), and `attack.settings["crashed"]` names those that do. The ego of the resulting
    case is driven by `planner`.
    """
    under_test = PlannerUnderTest.of(planner)
    name, loop = under_test.name, under_test.loop
    if against:
        loop = _several([under_test, *map(PlannerUnderTest.of, against)], config)
    if config.optimiser != "adam" and loop is None:
        raise RegentsError(f"method {config.method} needs a planner in JAX, {name!r} is not: take king or regents")
    _BATCH.check("batch", batch)
    ACT_TIMEOUT.check("act-timeout", act_timeout_s)
    if loop is None:
        with HostPool(under_test, act_timeout_s) as hosts:
            yield from _on_hosts(scenarios, _Attack(_replanning(config, 10), None, name, extra_cost), batch, hosts)
        return
    under_attack = _Attack(_replanning(config, 1), loop, name, extra_cost)
    if engine == "auto":
        engine = "threads" if jax.default_backend() == "cpu" else "lanes"
    only_threads = under_attack.config.replan_every > 1 or config.optimiser != "adam"
    run = _in_threads if engine == "threads" or only_threads else _in_lanes
    yield from run(scenarios, under_attack, batch)


def _several(planners: Sequence[PlannerUnderTest], config: AttackConfig) -> Several:
    """The planners of an attack on several. Raises RegentsError."""
    names = tuple(planner.name for planner in planners)
    for planner in planners:
        if planner.loop is None:
            raise RegentsError(
                f"planner {planner.name!r} is not in JAX: only planners in JAX are attacked several at once "
                "(attack one of them and replay its adversaries against the others: `regents bench cross`)"
            )
    if len(set(names)) < len(names):
        raise RegentsError(f"planners {', '.join(names)}: expected each of them once")
    if config.as_published or config.replan_every > 1 or config.optimiser != "adam":
        raise RegentsError(
            "several planners are attacked at once by gradients, in every iteration and by our own code: "
            "leave out --as-published and --replan-every, and take method king, regents or focused"
        )
    return Several(tuple(planner.loop for planner in planners if planner.loop is not None), names)


def _who_crashes(several: Several, scenario: Scenario, job: Job, background: Motion, controls: Controls) -> list[str]:
    """Names of the planners that crash among `background`, each in a drive of its own, by the exact boxes.

    Raises DriveError for one that fails there.
    """
    crashed = []
    for name, planner, memory in zip(several.names, several.planners, job.memory, strict=True):
        request = Request(scenario, job._replace(memory=memory), Traffic(background, None))
        (driven,) = in_compiled_loop(planner, name)([request])
        if isinstance(driven, DriveError):
            raise driven
        tracks = to_tracks(with_ego(background, driven.ego.motion), controls, scenario)
        if first_contact(scenario.agents, tracks):
            crashed.append(name)
    return crashed


def _replanning(config: AttackConfig, default: int) -> AttackConfig:
    return config if config.replan_every else replace(config, replan_every=default)


@dataclass(frozen=True)
class _Attack:
    """What is the same for all scenarios of an attack."""

    config: AttackConfig
    planner: JaxPlanner | None  # None: one that is not in JAX
    planner_name: str
    extra_cost: ExtraCost | None

    def dynamics(self, scenario: Scenario) -> Dynamics:
        """The model by which vehicles move in `scenario`."""
        return scenario.dynamics if self.config.dynamics == "recorded" else self.config.dynamics

    def jobs(self, scenario: Scenario, drives: Drives) -> list[Candidate]:
        """The searches that a scenario takes: one, or some for each of the candidates that promise most."""
        if scenario.attack is not None:
            raise RegentsError(
                f"case {scenario.id} was attacked already (by {scenario.attack.method}); attack its original recording"
            )
        world = to_world(scenario, self.dynamics(scenario))
        if self.config.accept == "telling":
            world = replace(world, lanes=lane_centres(scenario, scene_origin(scenario)))
        limits = limits_by_kind(scenario, self.config)
        world = with_bounds(world, scenario, self.config, limits)
        memory = None
        if isinstance(self.planner, JaxPlanner):
            scene = LoopScene(scenario, world)
            several = isinstance(self.planner, Several)
            memory = self.planner.init(scene) if several else start(self.planner, scene, self.planner_name)
        allowed = np.asarray(_candidates(world, self.config))
        if self.config.search == "joint" or not allowed.any():
            return [Candidate(scenario, Job(world, memory, Movers.among(jnp.asarray(allowed))))]
        nearest = _nearest(world, allowed, self.config)
        ego = self.unattacked(scenario, world, memory, drives) if self.config.starts else None
        if ego is None:
            return [self.candidate(scenario, world, memory, agent, ()) for agent in nearest[: self.config.nearest]]
        kinds = [agent.kind for agent in scenario.agents]
        most = self.config.starts
        found = {agent: starts(scenario, agent, ego, most, limits[kinds[agent]]) for agent in nearest}
        chosen = sorted(nearest, key=lambda agent: -max((one.promise for one in found[agent]), default=-np.inf))
        return [self.candidate(scenario, world, memory, agent, found[agent]) for agent in chosen[: self.config.nearest]]

    def candidate(self, scenario: Scenario, world: World, memory: Any, agent: int, found: Sequence[Start]) -> Candidate:
        """What may be searched for one agent: from each of the starts `found`, and from the log."""
        if self.config.law == "strict":
            world = under_the_law(world, scenario, agent)
        job = Job(world, memory, Movers.only(agent, len(world.valid)))
        if not self.config.starts:
            return Candidate(scenario, job)
        # The log is given as a start as well: one compiled program for all searches.
        job = job._replace(start=job.movers.rows(to_actions(world.controls)))
        return Candidate(scenario, job, tuple(followed(scenario, job, found, self.config.starts)))

    def unattacked(self, scenario: Scenario, world: World, memory: Any, drives: Drives) -> Tracks | None:
        """The ego's track [1, time] among the traffic as it was recorded; None where it fails or collides there."""
        job = Job(world, memory[0] if isinstance(self.planner, Several) else memory, Movers.only(0, len(world.valid)))
        background = _undisturbed(world)
        reacting = world.vehicle if self.config.background == "reactive" else None
        (driven,) = drives([Request(scenario, job, Traffic(background, reacting))])
        if isinstance(driven, DriveError):
            return None  # the first attempt will say why
        tracks = to_tracks(with_ego(background, driven.ego.motion), world.controls, scenario)
        return None if first_contact(scenario.agents, tracks) else tracks

    def jobs_or_failure(self, scenario: Scenario, drives: Drives) -> "list[Candidate] | DriveError":
        """The same, or why the planner cannot drive there."""
        try:
            return self.jobs(scenario, drives)
        except DriveError as failure:
            return failure

    def loop(self) -> Drives:
        """Closed loops of the planner in JAX; of several, of the first."""
        first = self.planner.planners[0] if isinstance(self.planner, Several) else self.planner
        assert isinstance(first, JaxPlanner)
        return in_compiled_loop(first, self.planner_name)

    def run(self, scenario: Scenario) -> list[Scenario]:
        """One result, or one for every distinct adversary, against a planner in JAX."""
        assert isinstance(self.planner, JaxPlanner)
        loop = self.loop()
        if self.config.optimiser != "adam":
            return self.search([scenario], self.blind, loop)[0]
        pursued = self.config.replan_every > 1
        return self.search([scenario], self.pursuit(loop) if pursued else self.descend, loop)[0]

    def search(
        self, scenarios: list[Scenario], run: Search, drives: Drives, pool: Executor | None = None
    ) -> list[list[Scenario]]:
        """The results of several scenarios whose descents are made together; `pool` prepares them.

        Where the planner raises in the program that they share, each answers for itself.
        """
        try:
            with foreign(self.planner_name, scenarios[0].id):
                return self._search(scenarios, run, drives, pool)
        except DriveError as failure:
            if len(scenarios) == 1:
                return [[self.failed(scenarios[0], failure)]]
        return [self.search([scenario], run, drives)[0] for scenario in scenarios]

    def _search(
        self, scenarios: list[Scenario], run: Search, drives: Drives, pool: Executor | None
    ) -> list[list[Scenario]]:
        prepare = partial(self.jobs_or_failure, drives=drives)
        jobs = list((pool.map if pool else map)(prepare, scenarios))
        made = [one for mine in jobs if not isinstance(mine, DriveError) for one in mine]
        ended = iter(attempt(made, self.told(run), self.config))
        return [
            [self.failed(scenario, mine)]
            if isinstance(mine, DriveError)
            else self.results(scenario, [one.job for one in mine], list(itertools.islice(ended, len(mine))))
            for scenario, mine in zip(scenarios, jobs, strict=True)
        ]

    def told(self, run: Search) -> Search:
        """The same searches; where a telling crash is wanted, the exact verdict on the host has the last word."""
        if self.config.accept != "telling":
            return run
        return lambda jobs, most: [
            self.if_telling(*job, one, looked=most == 0) for job, one in zip(jobs, run(jobs, most), strict=True)
        ]

    def if_telling(self, scenario: Scenario, job: Job, ended: Ended, looked: bool) -> Ended:
        """How a search ended; with success where its crash tells something, as far as that is known.

        The device is stricter than the host: of a mere look every crash is judged.
        """
        found = ended.found
        if not isinstance(found, Found) or not (bool(found.hit) if looked else ended.accepted):
            return ended
        if not looked and _outcome(found) != "collision":
            return ended
        taken, spoilt = (
            replace(ended, found=eqx.tree_at(lambda one: one.accepted, found, jnp.asarray(accepted)))
            for accepted in (True, False)
        )
        tells = is_telling(self.attacked(scenario, job, taken), lawful=self.config.law == "strict")
        return spoilt if tells is False else taken

    def descend(self, jobs: Sequence[tuple[Scenario, Job]], iterations: int) -> list[Ended]:
        """One descent after the other, with a planner in JAX that drives in every iteration."""
        assert isinstance(self.planner, JaxPlanner)
        planner, config, most = self.planner, self.config.compiled(), jnp.int32(iterations)
        return [
            Ended(descend(job.world, planner, job.memory, config, job.movers, most, job.start, self.extra_cost))
            for _, job in jobs
        ]

    def blind(self, jobs: Sequence[tuple[Scenario, Job]], iterations: int) -> list[Ended]:
        """Searches without gradients."""
        from regents_cosim.attacks.blind import search_blindly  # with a library that takes half a second to import

        assert isinstance(self.planner, JaxPlanner)
        return search_blindly(jobs, self.planner, self.config, iterations, self.extra_cost)

    def pursuit(self, drives: Drives) -> Search:
        """Descents whose planner drives every few iterations."""
        return lambda jobs, most: pursue(jobs, self.config, self.config.replan_every, drives, most, self.extra_cost)

    def lanes(self, batch: int) -> Search:
        """Descents in `batch` lanes of one program."""
        assert isinstance(self.planner, JaxPlanner)
        planner = self.planner

        def run(jobs: Sequence[tuple[Scenario, Job]], iterations: int) -> list[Ended]:
            found = search_in_lanes((job for _, job in jobs), planner, self.config, batch, iterations, self.extra_cost)
            return [Ended(one) for one in found]

        return run

    def results(self, scenario: Scenario, jobs: list[Job], ended: list[Ended | None]) -> list[Scenario]:
        """What the descents found, as cases."""
        made = [(job, one) for job, one in zip(jobs, ended, strict=True) if one]
        failures = [failure for _, one in made if (failure := _failure(self.planner_name, scenario.id, one))]
        cases = [self.failed(scenario, failures[0])] if failures else self.distinct(scenario, made, len(jobs) == 1)
        time = _act_time([second for _, one in made for second in one.seconds])
        made_of_them = sum(
            one.looks + one.earlier + int(one.found.iterations) for _, one in made if isinstance(one.found, Found)
        )
        return [
            replace(case, attack=replace(case.attack, act_time=time, rollouts=made_of_them))
            for case in cases
            if case.attack
        ]

    def distinct(self, scenario: Scenario, made: list[tuple[Job, Ended]], joint: bool) -> list[Scenario]:
        """A case for every adversary, the accepted before the others; or one without a collision."""
        attacked = [self.attacked(scenario, job, one) for job, one in made]
        by_adversary: dict[str, Scenario] = {}
        for case, _ in sorted(zip(attacked, made, strict=True), key=lambda pair: not pair[1][1].accepted):
            record = case.attack
            if joint or record is None or record.outcome == "already_colliding":
                return [case]
            by_adversary.setdefault(record.collision.agent if record.collision else "", case)
        missed = by_adversary.pop("", scenario)
        if missed.attack:
            records = [case.attack for case in attacked if case.attack]
            tried = tuple(sorted(name for record in records for name in record.candidates))
            spoilt = any(record.spoilt for record in records)
            missed = replace(missed, attack=replace(missed.attack, candidates=tried, spoilt=spoilt))
        return [_named_after_adversary(hit) for hit in by_adversary.values()] or [missed]

    def attacked(self, scenario: Scenario, job: Job, ended: Ended) -> Scenario:
        """What a descent found, as a case."""
        found = ended.found
        assert isinstance(found, Found)
        outcome = _outcome(found)
        present = published.stay(scenario) if self.config.as_published else scenario
        # Of a search that met spoilt collisions only there is nothing to show: the traffic stays as it was.
        as_it_was = outcome == "diverged" or (found.hit and not found.accepted)
        tracks = scenario.tracks if as_it_was else to_tracks(found.motion, found.controls, present)
        collision = _collision(scenario, tracks, found) if found.accepted and outcome != "diverged" else None
        struck = collision.agent if collision and outcome == "collision" else None
        agents = tuple(replace(a, role="adversary") if a.id == struck else a for a in scenario.agents)
        record = replace(
            self.record(scenario, outcome),
            iterations=ended.earlier + int(found.iterations),
            collision=collision,
            spoilt=bool(found.hit) and not found.accepted,
            candidates=tuple(scenario.agents[index].id for index in np.flatnonzero(job.movers.candidate)),
            cost_history=dict(zip(_COST_TERMS, _history(found), strict=True)),
        )
        if isinstance(self.planner, Several):
            # Where the search diverged, one of them may have: the log tells.
            told = (job.world.log, job.world.controls) if outcome == "diverged" else (found.motion, found.controls)
            crashed = _who_crashes(self.planner, scenario, job, *told)
            if outcome != "diverged":
                record = replace(record, settings=record.settings | {"crashed": " ".join(crashed)})
        return replace(
            scenario, id=self.name(scenario), agents=agents, tracks=tracks, attack=record, original=scenario.tracks
        )

    def failed(self, scenario: Scenario, failure: DriveError) -> Scenario:
        """The case of a planner that failed: the traffic as it was, and what the planner said."""
        record = replace(self.record(scenario, "planner_error"), planner_error=f"{failure}\n{failure.trace}".strip())
        return replace(scenario, id=self.name(scenario), attack=record, original=scenario.tracks)

    def record(self, scenario: Scenario, outcome: Outcome) -> AttackRecord:
        """What is known of an attack before it has done anything."""
        config = replace(self.config, dynamics=self.dynamics(scenario))
        settings = {k: v for k, v in dataclasses.asdict(config).items() if k not in ("method", "universal")}
        if isinstance(self.planner, Several):
            settings |= {"universal": config.universal, "against": " ".join(self.planner.names[1:])}
        return AttackRecord(
            case=scenario.id,
            method=config.method,
            planner=self.planner_name,
            outcome=outcome,
            iterations=0,
            settings=settings,
        )

    def name(self, scenario: Scenario) -> str:
        """The id of an attacked case."""
        names = self.planner.names if isinstance(self.planner, Several) else (self.planner_name,)
        return file_name(scenario.id, self.config.label, "+".join(map(_label, names)))


def _in_threads(scenarios: Iterable[Scenario], attack: _Attack, batch: int) -> Iterator[list[Scenario]]:
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        waiting: deque[Future[list[Scenario]]] = deque()
        for scenario in scenarios:
            waiting.append(pool.submit(attack.run, scenario))
            if len(waiting) >= batch:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _on_hosts(scenarios: Iterable[Scenario], attack: _Attack, batch: int, hosts: HostPool) -> Iterator[list[Scenario]]:
    """Planners outside the mirror: batches side by side in one process, or a process for each core."""
    with hosts.lend() as host:
        side_by_side = _takes_batches(host)
    rest = iter(scenarios)
    with ThreadPoolExecutor(1 if side_by_side else os.cpu_count() or 1) as pool:
        waiting: deque[Future[list[list[Scenario]]]] = deque()
        while some := list(itertools.islice(rest, batch if side_by_side else 1)):
            waiting.append(pool.submit(_driven_on_host, attack, some, hosts))
            if len(waiting) >= batch:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()


def _takes_batches(process: HostProcess) -> bool:
    try:
        return process.batches()
    except DriveError:
        return False  # each case will say so


def _driven_on_host(attack: _Attack, some: list[Scenario], hosts: HostPool) -> list[list[Scenario]]:
    with hosts.lend() as host:
        drives = in_process(host)
        return attack.search(some, attack.pursuit(drives), drives)


def _in_lanes(scenarios: Iterable[Scenario], attack: _Attack, batch: int) -> Iterator[list[Scenario]]:
    rest = iter(scenarios)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        while some := list(itertools.islice(rest, batch)):
            yield from attack.search(some, attack.lanes(batch), attack.loop(), pool)


def _nearest(world: World, allowed: Bool[np.ndarray, " agent"], config: AttackConfig) -> list[int]:
    """The candidates that come nearest to the ego in the log, the nearest first."""
    distances = np.asarray(_logged_distances(world, config))
    order = np.argsort(np.where(allowed, distances, np.inf), kind="stable")
    considered = config.nearest * (_CONSIDERED if config.starts else 1)
    return [int(agent) for agent in order[:considered] if allowed[agent]]


# Compiled as a whole: op by op, the first call of a process would compile each of them alone.
@compiled
def _candidates(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    return published.candidates(world, config) if config.as_published else candidates(world, config)


@compiled
def _undisturbed(world: World) -> Motion:
    return roll_out_background(world, world.controls)


@compiled
def _logged_distances(world: World, config: AttackConfig) -> Float[Array, " agent"]:
    return pooled_ego_distances(world, world.boxes(world.log), config)


def _named_after_adversary(attacked: Scenario) -> Scenario:
    adversary = next(agent.id for agent in attacked.agents if agent.role == "adversary")
    return replace(attacked, id=file_name(attacked.id, distinct_word(adversary, _LABEL)))


def _label(planner: str) -> str:
    """The last part of a planner's name."""
    return word(planner.rpartition(":")[2], _LABEL)


def _outcome(found: Found) -> Outcome:
    if not found.finite:
        return "diverged"
    if found.accepted:
        return "collision" if int(found.iterations) > 0 or np.asarray(found.changed).any() else "already_colliding"
    return "no_collision" if found.any_candidate else "no_candidate"


def _collision(scenario: Scenario, tracks: Tracks, found: Found) -> Collision:
    """The first contact, by the exact boxes of the host."""
    contact = first_contact(scenario.agents, tracks)
    if contact is None:
        raise RuntimeError(f"case {scenario.id}: the mirror saw a collision that the exact boxes do not confirm")
    return collision_at(scenario.agents, tracks, contact, scenario.dt, bool(np.asarray(found.changed)[contact[0]]))


def _history(found: Found) -> list[tuple[float, ...]]:
    """Costs before each update; those that blew up, which JSON cannot hold, are left out."""
    rounded = np.asarray(found.history, float)[: int(found.iterations)].round(6)
    rounded = rounded[np.isfinite(rounded).all(axis=1)]
    return [tuple(term.tolist()) for term in rounded.T]


def _failure(name: str, case: str, ended: Ended) -> DriveError | None:
    """How the planner failed; one in JAX by an answer that is no number, others are checked as they answer."""
    if isinstance(ended.found, DriveError):
        return ended.found
    try:
        require_finite(jax.tree.map(lambda values: values[0], ended.found.controls), name, case)
    except DriveError as failure:
        return failure
    return None


def _act_time(seconds: list[float]) -> ActTime | None:
    """Median and 99th percentile of how long decisions took; None for a planner in JAX."""
    if not seconds:
        return None
    median, p99 = (round(1e3 * float(value), 4) for value in np.percentile(seconds, [50, 99]))
    return ActTime(median, p99, len(seconds))
