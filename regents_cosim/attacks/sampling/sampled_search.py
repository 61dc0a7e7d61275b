"""Searches without a gradient: CMA-ES, with which `focused` begins, and random search.

They compare fairly with the descent: same cost, same candidates, same acceptance, same bounds of the actions, and as
many roll-outs as the descent may make updates. A change of the actions has ten numbers: accelerations and curvatures at
five times, linear in between, added to the actions that a descent would begin with, either the logged ones or those of
a lawful drive. Patience ends a search as it ends a descent.
"""

import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.attacks.descent.actions import allowed, to_actions
from regents_cosim.attacks.descent.search import LOOKED_AT
from regents_cosim.attacks.descent.search_state import SearchResult, decreases_enough, updates_to_wait
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.moves import Descend, LookAt, Move, Search
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import DriveError, RegentsError, require
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import ACCEL_LIMIT

if TYPE_CHECKING:
    from cmaes import CMA

_KNOTS = 5
COORDINATES = 2 * _KNOTS  # numbers of a change
CHANGES = LOOKED_AT  # changes that a sampler proposes at once
_UNIT = (0.4, 0.06)  # shares of the limits for a coordinate of 1: 3.0 m/s^2, 0.018 1/m


class Sampler(Protocol):
    """Proposes the changes to try next; of each the first half are accelerations, the others curvatures."""

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose `CHANGES` changes of `COORDINATES` numbers."""
        ...

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn what these changes cost; not called where the roll-outs end before the last of them."""
        ...


class AtRandom:
    """Changes from a normal distribution that never learns."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose changes."""
        return self._rng.normal(size=(CHANGES, COORDINATES))

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn nothing."""


class ByEvolution:
    """CMA-ES around the first actions."""

    def __init__(self, seed: int) -> None:
        self._cma = cma_es(np.zeros(COORDINATES), 0.5, CHANGES, seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose a generation of changes."""
        return np.stack([self._cma.ask() for _ in range(CHANGES)])

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn the costs of a generation."""
        self._cma.tell([(change, float(cost)) for change, cost in zip(changes, costs, strict=True)])


# CMA-ES (Hansen 2016, "The CMA Evolution Strategy: A Tutorial") comes from the package `cmaes`, imported in a fifth of
# the usual time.
_NOT_NEEDED = "scipy.stats"  # most of the import time; only an unused variant needs it


def cma_es(mean: Float[np.ndarray, " coordinate"], spread: float, population: int, seed: int) -> "CMA":
    """A CMA-ES search around `mean`, with `population` changes per generation."""
    if _NOT_NEEDED in sys.modules:
        from cmaes import CMA
    else:
        sys.modules[_NOT_NEEDED] = None  # pyright: ignore[reportArgumentType]  to Python one that is not installed
        try:
            from cmaes import CMA
        finally:
            del sys.modules[_NOT_NEEDED]
    return CMA(mean=mean, sigma=spread, population_size=population, seed=seed)


class Sampling(Search):
    """Look at a start, then try changes of it until one is accepted or `most` roll-outs are spent."""

    def __init__(
        self, scenario: str, job: SearchJob, config: AttackConfig, sampler: Callable[[int], Sampler], most: int
    ) -> None:
        """`job` begins with the start; `scenario` is its id, from which and the agent the seed comes."""
        self._job, self._config, self._most = job, config, most
        self._sampler = sampler(zlib.crc32(f"{scenario} {int(job.searched.first)}".encode()))
        lacks = [name for name in ("ask", "tell") if not callable(getattr(self._sampler, name, None))]
        require(
            not lacks,
            f"method {config.method}: sampler() returns {type(self._sampler).__name__} without {' and '.join(lacks)}, "
            "expected a Sampler",
            RegentsError,
        )
        # The changed actions do not depend on the road.
        self._bare = job._replace(world=replace(job.world.without_road(), bounds=job.world.bounds), memory=None)
        self._history: np.ndarray | None = None  # [iteration term] once the start was seen
        self._changes = np.zeros((0, COORDINATES))  # those that are looked at
        self._best, self._least, self._tried = np.zeros(COORDINATES), np.inf, 0
        self._nearest, self._nearest_at = np.float32(np.inf), 0  # the ego's cost at its last decrease, and when
        self._closes = False
        self._seconds: list[float] = []
        self._last: SearchEnd | None = None
        self._end: SearchEnd | None = None

    def propose(self) -> Move:
        """Propose a look at the start, at some changes, or at the best of all changes."""
        if self._history is None:
            return Descend(self._job.start)
        self._changes = self._best[None] if self._closes else self._asked()[: self._most - self._tried]
        least = np.inf if self._closes else self._least
        return LookAt(changed_actions(self._bare, self._config, self._changes), len(self._changes), least)

    def advance(self, seen: SearchEnd) -> None:
        """Learn from what was looked at."""
        found = seen.found
        self._seconds += seen.seconds
        if isinstance(found, DriveError):
            self._end = seen
        elif self._history is None:
            self._history = np.zeros(found.history.shape, np.float32)
            if self._most == 0 or seen.is_last or seen.refused:
                self._end = seen
            self._closes = not self._goes_on()
            self._last = seen
        else:
            over = self._closes or self._learn(seen)
            assert self._last is not None
            self._last = SearchEnd(self._last.found if seen.estimated else found, self._seconds)
            self._end = self._last if over else None
            self._closes = not over and not self._goes_on()

    @property
    def finished(self) -> bool:
        """Whether the search is over."""
        return self._end is not None

    def result(self) -> SearchEnd | None:
        """How it ended: with the accepted change, or else the best; before its end the last look."""
        end = self._end or self._last
        if end is None or not self._tried or not isinstance(end.found, SearchResult):
            return end
        tried, history = on_device(self._tried, np.int32), on_device(self._history, np.float32)
        return SearchEnd(replace(end.found, iterations=tried, history=history), end.seconds)

    def _asked(self) -> Float[np.ndarray, "change coordinate"]:
        """What the sampler proposes. Raises RegentsError where it has another form."""
        changes = np.asarray(self._sampler.ask())
        require(
            changes.shape == (CHANGES, COORDINATES) and bool(np.isfinite(changes).all()),
            f"method {self._config.method}: {type(self._sampler).__name__}.ask gives an array {list(changes.shape)}, "
            f"expected finite numbers {[CHANGES, COORDINATES]} (changes, coordinates)",
            RegentsError,
        )
        return changes

    def _learn(self, seen: SearchEnd) -> bool:
        """Learn what the changes cost; returns whether one was accepted on the device."""
        assert seen.tried is not None
        assert self._history is not None
        number, looks = len(self._changes), (seen.tried.cost, seen.tried.terms, seen.tried.accepted)
        costs, terms, accepted = (np.asarray(values)[:number] for values in looks)
        made = seen.tried.made(number)
        self._history[self._tried : self._tried + made] = terms[:made]
        self._tried += made
        if accepted.any():
            return True
        if costs.min() < self._least and not seen.estimated:
            self._best, self._least = self._changes[np.argmin(costs)], float(costs.min())
        if decreases_enough(self._config, terms[:, 0].min(), self._nearest, self._most - self._tried + made):
            self._nearest, self._nearest_at = terms[:, 0].min(), self._tried
        if number == LOOKED_AT:
            self._sampler.tell(self._changes, costs)
        return False

    def _goes_on(self) -> bool:
        waited = self._tried - self._nearest_at
        patient = not self._config.steps.patience or waited <= updates_to_wait(self._config, self._nearest)
        return self._tried < self._most and bool(patient)


def changed_actions(
    job: SearchJob, config: AttackConfig, changes: Float[np.ndarray, "change coordinate"]
) -> ControlArrays:
    """The actions [LOOKED_AT searched step] of changes of a job's start; the last one is repeated."""
    padded = np.pad(changes, ((0, LOOKED_AT - len(changes)), (0, 0)), mode="edge")
    return _changed(job, config.compiled(), on_device(padded, np.float32))


