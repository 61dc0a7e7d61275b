"""Choose drives by the kind of crash to which they would lead, for attacks that ask for certain kinds.

The classifier is passed in, since the attack does not know the tags. A drive is classified as the crash that it would
be if the ego did not react; a crash that the search has found is classified again.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

from regents_cosim.attacks.starts.timed_drives import Start, with_drive
from regents_cosim.scenario.scenario import Scenario, Tracks

LOOKED_THROUGH = 4  # times as many drives are classified as are tried


@runtime_checkable
class DriveManoeuvres(Protocol):
    """A classifier for the kinds of crash that are asked for."""

    @property
    def lawful(self) -> bool:
        """Whether lawful drives can show if they lead to a wanted kind: not if a kind breaks the law."""
        ...

    def of_crash(self, case: Scenario) -> frozenset[str]:
        """The wanted kinds that a crash shows."""
        ...

    def of_drive(self, case: Scenario) -> frozenset[str]:
        """The wanted kinds to which a drive may lead, given the crash it causes if the ego does not react."""
        ...


def of_wanted_manoeuvres(
    scenario: Scenario, ego: Tracks, agent: int, found: Sequence[Start], wanted: DriveManoeuvres, most: int
) -> tuple[list[Start], frozenset[str]]:
    """At most `most` of an agent's drives, taken in turn from each kind, in order; and all kinds among the drives.

    `ego` [1, time] is the unattacked track of the ego.
    """
    agents = tuple(replace(one, role="adversary") if k == agent else one for k, one in enumerate(scenario.agents))
    kinds = [
        wanted.of_drive(replace(scenario, agents=agents, tracks=with_drive(scenario.tracks, ego, agent, one)))
        for one in found
    ]
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
