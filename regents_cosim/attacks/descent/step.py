"""The descent: look for a collision, differentiate, mask, update by Adam, roll out, and repeat.

It is one compiled loop per scenario. It stops at the first accepted collision of the ego, or when the iterations are
spent. Source: ReGentS section 3.2 (and KING section 3).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.accept.acceptance import ego_contacts, is_wanted
from regents_cosim.attacks.accept.rules import diverging_in_front
from regents_cosim.attacks.descent.actions import allowed, to_actions, to_controls
from regents_cosim.attacks.descent.costs import Costs, total_cost, unlikeliness
from regents_cosim.attacks.descent.search_state import (
    Rollout,
    SearchResult,
    SearchState,
    StartLooks,
    decreases_enough,
    updates_to_wait,
)
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.lookup import rows_of
from regents_cosim.mirror.rollout import (
    LoopPlanner,
    as_scripted,
    ask,
    drive,
    drive_among_reacting,
    roll_out_background,
    with_ego,
)
from regents_cosim.mirror.separation import Box, pose_gradient
from regents_cosim.mirror.world import World

# A further cost that a user wants to lower: smooth, in the units of the cost.
ExtraCost = Callable[[World, Motion, ControlArrays], Float[Array, ""]]

_UNCHANGED = 1e-6  # [1] smaller differences from logged actions are rounding


class Descent(eqx.Module):
    """The constants of all passes of the loop, and the operations of one pass."""

    job: SearchJob
    planner: LoopPlanner
    undisturbed: Motion | None  # [agent time] motion of all agents under logged controls; None: all are searched
    config: AttackConfig = eqx.field(static=True)
    extra_cost: ExtraCost | None = eqx.field(static=True)

    @classmethod
    def of(cls, job: SearchJob, planner: LoopPlanner, config: AttackConfig, extra_cost: ExtraCost | None) -> "Descent":
        """Set up the descent of a job."""
        undisturbed = None if job.searched.are_all else roll_out_background(job.world, job.world.controls)
        return cls(job, planner, undisturbed, config, extra_cost)

    @property
    def world(self) -> World:
        """The scene of the job."""
        return self.job.world

    @property
    def searched(self) -> SearchedAgents:
        """The agents whose controls it may change."""
        return self.job.searched

    def begin(self) -> SearchState:
        """The state at the begin, before anything has been rolled out."""
        actions = self.logged() if self.job.start is None else self.job.start
        return SearchState(
            actions=actions,
            adam=self.optimiser().init(actions),
            seen=self.unseen(),
            looked=jnp.asarray(False),
            hit=jnp.asarray(False),
            accepted=jnp.asarray(False),
            finite=jnp.asarray(True),
            iterations=jnp.int32(0),
            history=jnp.zeros((self.config.steps.iterations, 3), jnp.float32),
            least=jnp.float32(jnp.inf),
            least_at=jnp.int32(0),
        )

    def look_and_advance(
        self, starts: ControlArrays, count: Int[Array, ""], passes: Int[Array, ""]
    ) -> tuple[SearchState, StartLooks]:
        """Look at the first `count` starts, up to an accepted one; then make up to `passes` updates of the last.

        `starts` are actions [start searched step]. They are rolled out side by side, which takes little longer than
        one, unless the planner keeps something of a drive for the next. Looks and updates alternate in one loop, so
        that they share the code of the judgement.
        """
        room, together = starts.accel.shape[0], count > 1
        several = room > 1 and not jax.tree.leaves(self.unseen().kept)
        all_seen = None
        if several:
            stand_in = jax.tree.map(lambda values: jnp.broadcast_to(values, (room, *values.shape)), self.unseen())
            all_seen = jax.lax.cond(together, lambda: self.look_at_all(starts), lambda: stand_in)

        def goes_on(now: tuple[SearchState, StartLooks, Array]) -> Array:
            search, _, looked = now
            updates = self.goes_on(search) & (search.iterations < passes)
            return jnp.where(looked < count, ~search.accepted, updates)

        def turn(now: tuple[SearchState, StartLooks, Array]) -> tuple[SearchState, StartLooks, Array]:
            search, looks, looked = now
            looking = looked < count
            search = jax.lax.cond(
                looking, lambda: replace(search, actions=rows_of(starts, looked)), lambda: self.update(search)
            )

            def look() -> Rollout:
                return self.look(search.actions, search.seen)

            if all_seen is None:
                seen = look()
            else:
                seen = jax.lax.cond(looking & together, lambda: rows_of(all_seen, looked), look)
            search = self.judged(search, seen)
            looks = jax.lax.cond(looking, lambda: self.noted(looks, looked, search), lambda: looks)
            return search, looks, looked + looking

        search, looks, _ = jax.lax.while_loop(goes_on, turn, (self.begin(), no_looks(room), jnp.int32(0)))
        return search, looks

    def look_at_all(self, starts: ControlArrays) -> Rollout:
        """Roll out all starts [start searched step], each as if the planner had not driven before."""
        return jax.vmap(lambda actions: self.look(actions, self.unseen()))(starts)

    def noted(self, looks: StartLooks, index: Int[Array, ""], search: SearchState) -> StartLooks:
        """The looks, with what the search has just seen as entry `index`."""
        total, costs = self.cost(search.seen.boxes, search.seen.motion, search.actions)
        return StartLooks(
            looks.cost.at[index].set(jnp.where(jnp.isfinite(total), total, jnp.inf)),
            looks.terms.at[index].set(jnp.stack([costs.ego, costs.pair, costs.road])),
            looks.accepted.at[index].set(search.accepted),
        )

    def advance(self, search: SearchState, passes: int | Int[Array, ""]) -> SearchState:
        """Make a first look if there was none, and at most `passes` further updates."""
        last = search.iterations + passes
        # Lambdas, because JAX hashes the functions of a loop, and a bound method hashes its object.
        return jax.lax.while_loop(
            lambda now: ~now.looked | self.goes_on(now) & (now.iterations < last),
            lambda now: self.seeing(self.update(now)),
            search,
        )

    def seeing(self, search: SearchState) -> SearchState:
        """The search after a look at what its actions do."""
        return self.judged(search, self.look(search.actions, search.seen))

    def judged(self, search: SearchState, seen: Rollout) -> SearchState:
        """The search with what its actions do, and the judgement of it."""
        search = replace(search, seen=seen, looked=jnp.asarray(True))
        contacts = ego_contacts(self.world, seen.boxes)
        return replace(search, hit=contacts.any(), accepted=self.accepts(search, contacts))

    def goes_on(self, search: SearchState) -> Bool[Array, ""]:
        """Whether a search goes on: not accepted, still finite, with iterations and patience left."""
        return (
            ~search.accepted
            & search.finite
            & (search.iterations < self.config.steps.iterations)
            & self.has_patience(search)
            & self.searched.candidate.any()
        )

    def has_patience(self, search: SearchState) -> Bool[Array, ""]:
        """Whether the ego's distance has decreased lately, or need not."""
        if not self.config.steps.patience:
            return jnp.asarray(True)
        return search.iterations - search.least_at <= updates_to_wait(self.config, search.least)

    def update(self, search: SearchState) -> SearchState:
        """One step of Adam; a search that has not looked yet stays as it is."""
        total, costs, gradient = self.gradient(search.actions, search.seen)
        steps, state = self.optimiser().update(gradient, search.adam)
        accelerates = self.searched.rows(self.searched.candidate)
        steers = accelerates & self.may_steer(search.seen)
        moved = ControlArrays(
            search.actions.accel + jnp.where(accelerates[:, None], steps.accel, 0.0),
            search.actions.curvature + jnp.where(steers[:, None], steps.curvature, 0.0),
        )
        actions = allowed(moved, self.logged(), self.world, self.searched, self.config)
        terms = jnp.stack([costs.ego, costs.pair, costs.road])
        nearer = decreases_enough(
            self.config, costs.ego, search.least, self.config.steps.iterations - search.iterations
        )
        updated = replace(
            search,
            actions=actions,
            adam=state,
            finite=jnp.isfinite(total),
            iterations=search.iterations + 1,
            history=search.history.at[search.iterations].set(terms),
            least=jnp.where(nearer, costs.ego, search.least),
            least_at=jnp.where(nearer, search.iterations, search.least_at),
        )
        return jax.tree.map(lambda new, old: jnp.where(search.looked, new, old), updated, search)

    @eqx.filter_jit  # traced once, although a program looks at starts side by side and at updates one by one
    def look(self, actions: ControlArrays, before: Rollout) -> Rollout:
        """Roll out the actions; `before` holds what the planner kept of the previous roll-out."""
        motion, ego_controls, last = self.drive(actions, ask(self.planner.recall, self.job.memory, before.kept))
        return Rollout(motion, self.world.boxes(motion), ego_controls, ask(self.planner.keep, last))

    def unseen(self) -> Rollout:
        """A stand-in for the first roll-out: the log, with the shapes of a roll-out."""
        log, of_ego = self.world.log, jax.tree.map(lambda values: values[0], self.world.controls)
        return Rollout(log, self.world.boxes(log), of_ego, ask(self.planner.keep, self.job.memory))

    def drive(self, actions: ControlArrays, memory: Any) -> tuple[Motion, ControlArrays, Any]:
        """Every agent's motion [agent time] and the ego's controls [step] under the searched agents' actions.

        `memory` is the planner's initial memory; the third value is its memory at the end.
        """
        world, searched = self.world, self.searched
        own = self.own_motion(actions)
        background = self.among_all(own)
        if self.config.traffic.background == "log":
            ego, controls, last = drive(self.planner, memory, world, background)
            return with_ego(background, ego), controls, last
        motion, controls, last = drive_among_reacting(self.planner, memory, world, background, self.reacting())
        return searched.put(motion, own), controls, last

    def own_motion(self, actions: ControlArrays) -> Motion:
        """The motion of the searched agents [searched time]."""
        world, rows = self.world, self.searched.rows
        start, moving = rows(world.start), rows(world.moving)
        own = rows(world.mobility).roll_out(start, to_controls(actions), moving, world.dt)
        return as_scripted(world, own) if self.searched.are_all else own

    def among_all(self, own: Motion) -> Motion:
        """Every agent's motion [agent time] before any reactions, with `own` [searched time] for the searched ones."""
        return own if self.undisturbed is None else self.searched.put(self.undisturbed, own)

    def gradient(self, actions: ControlArrays, seen: Rollout) -> tuple[Float[Array, ""], Costs, ControlArrays]:
        """The cost, its terms, and its gradient with respect to the actions [searched step].

        The motion is differentiated without another roll-out, and without the planner.
        """
        if self.config.steps.gradient == "through-planner":
            (total, costs), gradient = jax.value_and_grad(self.cost_through_planner, has_aux=True)(actions)
            return total, costs, gradient
        (total, costs), (on_boxes, on_motion, on_actions) = jax.value_and_grad(self.cost, (0, 1, 2), has_aux=True)(
            seen.boxes, seen.motion, actions
        )
        on_motion = jax.tree.map(jnp.add, on_motion, pose_gradient(seen.boxes, on_boxes))
        rows, world = self.searched.rows, self.world
        heading = rows(seen.boxes.cos), rows(seen.boxes.sin)
        on_controls = rows(world.mobility).pull_back(
            rows(world.start), to_controls(actions), rows(world.moving), world.dt,
            rows(seen.motion), heading, rows(on_motion),
        )  # fmt: skip
        return total, costs, jax.tree.map(jnp.add, on_actions, to_controls(on_controls))

    def cost(self, boxes: Box, motion: Motion, actions: ControlArrays) -> tuple[Float[Array, ""], Costs]:
        """The cost of a roll-out, and its terms."""
        costs = total_cost(self.world, boxes, self.searched, self.config)
        total = costs.total
        if self.config.cost.usual_weight:
            total += self.config.cost.usual_weight * unlikeliness(self.world, motion, self.searched)
        if self.extra_cost is None:
            return total, costs
        controls = self.searched.put(self.world.controls, to_controls(actions))
        return total + self.extra_cost(self.world, motion, controls), costs

    def cost_through_planner(self, actions: ControlArrays) -> tuple[Float[Array, ""], Costs]:
        """The cost as a function of the actions alone."""
        motion, *_ = self.drive(actions, self.job.memory)
        return self.cost(self.world.boxes(motion), motion, actions)

    def accepts(self, search: SearchState, contacts: Bool[Array, "agent time"]) -> Bool[Array, ""]:
        """Whether the search has found its collision, or need not search, as the ego collides in the log already.

        `contacts` are the ego's in what the search has just seen.
        """
        hit = contacts.any()
        if self.config.acceptance.accept == "any":
            return hit
        seen, world, searched = search.seen, self.world, self.searched
        attacks = self.departs(search.actions).any() | searched.continues
        unattacked = hit & ~attacks & (search.iterations == 0)
        if self.config.traffic.background == "reactive" and not searched.are_all:
            # A candidate that drives as logged does not react, as it would without an attack, and others react to that.
            unattacked &= ~searched.candidate.any()
        wanted = jax.lax.cond(
            hit,
            lambda: is_wanted(world, searched, seen.motion, seen.boxes, contacts, self.config),
            lambda: jnp.asarray(False),
        )
        return wanted & attacks | unattacked

    def departs(self, actions: ControlArrays) -> Bool[Array, " searched"]:
        """Which searched agents' actions differ from the logged ones."""
        deviation = jax.tree.map(lambda new, old: jnp.abs(new - old).max(axis=1), actions, self.logged())
        return jnp.maximum(deviation.accel, deviation.curvature) > _UNCHANGED

    def may_steer(self, seen: Rollout) -> Bool[Array, " searched"]:
        """Searched agents whose steering is updated (rule 1)."""
        motion, valid = seen.motion, self.searched.rows(self.world.valid)
        if not self.config.rules.cancel_front_steering:
            return jnp.ones(valid.shape[0], bool)
        ego = jax.tree.map(lambda values: values[0], motion)
        around = self.searched.rows(motion)
        steers = ~diverging_in_front(ego, around, valid)
        # Rule 1 is about wheels: a pedestrian, who turns on the spot, can come back from any direction.
        walks = self.searched.rows(self.world.walks)
        return steers if walks is None else steers | walks

    def result(self, end: SearchState) -> SearchResult:
        """The end of the loop, for all agents."""
        motion, searched = end.seen.motion, self.searched
        controls = searched.put(self.world.controls, to_controls(end.actions))
        if self.config.traffic.background == "reactive":
            reacted, reacting = self.world.mobility.controls_between(motion, self.world.dt), self.reacting()[:, None]
            controls = jax.tree.map(lambda own, seen: jnp.where(reacting, seen, own), controls, reacted)
        return SearchResult(
            motion=motion,
            controls=jax.tree.map(lambda all_, own: all_.at[0].set(own), controls, end.seen.ego_controls),
            changed=searched.put(jnp.zeros_like(searched.candidate), self.departs(end.actions)),
            hit=end.hit,
            accepted=end.accepted,
            finite=end.finite & jnp.isfinite(motion.x).all() & jnp.isfinite(motion.y).all(),
            any_candidate=searched.candidate.any(),
            iterations=end.iterations,
            history=end.history,
        )

    def logged(self) -> ControlArrays:
        """The actions [searched step] that reproduce the log."""
        return self.searched.rows(to_actions(self.world.controls))

    def optimiser(self) -> Any:
        """Adam as configured; optax types its trees too narrowly for modules."""
        return optax.adam(self.config.steps.learning_rate)

    def reacting(self) -> Bool[Array, " agent"]:
        """Agents that react to others."""
        return self.world.vehicle & ~self.searched.candidate


def no_looks(room: int) -> StartLooks:
    """The results of looks before the first, with room for so many."""
    return StartLooks(jnp.full(room, jnp.inf), jnp.zeros((room, 3), jnp.float32), jnp.zeros(room, bool))
