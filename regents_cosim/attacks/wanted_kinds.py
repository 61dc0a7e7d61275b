"""Drives by the kind of crash that they would make: those of kinds that are asked for are searched from, and no others.

Who tells kinds is handed in, for the attack does not know the tags. A drive is judged as the crash that it would be if
the ego went on as it does unattacked; a crash that the search has found is judged once more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from regents_cosim.attacks.starts import Start
from regents_cosim.scenario import Scenario, Tracks

LOOKED_THROUGH = 4  # times the drives that are tried: among so many those of the kinds are looked for


@runtime_checkable
class WantedKinds(Protocol):
    """Tells kinds of crash that are asked for."""

    @property
    def lawful(self) -> bool:
        """Whether lawful drives tell whether they lead to one: not where one breaks the law."""
        ...

    def of_crash(self, case: Scenario) -> frozenset[str]:
        """Those of them that a crash is of."""
        ...

    def of_drive(self, case: Scenario) -> frozenset[str]:
        """Those of them that a drive may lead to that would make this crash, were the ego not to react."""
        ...


@dataclass(frozen=True, eq=False)
class Unattacked:
    """A scenario, and the track [1, time] that the ego drives there unattacked."""

    scenario: Scenario
    ego: Tracks

    def met_by(self, agent: int, start: Start) -> Scenario:
        """The case that a drive of `agent` would make."""
        tracks = self.scenario.tracks
        driven = {name: np.array(getattr(tracks, name)) for name in ("x", "y", "yaw", "speed")}
        for name, values in driven.items():
            values[agent], values[0] = getattr(start, name), getattr(self.ego, name)[0]
        agents = list(self.scenario.agents)
        agents[agent] = replace(agents[agent], role="adversary")
        return replace(self.scenario, agents=tuple(agents), tracks=replace(tracks, **driven))


def of_wanted_kinds(
    unattacked: Unattacked, agent: int, found: Sequence[Start], wanted: WantedKinds, most: int
) -> tuple[list[Start], frozenset[str]]:
    """At most `most` of an agent's drives, by turns of each kind, in their order; and the kinds that there are."""
    kinds = [wanted.of_drive(unattacked.met_by(agent, one)) for one in found]
    there = sorted(frozenset[str]().union(*kinds))
    left, chosen = list(range(len(found))), list[Start]()
    while left and there and len(chosen) < most:
        for kind in there:
            at = next((at for at in left if kind in kinds[at]), None)
            if at is not None and len(chosen) < most:
                left.remove(at)
                chosen.append(found[at])
        there = [kind for kind in there if any(kind in kinds[at] for at in left)]
    return chosen, frozenset[str]().union(*kinds)
