"""The planner at one moment: its drive without an attack, and searches against it."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cached_property
from typing import Any

import jax
import numpy as np

from regents_cosim.attacks.attacked_cases import failure_of
from regents_cosim.attacks.candidates import without_candidate
from regents_cosim.attacks.descent.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.descent.pursuit import in_process
from regents_cosim.attacks.descent.search import LOOKED_AT, in_one_look
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.engines import by_closed_loops, by_program
from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.attacks.methods.moves import Descend, LookAt, MakeMoves, Move, guarded, search_in_turns
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.live.predict.moments import Moment
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.world import World, to_tracks
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.jax_planner import JaxPlanner, foreign
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.verdicts.ordinary import DrivingLimits


class PlannerInLoop:
    """A context manager that holds a planner at one moment; one outside JAX is borrowed meanwhile."""

    def __init__(
        self, moment: Moment, config: AttackConfig, name: str, loop: JaxPlanner | None, hosts: HostPool
    ) -> None:
        self.moment, self._config = moment, config
        self._name, self._loop, self._hosts = name, loop, hosts
        self.memory: Any = None
        self._lent = ExitStack()

    def __enter__(self) -> "PlannerInLoop":
        if self._loop is not None:
            self.memory = self.moment.memory(self._loop, self._name)
        else:
            self._drives = PlannerDrives(in_process(self._lent.enter_context(self._hosts.lend())), 0)
        return self

    def __exit__(self, *error: object) -> None:
        self._lent.close()

    @cached_property
    def limits(self) -> dict[str, DrivingLimits]:
        """The limits of the adversary's driving for each kind of vehicle."""
        return limits_by_kind(self.moment.scenario, self._config)

    @cached_property
    def world(self) -> World:
        """The world of the moment, with the bounds of the adversary's driving."""
        return with_bounds(self.moment.with_lanes, self.moment.scenario, self._config, self.limits)

    def unattacked(self) -> Tracks:
        """The ego's track [1, time] without an attack. Raises DriveError."""
        scenario = self.moment.scenario
        ended = self.search(without_candidate(self._config, scenario, self.world, self.memory), 0, self._config)
        if failure := failure_of(self._name, scenario.id, ended):
            raise failure
        assert isinstance(ended.found, SearchResult)
        of_all = to_tracks(ended.found.motion, ended.found.controls, scenario)
        return Tracks(*(values[:1] for values in (of_all.x, of_all.y, of_all.yaw, of_all.speed, of_all.valid)))

    def search(self, job: SearchJob, iterations: int, config: AttackConfig) -> SearchEnd:
        """Run a search of at most `iterations` iterations. Raises DriveError."""
        return self._made(job, Descend(job.start, iterations), config)

    @property
    def samples(self) -> bool:
        """Whether searches may sample: if the configuration says so, and the planner runs in the compiled loop."""
        return self._loop is not None and self._config.tries.samples > 0

    @in_float32
    def sampled(self, job: SearchJob, most: int) -> SearchEnd:
        """The best of sampled changes of a job's actions, in at most `most` roll-outs; only if `samples`."""
        method, scenario = self._config.but(iterations=most), self.moment.scenario
        candidate = Candidate(scenario, lambda: job)
        with guarded(method):
            search = method.longer(candidate, job.start, True)
        with foreign(self._name, scenario.id):
            (ended,) = search_in_turns(method, [candidate], [search], self._makes_moves(method))
        assert ended is not None
        return ended

    def wanted(self, job: SearchJob, begun: Sequence[ControlArrays], config: AttackConfig) -> Iterator[int]:
        """The indices of those actions in `begun` that crash the ego as wanted. Raises DriveError."""
        rank, at_once = 0, LOOKED_AT if self._loop is not None else 1
        while rank < len(begun):
            some = begun[rank : rank + at_once]
            looks = self._made(job, LookAt(in_one_look(some), len(some)), config).tried
            assert looks is not None
            accepted = np.flatnonzero(looks.accepted)
            rank += int(accepted[0]) if len(accepted) else len(some)
            if len(accepted):
                yield rank
                rank += 1

    def _made(self, job: SearchJob, move: Move, config: AttackConfig) -> SearchEnd:
        """How a move of a search ended. Raises DriveError."""
        scenario = self.moment.scenario
        with foreign(self._name, scenario.id):
            (ended,) = self._makes_moves(config)([(scenario, job, move)])
            jax.block_until_ready((ended.found, ended.tried))
        if isinstance(ended.found, DriveError):
            raise ended.found
        return ended

    def _makes_moves(self, config: AttackConfig) -> MakeMoves:
        """Makes the moves of searches; a planner outside JAX drives before and after a descent."""
        if self._loop is not None:
            return by_program(AttackSetup(config, self._loop, self._name, None))
        seldom = config.but(replan_every=max(config.steps.iterations, 1))
        return by_closed_loops(AttackSetup(seldom, None, self._name, None), self._drives)
