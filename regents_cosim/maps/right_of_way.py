"""Read the right of way in junctions from the network: the `request` rows of SUMO's junctions.

Source: SUMO's network format, https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html (Requests): for each link of a
junction, in the order of its `intLanes`, the bits of `response` say to which links it has to give way, the first link
rightmost.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import lru_cache

from regents_cosim.errors import InputError
from regents_cosim.maps.net_elements import unpacked_network, walk_network
from regents_cosim.maps.roadmap import RoadMap

_FIRST_COME = frozenset({"allway_stop"})  # types in which the first to arrive goes first, and rows do not tell


@dataclass(frozen=True)
class JunctionMovement:
    """One movement through a junction."""

    junction: str
    index: int


@dataclass(frozen=True)
class Priorities:
    """The links of all junctions by lane, and the links that each gives way to."""

    links: dict[str, JunctionMovement]  # by id of the lanes inside junctions that belong to them
    gives_way: dict[JunctionMovement, frozenset[int]]  # indices of links
    seen_from_m: dict[str, float] = field(default_factory=dict)  # how far before some first lanes others are seen

    def must_yield(self, lane: str, other: str) -> bool:
        """Whether an agent on one lane inside a junction gives way to an agent on another one."""
        one, two = self.links.get(lane), self.links.get(other)
        return one is not None and two is not None and self.lets_pass(one, two)

    def any_yields(self, lanes: Iterable[str], others: Collection[str]) -> bool:
        """Whether an agent on one of the lanes gives way to one on any of the others."""
        return any(self.must_yield(one, other) for one in lanes for other in others)

    def lets_pass(self, link: JunctionMovement, other: JunctionMovement) -> bool:
        """Whether an agent that takes one movement gives way to an agent that takes another one."""
        return link.junction == other.junction and other.index in self.gives_way.get(link, frozenset())


@lru_cache(maxsize=16)
def priorities(road: RoadMap) -> Priorities | None:
    """The right of way of a map that came from SUMO; None for other maps, and for an unreadable network."""
    if road.sumo_net is None:
        return None
    reader = _Reader()
    try:
        walk_network(unpacked_network(road.sumo_net), len(road.sumo_net), reader.begin, reader.end)
    except InputError:
        return None
    return reader.priorities()


class _Reader:
    """An XML handler that reads junctions and connections, and forgets the rest."""

    def __init__(self) -> None:
        self._junction: str | None = None
        self._links: dict[str, JunctionMovement] = {}
        self._gives_way: dict[JunctionMovement, frozenset[int]] = {}
        self._seen_from_m: dict[str, float] = {}
        self._before: dict[str, str] = {}  # by id of a lane inside a junction, the lane before it

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """Note the begin of an element of the network."""
        if name == "junction":
            told = attributes.get("type") not in _FIRST_COME | {"internal"}
            self._junction = attributes["id"] if told else None
            if told:
                lanes = attributes.get("intLanes", "").split()
                self._links |= {lane: JunctionMovement(attributes["id"], index) for index, lane in enumerate(lanes)}
        elif name == "request" and self._junction is not None:
            bits = attributes["response"][::-1]
            yields = frozenset(index for index, bit in enumerate(bits) if bit == "1")
            self._gives_way[JunctionMovement(self._junction, int(attributes["index"]))] = yields
        elif name == "connection" and "via" in attributes:
            if attributes.get("from", "").startswith(":"):
                self._before[attributes["via"]] = f"{attributes['from']}_{attributes['fromLane']}"
            elif "visibility" in attributes:
                self._seen_from_m[attributes["via"]] = float(attributes["visibility"])

    def end(self, name: str) -> None:
        """Note the end of an element of the network."""
        if name == "junction":
            self._junction = None

    def priorities(self) -> Priorities:
        """The right of way; all lanes of a way through a junction get its link, as `intLanes` names only the last."""
        for lane, link in list(self._links.items()):
            before = self._before.get(lane)
            while before is not None and before not in self._links:
                self._links[before] = link
                before = self._before.get(before)
        return Priorities(self._links, self._gives_way, self._seen_from_m)
