"""A candidate of an attack, the job that a search does for it, and how the search ended."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from regents_cosim.attacks.descent.search_state import SearchResult, StartLooks
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.world import World
from regents_cosim.scenario.scenario import Scenario


class SearchJob(NamedTuple):
    """The inputs of one descent."""

    world: World
    memory: Any  # the planner's memory of the scene
    searched: SearchedAgents
    start: ControlArrays | None = None  # [searched step] actions to begin with; None: the logged ones


@dataclass(frozen=True, eq=False)
class Candidate:
    """A road user that may attack, or all of them together.

    Its job and starts are made when its turn comes; where one adversary is enough, many candidates never have a turn.
    """

    scenario: Scenario
    make_job: Callable[[], SearchJob]
    make_starts: Callable[[SearchJob], Sequence[ControlArrays]] = lambda _: ()
    looks: int = 0  # number of its starts
    kinds: frozenset[str] = frozenset()  # wanted kinds of crash to which its starts lead

    @cached_property
    def job(self) -> SearchJob:
        """The search that begins with the log."""
        return self.make_job()

    @cached_property
    def starts(self) -> Sequence[ControlArrays]:
        """The actions [searched step] of drives on lawful paths that meet the ego, the most promising first."""
        return self.make_starts(self.job)


class Merit(NamedTuple):
    """How good an accepted telling crash is; of two the greater is better, the first difference counts."""

    flawless: bool
    clear: bool  # the careful driver avoids it with room (`CAREFUL.room_m`)
    usual: float  # share of ordinary motions that are no gentler than the adversary's


BEST = Merit(flawless=True, clear=True, usual=1.0)


@dataclass(frozen=True, eq=False)
class SearchEnd:
    """How a search or one of its moves ended, and its effort."""

    found: SearchResult | DriveError
    seconds: list[float] = field(default_factory=list)  # of each decision of a planner outside the mirror
    earlier: int = 0  # updates of earlier searches for the candidate
    looks: int = 1  # roll-outs without an update
    tried: StartLooks | None = None  # of a move that looks at drives: what each costs
    estimated: bool = False  # the planner drove in none of them: `found` is an estimate
    refused: bool = False  # the host refused the crash that the device accepted
    merit: Merit = BEST

    @property
    def accepted(self) -> bool:
        """Whether it found what it was looking for."""
        return isinstance(self.found, SearchResult) and bool(self.found.accepted)

    @property
    def hit(self) -> bool:
        """Whether the ego crashes, in whatever way."""
        return isinstance(self.found, SearchResult) and bool(self.found.hit)

    @property
    def failed(self) -> bool:
        """Whether the planner failed."""
        return isinstance(self.found, DriveError)

    @property
    def is_last(self) -> bool:
        """Whether another search for the candidate is of no use."""
        return isinstance(self.found, DriveError) or self.accepted or not bool(self.found.any_candidate)

    def after(self, old: "SearchEnd | None") -> "SearchEnd":
        """Return this end with the effort of an earlier search for the candidate."""
        if old is None:
            return self
        assert isinstance(old.found, SearchResult)
        earlier = old.earlier + int(old.found.iterations)
        return replace(self, seconds=old.seconds + self.seconds, earlier=earlier, looks=old.looks + self.looks)
