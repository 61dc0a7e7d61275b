"""What is said of road users that a window leaves out."""

from collections.abc import Sequence

from regents_cosim.scenario import LeftOut, Reason, Scenario

_WORDS: dict[Reason, str] = {
    "radius": "out of the radius",
    "limit": "beyond --max-agents",
    "rider": "in a vehicle, on stairs or in a lift",
    "level": "on a road above or below the ego's",
    "cut": "where their track leaps",
    "unsupported": "of a kind that is not supported",
    "guessed": "here with a heading that is guessed",
}


def sentence_of(left_out: LeftOut) -> str:
    """One entry of the ledger in words."""
    number = f"{left_out.count} road user{'s' * (left_out.count != 1)}"
    return f"{number} {_WORDS[left_out.reason]}{f' ({left_out.detail})' if left_out.detail else ''}"


def told_left_out(scenarios: Sequence[Scenario]) -> list[str]:
    """A line for each reason for which windows lack a road user that comes near the ego."""
    lines = []
    for reason, words in _WORDS.items():
        if reason in ("radius", "rider"):  # riders are told of while they are read
            continue
        found = [one for scenario in scenarios for one in scenario.provenance.left_out if one.reason == reason]
        counts = sorted(one.count for one in found)
        if counts:
            number = str(counts[0]) if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]}"
            detail = f" ({found[0].detail})" if len(found) == 1 and found[0].detail else ""
            lines.append(f"road users {words}{detail}: {number} in {len(found)} of {len(scenarios)} windows")
    return lines
