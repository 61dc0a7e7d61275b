"""The planner at one moment: its drive without an attack, and searches against it."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cached_property
from typing import Any

import jax
import numpy as np

from regents_cosim.attacks.descent.driving_limits import limits_by_kind
from regents_cosim.attacks.descent.pursuit import DriveRequest, RunClosedLoops, in_compiled_loop, in_process, pursue
from regents_cosim.attacks.descent.replanned import BackgroundTraffic
from regents_cosim.attacks.descent.search import LOOKED_AT, descend, in_one_look, look_at
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.engines import by_program
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.moves import complete
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.sampling.sampled_search import ByEvolution, Sampling
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.live.predict.moments import Moment
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.jax_planner import JaxPlanner, foreign
from regents_cosim.scenario import Tracks
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
            self._drives: RunClosedLoops = in_compiled_loop(self._loop, self._name)
        else:
            self._drives = in_process(self._lent.enter_context(self._hosts.lend()))
        return self

    def __exit__(self, *error: object) -> None:
        self._lent.close()

    @cached_property
    def limits(self) -> dict[str, DrivingLimits]:
        """The limits of the adversary's driving for each kind of vehicle."""
        return limits_by_kind(self.moment.scenario, self._config)

    def unattacked(self) -> Tracks:
        """The ego's track [1, time] without an attack. Raises DriveError."""
        moment, world = self.moment, self.moment.world
        job = SearchJob(world, self.memory, SearchedAgents.only(0, len(world.valid)))
        others = BackgroundTraffic(
            moment.background, world.vehicle if self._config.traffic.background == "reactive" else None
        )
        (driven,) = self._drives([DriveRequest(moment.scenario, job, others)])
        if isinstance(driven, DriveError):
            raise driven
        x, y, yaw, speed = (np.asarray(values, float)[None] for values in jax.tree.leaves(driven.ego.motion))
        return Tracks(
            x + moment.origin[0], y + moment.origin[1], yaw, np.maximum(speed, 0.0), moment.scenario.tracks.valid[:1]
        )

    def search(self, job: SearchJob, iterations: int, config: AttackConfig) -> SearchEnd:
        """Run a search of at most `iterations` iterations. Raises DriveError."""
        loop = self._loop
        if loop is not None:
            with foreign(self._name, self.moment.scenario.id):
                return SearchEnd(jax.block_until_ready(descend(job, loop, config, iterations)))
        (ended,) = pursue([(self.moment.scenario, job)], config, max(iterations, 1), self._drives, iterations)
        if isinstance(ended.found, DriveError):
            raise ended.found
        return ended

    @property
    def samples(self) -> bool:
        """Whether searches may sample: if the configuration says so, and the planner runs in the compiled loop."""
        return self._loop is not None and self._config.tries.samples > 0

    @in_float32
    def sampled(self, job: SearchJob, most: int) -> SearchEnd:
        """The best of sampled changes of a job's actions, in at most `most` roll-outs; only if `samples`."""
        assert self._loop is not None
        scenario, setup = self.moment.scenario, AttackSetup(self._config, self._loop, self._name, None)
        search = Sampling(scenario.id, job, self._config, ByEvolution, most)
        with foreign(self._name, scenario.id):
            return complete(search, scenario, job, by_program(setup))

    def wanted(self, job: SearchJob, begun: Sequence[ControlArrays], config: AttackConfig) -> Iterator[int]:
        """The indices of those actions in `begun` that crash the ego as wanted. Raises DriveError."""
        if self._loop is None:
            yield from (k for k, one in enumerate(begun) if self.search(job._replace(start=one), 0, config).accepted)
            return
        rank = 0
        while rank < len(begun):
            some = begun[rank : rank + LOOKED_AT]
            with foreign(self._name, self.moment.scenario.id):
                _, looks = look_at(job, self._loop, in_one_look(some), len(some), config)
                accepted = np.flatnonzero(looks.accepted)
            rank += int(accepted[0]) if len(accepted) else len(some)
            if len(accepted):
                yield rank
                rank += 1
