"""Run searches whose planner drives only every few iterations, in a compiled loop or in a process.

Several searches run side by side where the planner takes batches of scenes.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np

from regents_cosim.attacks.descent.replanned import BackgroundTraffic, searching
from regents_cosim.attacks.descent.step import ExtraCost
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import DriveError
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.rollout import EgoTrack, ask, drive, drive_among_reacting
from regents_cosim.mirror.world import World
from regents_cosim.planners.closed_loop import ClosedLoop, drive_on_host
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.jax_planner import JaxPlanner, foreign, require_finite
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False)
class DriveRequest:
    """A closed loop that a search asks for."""

    scenario: Scenario
    job: SearchJob
    traffic: BackgroundTraffic

    @property
    def unattacked(self) -> bool:
        """Whether no road user attacks."""
        return not np.asarray(self.job.searched.candidate).any()


@dataclass(frozen=True, eq=False)
class ClosedLoopDrive:
    """The ego's track in a closed loop, and the times of its decisions [s]."""

    ego: EgoTrack
    seconds: list[float] = field(default_factory=list)


# Answers requests in their order.
RunClosedLoops = Callable[[Sequence[DriveRequest]], list[ClosedLoopDrive | DriveError]]


def pursue(
    jobs: Sequence[tuple[Scenario, SearchJob]],
    config: AttackConfig,
    every: int,
    drives: RunClosedLoops,
    iterations: int,
    extra_cost: ExtraCost | None = None,
) -> list[SearchEnd]:
    """Run all `jobs` side by side, each with at most `iterations` updates and a closed loop every `every` of them."""
    searches = [searching(job, config, every, iterations, extra_cost) for _, job in jobs]
    seconds: list[list[float]] = [[] for _ in jobs]
    ended: dict[int, SearchEnd] = {}
    waiting = {index: next(search) for index, search in enumerate(searches)}
    while waiting:
        answers = drives([DriveRequest(*jobs[index], traffic) for index, traffic in waiting.items()])
        after: dict[int, BackgroundTraffic] = {}
        for index, answer in zip(waiting, answers, strict=True):
            if isinstance(answer, DriveError):
                ended[index] = SearchEnd(answer)
                continue
            seconds[index] += answer.seconds
            try:
                after[index] = searches[index].send(answer.ego)
            except StopIteration as end:
                found, seen = end.value
                ended[index] = SearchEnd(found, tried=seen)
        waiting = after
    return [replace(ended[index], seconds=seconds[index]) for index in range(len(jobs))]


def in_compiled_loop(planner: JaxPlanner, name: str) -> RunClosedLoops:
    """Closed loops of a planner in JAX, which remembers the last drive of a search, or the first in its scene."""
    kept: dict[tuple[int, ...], tuple[DriveRequest, Any]] = {}  # keeping the requests keeps their ids from being reused

    def drive_once(request: DriveRequest) -> ClosedLoopDrive | DriveError:
        scenario, job, memory = request.scenario, request.job, request.job.memory
        of_scene, of_search = (id(scenario),), (id(scenario), id(job.searched))
        try:
            with foreign(name, scenario.id):
                if last := kept.get(of_search) or kept.get(of_scene):
                    memory = ask(planner.recall, memory, last[1])
                ego, after = jax.block_until_ready(_drive(planner, memory, job.world.without_road(), request.traffic))
            require_finite(ego.controls, name, scenario.id)
        except DriveError as failure:
            return failure
        kept[of_search] = request, after
        kept.setdefault(of_scene, kept[of_search])
        return ClosedLoopDrive(ego)

    return lambda requests: [drive_once(request) for request in requests]


def in_process(process: HostProcess) -> RunClosedLoops:
    """Closed loops of the planner that `process` hosts."""

    def drive_all(requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        by_length: dict[int, list[int]] = {}
        for index, request in enumerate(requests):
            by_length.setdefault(request.scenario.tracks.steps, []).append(index)
        found: dict[int, ClosedLoopDrive | DriveError] = {}
        for group in by_length.values():
            found.update(zip(group, _side_by_side(process, [requests[index] for index in group]), strict=True))
        return [found[index] for index in range(len(requests))]

    return drive_all


def on_pool(hosts: HostPool, drivers: Executor, together: bool) -> RunClosedLoops:
    """Closed loops of the planner that `hosts` lends: `together` in one process, or one by one by the `drivers`."""

    @in_float32
    def drive_some(requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        with hosts.lend() as host:
            return in_process(host)(requests)

    def drive_all(requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        parts = [requests] if together else [[request] for request in requests]
        return [answer for answers in drivers.map(drive_some, parts) for answer in answers]

    return drive_all


def _side_by_side(process: HostProcess, requests: list[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
    if len(requests) > 1 and not process.batches():
        return [_side_by_side(process, [request])[0] for request in requests]
    loops = [ClosedLoop(r.scenario, r.job.world, r.traffic.background, r.traffic.reacting) for r in requests]
    try:
        seconds = drive_on_host(process, loops)
    except DriveError as failure:
        if len(requests) == 1:
            return [failure]
        # One of the batch made it fail; alone, each scene gets its own answer.
        return [_side_by_side(process, [request])[0] for request in requests]
    share = len(seconds) // len(loops)
    return [ClosedLoopDrive(loop.track, seconds[:share]) for loop in loops]


@compiled
def _drive(planner: JaxPlanner, memory: Any, world: World, traffic: BackgroundTraffic) -> tuple[EgoTrack, Any]:
    if traffic.reacting is None:
        motion, controls, last = drive(planner, memory, world, traffic.background)
    else:
        all_motion, controls, last = drive_among_reacting(planner, memory, world, traffic.background, traffic.reacting)
        motion = jax.tree.map(lambda values: values[0], all_motion)
    return EgoTrack(motion, controls), ask(planner.keep, last)
