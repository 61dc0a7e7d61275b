"""A descent to be made, and how it ended."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.world import World


class SearchJob(NamedTuple):
    """The inputs of one descent."""

    world: World
    memory: Any  # the planner's memory of the scene
    searched: SearchedAgents
    start: ControlArrays | None = None  # [searched step] actions to begin with; None: the logged ones


@dataclass(frozen=True, eq=False)
class SearchEnd:
    """How a descent ended, and its effort."""

    found: SearchResult | DriveError
    seconds: list[float] = field(default_factory=list)  # of each decision of a planner outside the mirror
    earlier: int = 0  # updates of earlier attempts
    looks: int = 1  # roll-outs without an update

    @property
    def accepted(self) -> bool:
        """Whether it found what it was looking for."""
        return isinstance(self.found, SearchResult) and bool(self.found.accepted)
