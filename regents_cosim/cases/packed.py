"""Cases for another process, their maps as the files of a suite hold them.

There as well cases of one map share it then, and what is derived of a map is derived once.
"""

from dataclasses import dataclass, fields
from typing import Any

from regents_cosim.cases.map_files import PackedMap, pack_map, unpack_map
from regents_cosim.scenario import Scenario

_PARTS = tuple(part.name for part in fields(Scenario) if part.name != "road")


@dataclass(frozen=True, eq=False)
class PackedCase:
    """One case."""

    parts: dict[str, Any]  # of the Scenario, by name, all but its road
    road: PackedMap


def pack_case(case: Scenario) -> PackedCase:
    """A case for another process."""
    return PackedCase({name: getattr(case, name) for name in _PARTS}, pack_map(case.road))


def unpack_case(packed: PackedCase) -> Scenario:
    """The case as it was."""
    return Scenario(**packed.parts, road=unpack_map(packed.road))
