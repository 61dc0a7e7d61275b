"""One search, compiled as a whole."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Array, Int

from regents_cosim.attacks.descent.search_state import SearchResult, StartLooks
from regents_cosim.attacks.descent.step import Descent, ExtraCost
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.on_device import on_device, whole_number
from regents_cosim.mirror.rollout import LoopPlanner

LOOKED_AT = 10  # drives at once: a generation of CMA-ES (`sampled_search`)


@compiled
def look_and_descend(
    job: SearchJob,
    planner: LoopPlanner,
    config: AttackConfig,
    starts: ControlArrays | None,
    count: Int[Array, ""],
    iterations: Int[Array, ""],
    extra_cost: ExtraCost | None = None,
) -> tuple[SearchResult, StartLooks]:
    """Look at the first `count` of some starts, up to an accepted one, and search from the last of them.

    `starts` are actions [start searched step] in place of the start of the `job`; None: the logged ones. The search
    ends at a collision, or after `iterations` updates. `config` comes from `AttackConfig.compiled`, so that one program
    serves any number of iterations.
    """
    descent = Descent.of(job, planner, config, extra_cost)
    given = jax.tree.map(lambda actions: actions[None], descent.logged()) if starts is None else starts
    search, looks = descent.look_and_advance(given, count, iterations)
    return descent.result(search), looks


def descend(
    job: SearchJob, planner: LoopPlanner, config: AttackConfig, iterations: int, extra_cost: ExtraCost | None = None
) -> SearchResult:
    """A search from the start of its job, with at most `iterations` updates.

    Where `config` has starts, the program for several starts is used.
    """
    starts = None if job.start is None else in_one_look([job.start], LOOKED_AT if config.tries.starts else 1)
    one, most = whole_number(1), whole_number(iterations)
    return look_and_descend(job._replace(start=None), planner, config.compiled(), starts, one, most, extra_cost)[0]


def look_at(
    job: SearchJob,
    planner: LoopPlanner,
    drives: ControlArrays,
    count: int,
    config: AttackConfig,
    extra_cost: ExtraCost | None = None,
) -> tuple[SearchResult, StartLooks]:
    """Look at the first `count` of drives [LOOKED_AT searched step], up to an accepted one; and the last one's end."""
    number, none = whole_number(count), whole_number(0)
    return look_and_descend(job._replace(start=None), planner, config.compiled(), drives, number, none, extra_cost)


def in_one_look(starts: Sequence[ControlArrays], room: int = LOOKED_AT) -> ControlArrays:
    """At most `room` starts as drives of one look [room searched step]; the last one is repeated."""
    given = [*starts, *[starts[-1]] * (room - len(starts))]
    return jax.tree.map(lambda *values: on_device(np.stack(values), np.float32), *given)
