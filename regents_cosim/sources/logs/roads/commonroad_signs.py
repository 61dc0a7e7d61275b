"""What CommonRoad tells of the lanelets that lead into and through intersections: signs on giving way, directions.

Source: `TrafficSignID...` of commonroad-io 2024.3: 205 yield, 206 stop, 301 priority, 306 priority road, 102 priority
to the right; in the USA R1-1 stop, R1-2 yield. As in that library, an unknown country counts as Zamunda, with German
signs.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from regents_cosim.maps.roadmap import Approach

_GERMAN: dict[str, Approach] = {
    "205": "yields", "206": "yields", "301": "priority", "306": "priority", "102": "right_first",
}  # fmt: skip
# At American signs to stop on all sides the first to come goes first.
_AMERICAN: dict[str, Approach] = {"R1-1": "stops", "R1-2": "yields"}
_SIGNS = {"USA": _AMERICAN, "PRI": _AMERICAN, "DEU": _GERMAN, "ZAM": _GERMAN}
_OTHERS = frozenset({"CHN", "ITA", "ESP", "RUS", "ARG", "BEL", "FRA", "GRC", "HRV", "AUS"})  # signs not known here


def approaches_of(root: ET.Element, country: str) -> dict[str, Approach]:
    """What their signs tell, by lanelet; those of lanelets with a light are left out, since its phases may be missing.

    All lanelets of one arm of an intersection count together, as files put its sign on any of them, and signs of other
    arms on some: most of its signs decide. An arm without any, in an intersection without any, gives way to the right
    where the file has signs of priority elsewhere.
    """
    meanings = {} if country in _OTHERS else _SIGNS.get(country, _GERMAN)
    meant: dict[str, Approach] = {}
    for sign in root.iter("trafficSign"):
        ids = ((part.findtext("trafficSignID") or "").strip() for part in sign.iter("trafficSignElement"))
        if known := next((name for name in ids if name in meanings), None):
            meant[sign.get("id", "")] = meanings[known]
    told: dict[str, list[Approach]] = {
        lane.get("id", ""): [meant[name] for ref in lane.findall("trafficSignRef") if (name := ref.get("ref")) in meant]
        for lane in root.findall("lanelet")
    }
    lit = {lane.get("id", "") for lane in root.findall("lanelet") if lane.find("trafficLightRef") is not None}
    found: dict[str, Approach] = {lane: here[0] for lane, here in told.items() if len(set(here)) == 1}
    for arms in ([arm.lanelets for arm in arms] for arms in intersections(root)):
        signs: list[list[Approach]] = [[one for lane in arm for one in told.get(lane, [])] for arm in arms]
        bare = bool(meant) and meanings is _GERMAN and not any(signs) and lit.isdisjoint(set().union(*arms))
        for arm, here in zip(arms, signs, strict=True):
            for lane in arm:
                found.pop(lane, None)
            tells: Approach | None = "right_first" if bare else _most(here)
            if tells:
                found.update(dict.fromkeys(arm, tells))
    return {lane: said for lane, said in found.items() if lane not in lit}


class Arm(NamedTuple):
    """The lanelets of an arm of an intersection: those that lead in, and those through it by direction."""

    leading_in: set[str]
    onward: dict[str, set[str]]  # right, straight, left

    @property
    def inside(self) -> set[str]:
        """The lanelets through the intersection."""
        return set().union(*self.onward.values())

    @property
    def lanelets(self) -> set[str]:
        """All lanelets of the arm."""
        return self.leading_in | self.inside


def intersections(root: ET.Element) -> Iterator[list[Arm]]:
    """The arms of each intersection."""

    def named(arm: ET.Element, tag: str) -> set[str]:
        return {part.get("ref", "") for part in arm.findall(tag)}

    for one in root.findall("intersection"):
        yield [
            Arm(
                named(arm, "incomingLanelet"),
                {way: named(arm, f"successors{way.title()}") for way in ("right", "straight", "left")},
            )
            for arm in one.findall("incoming")
        ]


def _most(signs: list[Approach]) -> Approach | None:
    """What most signs of an arm tell; None where there is none, or no majority."""
    counts = Counter(signs)
    most: list[Approach] = [one for one, count in counts.items() if count == max(counts.values())]
    return most[0] if len(most) == 1 else None
