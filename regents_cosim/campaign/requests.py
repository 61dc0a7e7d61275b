"""Kinds of crash that are asked for, with a number each: `--type cut_in=10`. The tags are the judge."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from regents_cosim.campaign.ledger import LedgerRecord
from regents_cosim.cases.files import load_header
from regents_cosim.errors import RegentsError
from regents_cosim.scenario import Scenario
from regents_cosim.tags.table import TYPES, require_tags, tags_of

_FIRST = 4  # windows that are recorded for every case wanted, at first
_MORE = 4  # times as many in every round after
_LEAST, _MOST = 8, 1_000_000


@dataclass(frozen=True)
class Wanted:
    """How many crashes of which kinds."""

    counts: Mapping[str, int]

    def takes(self, case: Scenario, found: Counter[str]) -> bool:
        """Whether a case is a crash of a kind of which there are too few; counts it if so."""
        crashed = case.attack is not None and case.attack.outcome == "collision"
        kinds = self.counts.keys() & set(tags_of(case)) if crashed else set[str]()
        wanted = any(found[kind] < self.counts[kind] for kind in kinds)
        found.update(kinds if wanted else ())
        return wanted

    def is_met(self, found: Counter[str]) -> bool:
        """Whether there are enough of all."""
        return all(found[kind] >= count for kind, count in self.counts.items())

    def found_in(self, record: LedgerRecord, folder: Path) -> Counter[str]:
        """What a run has found so far."""
        cases = [name for unit in record.own if record.is_done(unit) for name, _ in record.done[unit.name].cases]
        tags = (load_header(folder / name).tags or () for name in cases)
        return Counter(tag for its in tags for tag in its if tag in self.counts)

    def windows(self) -> Iterator[int]:
        """How many windows to record, in one round after the other."""
        count = max(_FIRST * sum(self.counts.values()), _LEAST)
        while count <= _MOST:
            yield count
            count *= _MORE

    def said(self, found: Counter[str], windows: int) -> str:
        """How far it got, and why not further."""
        each = ", ".join(f"{found[kind]} of {count} {kind}" for kind, count in self.counts.items())
        end = "" if self.is_met(found) else "; the traffic holds no more windows (another --seed is other traffic)"
        return f"{each} in {windows} windows{end}"


def parse_types(words: Sequence[str], count: int) -> Wanted | None:
    """`cut_in=10`, or `cut_in` for `count` of them; None where nothing is asked for. Raises RegentsError."""
    counts: dict[str, int] = {}
    for word in words:
        kind, equals, number = word.partition("=")
        require_tags([kind], TYPES)
        if equals and not (number.isdecimal() and 0 < int(number) <= _MOST):
            raise RegentsError(f"--type {word}: expected a number from 1 after the =, as in {kind}=10")
        if kind in counts:
            raise RegentsError(f"--type {kind} is given twice: expected each kind once")
        counts[kind] = int(number) if equals else count
    return Wanted(counts) if counts else None
