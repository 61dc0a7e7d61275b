"""Messages about the road users that a recording or one of its windows leaves out."""

from collections.abc import Sequence

from regents_cosim.scenario.scenario import LeftOut, Reason, Scenario
from regents_cosim.sources.recording import Recording

_WORDS: dict[Reason, str] = {
    "radius": "out of the radius",
    "limit": "beyond `max_agents`",
    "rider": "in a vehicle, on stairs or in a lift",
    "unlogged": "that the source does not show",
    "jump": "cut where they jump",
    "gap": "gone for a while, as in the source",
    "level": "on another level",
    "guessed": "with a guessed heading",
    "unsupported": "left out of the file",
}
# These happen in every window, or are reported while it is read, or are limits of the source.
_UNTOLD: frozenset[Reason] = frozenset({"radius", "rider", "gap", "level", "unsupported"})


def sentence_of(left_out: LeftOut) -> str:
    """One entry of `left_out` as a sentence."""
    number = f"{left_out.count or 'some'} road user{'s' * (left_out.count != 1)}"
    return f"{number} {_WORDS[left_out.reason]}{f' ({left_out.detail})' if left_out.detail else ''}"


def told_left_out(scenarios: Sequence[Scenario]) -> list[str]:
    """Messages about road users that windows leave out; riders are reported while they are read."""
    return [line for reason in _WORDS if reason not in _UNTOLD for line in _told(scenarios, reason)]


def told_of_recordings(recordings: Sequence[Recording]) -> list[str]:
    """Messages about traffic that is not recorded as it is."""
    riders = frozenset[str]().union(*(one.riders for one in recordings))
    hinged = {name for one in recordings for name, kind in zip(one.ids, one.types, strict=True) if kind.articulated}
    said = []
    if riders:
        said.append(
            f"{len(riders)} person{'s' * (len(riders) != 1)} left out while in a vehicle, on stairs or in a lift, or "
            "where the log gives no place"
        )
    if hinged:
        said.append(f"{len(hinged)} articulated vehicle{'s' * (len(hinged) != 1)} taken as rigid: one box each")
    return said


def _told(scenarios: Sequence[Scenario], reason: Reason) -> list[str]:
    found = [one for scenario in scenarios for one in scenario.provenance.left_out if one.reason == reason]
    if not found:
        return []
    least, most = min(one.count for one in found), max(one.count for one in found)
    number = str(least or "some") if least == most else f"{least} to {most}"
    detail = f" ({found[0].detail})" if len({one.detail for one in found}) == 1 and found[0].detail else ""
    return [f"road users {_WORDS[reason]}{detail}: {number} in {len(found)} of {len(scenarios)} windows"]
