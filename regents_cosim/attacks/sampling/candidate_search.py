"""The search for different crashes of one candidate, by the speed and the time at which it comes to the ego.

A search begins with lawful drives that meet the ego, and with the log. A change of these actions has ten numbers,
as in `attacks.sampling.sampled_search`. A grid keeps the best change of each bin of the two measures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.attacked_cases import attacked_case
from regents_cosim.attacks.descent.actions import to_actions
from regents_cosim.attacks.descent.search_state import SearchResult, SearchState
from regents_cosim.attacks.descent.step import Descent
from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.sampling.emitters import BATCH, Elite, EliteGrid, Gain, Proposal
from regents_cosim.attacks.sampling.sampled_search import KNOTS, pace, with_change
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.scenario import Scenario

SIZE = 2 * KNOTS  # numbers of a change
_BINS = (2.5, 1.0)  # of the measures: m/s, s


@dataclass(frozen=True, eq=False)
class CandidateSearch:
    """The search for one candidate, with its results so far."""

    candidate: Candidate
    setup: AttackSetup
    grid: EliteGrid = field(default_factory=EliteGrid)

    @cached_property
    def starts(self) -> ControlArrays:
        """The actions that may be changed [start searched step], those of the log last."""
        job = self.candidate.job
        log = job.searched.rows(to_actions(job.world.controls))
        return jax.tree.map(lambda *each: np.stack(each), *self.candidate.starts, log)

    def __len__(self) -> int:
        return len(self.starts.accel)

    @property
    def _given(self) -> tuple[SearchJob, JaxPlanner, AttackConfig]:
        planner = self.setup.planner
        assert isinstance(planner, JaxPlanner)
        return self.candidate.job, planner, self.setup.config.compiled()

    def _of(self, proposal: Proposal) -> tuple[SearchJob, JaxPlanner, AttackConfig]:
        job, planner, config = self._given
        return job._replace(start=self._starting([proposal.start], 0)), planner, config

    def _starting(self, chosen: Sequence[int], at: slice | int = slice(None)) -> ControlArrays:
        return jax.tree.map(lambda values: jnp.asarray(values[np.asarray(chosen)][at], jnp.float32), self.starts)

    def look(self) -> None:
        """Try every start unchanged."""
        unchanged = [Proposal(start, np.zeros(SIZE)) for start in range(len(self))]
        for at in range(0, len(unchanged), BATCH):
            self.try_all(unchanged[at : at + BATCH])

    def try_all(self, proposals: Sequence[Proposal]) -> list[Gain]:
        """Try up to a batch of proposals; returns what each adds to the grid."""
        padded = [*proposals, *[proposals[-1]] * (BATCH - len(proposals))]
        starts = self._starting([one.start for one in padded])
        changes = np.stack([one.change for one in padded])
        rows, accepted = map(np.asarray, try_changes(*self._given, starts, _device(changes)))
        return [self._add(*one) for one in zip(proposals, rows[: len(proposals)], accepted.tolist(), strict=False)]

    def _add(self, proposal: Proposal, rows: np.ndarray, accepted: bool) -> Gain:
        if not np.isfinite(rows).all():
            return Gain(False, False, -np.inf, False)
        cell = tuple(int(place) for place in rows[1:] // np.array(_BINS))
        return self.grid.add(cell, Elite(accepted, float(rows[0]), proposal))

    def case(self, proposal: Proposal) -> Scenario:
        """The case that a proposal leads to."""
        job, planner, config = self._of(proposal)
        found = end_with(job, planner, config, _device(proposal.change))
        return attacked_case(self.setup, self.candidate.scenario, job, SearchEnd(found))


def _device(changes: Float[np.ndarray, "*axes"]) -> jnp.ndarray:
    return jnp.asarray(changes, jnp.float32)


# Evaluate changes of an agent's actions for searches for diverse crashes: a value and two measures.
# The value is minus the attack's cost. The measures are the speed and the time at which the agent comes nearest to
# the ego, as means over the moments near that one.
_NEAR_M = 2.0  # distance over which the weight of a moment falls to a third
_SMOOTH_M2 = 1e-3  # keeps square roots smooth at 0 (m^2, or m^2/s^2)


@compiled
def try_changes(
    job: SearchJob,
    planner: JaxPlanner,
    config: AttackConfig,
    starts: ControlArrays,
    changes: Float[Array, "change coordinate"],
) -> tuple[Float[Array, "change row"], Bool[Array, " change"]]:
    """The value and the measures of each change of its start [change searched step], and whether it is accepted."""
    same = _descent(job, planner, config)

    def one(given: tuple[ControlArrays, Float[Array, " coordinate"]]) -> tuple[Array, Array]:
        start, change = given
        descent = replace(same, start=start)
        search = _seen(descent, change)
        return _rows(descent, search.seen.motion, search.actions), search.accepted

    return jax.lax.map(one, (starts, changes))


@compiled
def end_with(
    job: SearchJob, planner: JaxPlanner, config: AttackConfig, change: Float[Array, " coordinate"]
) -> SearchResult:
    """A search result as if the search had ended with this change."""
    descent = _descent(job, planner, config)
    return descent.result(replace(_seen(descent, change), iterations=jnp.int32(1)))


def _descent(job: SearchJob, planner: JaxPlanner, config: AttackConfig) -> Descent:
    return Descent.of(job.world, planner, job.memory, job.searched, config, job.start)


def _seen(descent: Descent, change: Float[Array, " coordinate"]) -> SearchState:
    return descent.seeing(replace(descent.begin(), actions=_changed(descent, change)))


def _changed(descent: Descent, change: Float[Array, " coordinate"]) -> ControlArrays:
    return descent.allowed(with_change(descent.first(), change, pace(descent.world, descent.searched)))


def _rows(descent: Descent, motion: Motion, actions: ControlArrays) -> Float[Array, " row"]:
    total, _ = descent.cost(descent.world.boxes(motion), motion, actions)
    ego = jax.tree.map(lambda values: values[0], motion)
    own = jax.tree.map(lambda values: values[0], descent.searched.rows(motion))
    both = descent.world.valid[0] & descent.searched.rows(descent.world.valid)[0]
    return jnp.stack([-total, *nearest_approach(ego, own, both, descent.world.dt)])


def nearest_approach(
    ego: Motion, other: Motion, both: Bool[Array, " time"], dt: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Relative speed [m/s] and time [s] of the nearest approach of two agents, while `both` are present.

    Both are means over time in which a moment weighs exp(-d / 2 m), with d the distance of the centres.
    """
    apart = _length(other.x - ego.x, other.y - ego.y)
    near = jax.nn.softmax(jnp.where(both, -apart / _NEAR_M, -jnp.inf))
    dx = other.speed * jnp.cos(other.yaw) - ego.speed * jnp.cos(ego.yaw)
    dy = other.speed * jnp.sin(other.yaw) - ego.speed * jnp.sin(ego.yaw)
    return jnp.sum(near * _length(dx, dy)), jnp.sum(near * dt * jnp.arange(near.shape[0]))


def _length(x: Float[Array, "*axes"], y: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    return jnp.sqrt(x**2 + y**2 + _SMOOTH_M2)
