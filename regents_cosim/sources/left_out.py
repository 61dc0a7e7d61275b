"""What is said of road users that a window leaves out."""

from collections.abc import Sequence

from regents_cosim.scenario import LeftOut, Reason, Scenario

_WORDS: dict[Reason, str] = {
    "radius": "out of the radius",
    "limit": "beyond --max-agents",
    "rider": "in a vehicle, on stairs or in a lift",
}


def sentence_of(left_out: LeftOut) -> str:
    """One entry of the ledger in words."""
    number = f"{left_out.count} road user{'s' * (left_out.count != 1)}"
    return f"{number} {_WORDS[left_out.reason]}{f' ({left_out.detail})' if left_out.detail else ''}"


def told_left_out(scenarios: Sequence[Scenario]) -> list[str]:
    """What is said of windows that lack road users who come near the ego; riders are told of while they are read."""
    found = [one for scenario in scenarios for one in scenario.provenance.left_out if one.reason == "limit"]
    if not found:
        return []
    least, most = min(one.count for one in found), max(one.count for one in found)
    number = str(least) if least == most else f"{least} to {most}"
    detail = f" ({found[0].detail})" if len(found) == 1 else ""
    return [f"road users {_WORDS['limit']}{detail}: {number} in {len(found)} of {len(scenarios)} windows"]
