"""A search whose planner drives only every few iterations, for slow planners and those outside the compiled loop.

In between, the ego stays on the track of the last closed loop. That is one more term of the approximation that the
method makes anyway, whose gradient takes the ego's track as constant; a collision counts only once a fresh closed loop
has confirmed it.
"""

from collections.abc import Generator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from regents_cosim.attacks.descent.search_state import SearchResult, SearchState, StartLooks
from regents_cosim.attacks.descent.step import Descent, ExtraCost, no_looks
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import EgoTrack, FixedEgo


class BackgroundTraffic(eqx.Module):
    """The traffic for a closed loop."""

    background: Motion  # [agent time] every agent's own track
    reacting: Bool[Array, " agent"] | None  # agents that react to others; None: no agent


def searching(
    job: SearchJob, config: AttackConfig, every: int, iterations: int, extra_cost: ExtraCost | None
) -> Generator[BackgroundTraffic, EgoTrack, tuple[SearchResult, StartLooks]]:
    """A search as a generator: yields traffic, receives the ego's track among it, and returns the result, and
    what the last drive costs.

    `every` is the number of iterations between two closed loops, `iterations` the greatest number of all.
    """
    given = (job._replace(memory=None), config.compiled(), extra_cost)
    search, traffic = _begin(given)
    while True:
        ego = yield traffic
        search, goes_on, ended = _look(given, ego, search)
        if iterations == 0 or not goes_on or search.iterations >= iterations:
            return ended
        passes = jnp.minimum(every, iterations - search.iterations)
        search, traffic = _advance(given, ego, search, passes)


_Given = tuple[SearchJob, AttackConfig, ExtraCost | None]


def _descent(given: _Given, ego: EgoTrack | None) -> Descent:
    job, config, extra_cost = given
    return Descent.of(job._replace(memory=ego), FixedEgo(), config, extra_cost)


@compiled
def _begin(given: _Given) -> tuple[SearchState, BackgroundTraffic]:
    descent = _descent(given, None)
    search = descent.begin()
    return search, _traffic(descent, search.actions)


@compiled
def _advance(
    given: _Given, ego: EgoTrack, search: SearchState, passes: Int[Array, ""]
) -> tuple[SearchState, BackgroundTraffic]:
    descent = _descent(given, ego)
    search = descent.advance(search, passes)
    return search, _traffic(descent, search.actions)


@compiled
def _look(
    given: _Given, ego: EgoTrack, search: SearchState
) -> tuple[SearchState, Bool[Array, ""], tuple[SearchResult, StartLooks]]:
    """The search after a look, whether it goes on, and how it ends otherwise."""
    descent = _descent(given, ego)
    search = descent.seeing(search)
    ended = descent.result(search), descent.noted(no_looks(1), jnp.int32(0), search)
    return search, descent.goes_on(search), ended


def _traffic(descent: Descent, actions: ControlArrays) -> BackgroundTraffic:
    reacts = descent.config.traffic.background == "reactive"
    return BackgroundTraffic(descent.among_all(descent.own_motion(actions)), descent.reacting() if reacts else None)
