"""One adversary against several planners at once, a question that the ReGentS paper leaves open.

Every planner drives among the same adversary in its own closed loop. The search lowers the mean of their costs, or the
cost of the planner that is furthest from a crash; it ends once all of them crash, each in an accepted way.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.costs import Costs
from regents_cosim.attacks.descent import Descent
from regents_cosim.attacks.search_state import Rollout, SearchResult, SearchState
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, start


class AttackedPlanners(JaxPlanner):
    """Planners that one adversary has to make crash; the first one drives the ego of the resulting case.

    It takes a planner's place like `rollout.FixedEgo`, and is never asked for a step.
    """

    planners: tuple[JaxPlanner, ...]
    names: tuple[str, ...] = eqx.field(static=True)

    def init(self, scene: CompiledScene) -> tuple[Any, ...]:
        """The memory of each planner. Raises DriveError for a planner that cannot take a step."""
        named = zip(self.names, self.planners, strict=True)
        return tuple(start(planner, scene, name) for name, planner in named)


class RolloutsWithEach(Rollout):
    """The roll-out with the first planner, and those with each planner."""

    each: tuple[Rollout, ...]


class UniversalDescent(Descent):
    """The descent with one closed loop for each of several planners."""

    def alone(self) -> tuple[Descent, ...]:
        """The descents against each planner alone."""
        assert isinstance(self.planner, AttackedPlanners)
        return tuple(
            Descent(
                self.world, planner, memory, self.searched, self.undisturbed, self.start, self.config, self.extra_cost
            )
            for planner, memory in zip(self.planner.planners, self.memory, strict=True)
        )

    def look(self, actions: ControlArrays, before: Rollout) -> Rollout:
        """Roll out with each planner."""
        return _by_all(tuple(one.look(actions, shown) for one, shown in zip(self.alone(), _each(before), strict=True)))

    def unseen(self) -> Rollout:
        """The log once per planner, as a stand-in for the first roll-outs."""
        return _by_all(tuple(one.unseen() for one in self.alone()))

    def gradient(self, actions: ControlArrays, seen: Rollout) -> tuple[Float[Array, ""], Costs, ControlArrays]:
        """The cost, terms and gradient: the mean of all planners, or those of the planner furthest from a crash."""
        found = [one.gradient(actions, own) for one, own in zip(self.alone(), _each(seen), strict=True)]
        totals, costs, gradients = (jax.tree.map(lambda *v: jnp.stack(v), *part) for part in zip(*found, strict=True))
        if self.config.universal == "worst":
            weights = jax.nn.one_hot(jnp.argmax(costs.ego), len(found), dtype=costs.ego.dtype)
        else:
            weights = jnp.full(len(found), 1.0 / len(found), costs.ego.dtype)
        return jax.tree.map(lambda values: jnp.tensordot(weights, values, 1), (totals, costs, gradients))

    def may_steer(self, seen: Rollout) -> Bool[Array, " searched"]:
        """Searched agents that rule 1 lets steer in front of at least one of the egos."""
        return self._of_each("may_steer", _each(seen)).any(axis=0)

    def hit(self, seen: Rollout) -> Bool[Array, ""]:
        """Whether one of the planners collides."""
        return self._of_each("hit", _each(seen)).any()

    def accepts(self, search: SearchState) -> Bool[Array, ""]:
        """Whether all planners crash as wanted, or one of them collides in the log already."""
        each = _each(search.seen)
        at_log = (search.iterations == 0) & ~self.departs(search.actions).any()
        searches = [replace(search, seen=own) for own in each]
        return self._of_each("accepts", searches).all() | (at_log & self.hit(search.seen))

    def result(self, end: SearchState) -> SearchResult:
        """The end of the loop, with the ego of the first planner, or of the first that collides in the log."""
        each = _each(end.seen)
        log_only = end.iterations == 0
        shown = jnp.where(log_only, jnp.argmax(self._of_each("hit", each)), 0)
        # Planners of several kinds keep values of several shapes.
        alike = [replace(one, kept=None) for one in each]
        return super().result(replace(end, seen=jax.tree.map(lambda *values: jnp.stack(values)[shown], *alike)))

    def _of_each(self, question: str, about: Any) -> Bool[Array, "planner *rest"]:
        asked = zip(self.alone(), about, strict=True)
        return jnp.stack([getattr(one, question)(own) for one, own in asked])


def _by_all(each: tuple[Rollout, ...]) -> RolloutsWithEach:
    return RolloutsWithEach(each[0].motion, each[0].boxes, each[0].ego_controls, None, each)


def _each(seen: Rollout) -> tuple[Rollout, ...]:
    assert isinstance(seen, RolloutsWithEach)
    return seen.each