@compiled
def _changed(job: SearchJob, config: AttackConfig, changes: Float[Array, "change coordinate"]) -> ControlArrays:
    """The actions [change searched step] of some changes, within the configuration and the law."""
    logged = job.searched.rows(to_actions(job.world.controls))
    first = logged if job.start is None else job.start
    at_its_pace = _pace(job.world, job.searched)
    return jax.vmap(
        lambda change: allowed(_with_change(first, change, at_its_pace), logged, job.world, job.searched, config)
    )(changes)


def _with_change(
    first: ControlArrays, change: Float[Array, " coordinate"], at_its_pace: Float[Array, "searched 1"] | float
) -> ControlArrays:
    """Actions [searched step] plus a change [COORDINATES], scaled by the agents' pace."""
    units = _UNIT[0] * at_its_pace, _UNIT[1]
    steps = first.accel.shape[1]
    knots, times = jnp.linspace(0.0, steps - 1.0, _KNOTS), jnp.arange(steps)
    accel, curvature = (jnp.interp(times, knots, part) for part in (change[:_KNOTS], change[_KNOTS:]))
    return ControlArrays(first.accel + units[0] * accel, first.curvature + units[1] * curvature)


def _pace(world: World, searched: SearchedAgents) -> Float[Array, "searched 1"] | float:
    """The pace of each searched agent: its greatest acceleration, as a share of a coordinate of 1; for cars 1."""
    if world.walks is None or world.bounds is None:
        return 1.0
    walks, most = searched.rows(world.walks), searched.rows(world.bounds.accel)
    return jnp.where(walks, most / (_UNIT[0] * ACCEL_LIMIT), 1.0)[:, None]
