"""The search for different crashes of one candidate, by the speed and the time at which it comes to the ego.

A search begins with lawful drives that meet the ego, and with the log. A change of these actions has ten numbers,
as in `attacks.sampling.sampled_search`. A grid keeps the best change of each bin of the two measures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.attacked_cases import attacked_case
from regents_cosim.attacks.descent.actions import to_actions
from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.sampling.elite_grid import Elite, EliteGrid, Gain, Proposal
from regents_cosim.attacks.sampling.emitters import BATCH
from regents_cosim.attacks.sampling.measured_changes import end_with, try_changes
from regents_cosim.attacks.sampling.sampled_search import KNOTS
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.mirror.bicycle import ControlArrays
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
