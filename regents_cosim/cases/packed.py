"""Pack cases to send them to another process, with maps as in the files of a suite.

Cases of one map share it in the other process too, so that what is derived of a map is derived once.
"""

from dataclasses import dataclass, fields
from typing import Any

from regents_cosim.cases.map_files import PackedMap, pack_map, unpack_map
from regents_cosim.scenario import Scenario

_PARTS = tuple(part.name for part in fields(Scenario) if part.name != "road")


@dataclass(frozen=True, eq=False)
class PackedCase:
    """A case packed for another process."""

    parts: dict[str, Any]  # the fields of the Scenario by name, except its road
    road: PackedMap


def pack_case(case: Scenario) -> PackedCase:
    """Pack a case to send it to another process."""
    return PackedCase({name: getattr(case, name) for name in _PARTS}, pack_map(case.road))


def unpack_case(packed: PackedCase) -> Scenario:
    """Unpack a case to the same Scenario."""
    return Scenario(**packed.parts, road=unpack_map(packed.road))
