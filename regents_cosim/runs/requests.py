"""Requests for crashes with certain manoeuvres of the adversary: `--manoeuvre cut_in=10`; tags decide."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.cases.files import load_header
from regents_cosim.errors import RegentsError
from regents_cosim.runs.ledger import LedgerRecord
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.tags.table import MANOEUVRES, require_tags, tags_of

_FIRST = 4  # windows recorded at first per requested case
_MORE = 4  # factor of windows in every later round
_LEAST, _MOST = 8, 1_000_000
_UNLAWFUL = ("run_red_light", "wrong_way")
# Manoeuvres that can turn into the one named when the ego brakes or the search changes the drive.
_BEFORE = {"lane_drift": ("cut_in",), "hard_brake": ("cut_in", "lane_drift")}


@dataclass(frozen=True)
class WantedManoeuvres:
    """How many crashes of which manoeuvres are wanted. Raises RegentsError for what is no manoeuvre."""

    counts: Mapping[str, int]

    def __post_init__(self) -> None:
        require_tags(self.counts, MANOEUVRES)

    @property
    def lawful(self) -> bool:
        """Whether none of the manoeuvres breaks the law."""
        return self.counts.keys().isdisjoint(_UNLAWFUL)

    def require_possible(self, config: AttackConfig) -> None:
        """Raise RegentsError for manoeuvres that a search with `config` cannot find."""
        if config.bound and not self.lawful:
            kinds = " and ".join(sorted(self.counts.keys() & set(_UNLAWFUL)))
            raise RegentsError(f"--manoeuvre {kinds}: it breaks the law, expected `adversary_may` anything as well")

    def of_crash(self, case: Scenario) -> frozenset[str]:
        """The wanted manoeuvres that a crash shows."""
        return frozenset(tags_of(case, self.counts))

    def of_drive(self, case: Scenario) -> frozenset[str]:
        """The wanted manoeuvres to which a drive may lead, given the crash it causes if the ego does not react."""
        before = {kind: {kind, *_BEFORE.get(kind, ())} for kind in self.counts}
        found = set(tags_of(case, frozenset[str]().union(*before.values())))
        return frozenset(kind for kind, its in before.items() if its & found)

    def takes(self, case: Scenario, found: Counter[str]) -> bool:
        """Whether a case is a crash with a manoeuvre of which there are too few; if so, count it in `found`."""
        kinds = self.of_crash(case) if case.crash else frozenset[str]()
        wanted = any(found[kind] < self.counts[kind] for kind in kinds)
        found.update(kinds if wanted else ())
        return wanted

    def promised_by(self, cases: Sequence[Scenario]) -> frozenset[str] | None:
        """The manoeuvres to which drives in a window would lead, as the search noted; None where it did not look."""
        known = [case.attack.promised for case in cases if case.attack and case.attack.promised is not None]
        return frozenset[str]().union(*known) if known else None

    def is_met(self, found: Counter[str]) -> bool:
        """Whether there are enough crashes of every manoeuvre."""
        return all(found[kind] >= count for kind, count in self.counts.items())

    def found_in(self, record: LedgerRecord, folder: Path) -> Counter[str]:
        """The crashes that a run has found so far, by manoeuvre."""
        cases = [name for one in record.finished for name, _ in one.cases]
        tags = (load_header(folder / name).tags or () for name in cases)
        return Counter(tag for its in tags for tag in its if tag in self.counts)

    def windows(self) -> Iterator[int]:
        """The number of windows to record, round by round."""
        count = max(_FIRST * sum(self.counts.values()), _LEAST)
        while count <= _MOST:
            yield count
            count *= _MORE

    def said(self, found: Counter[str], record: LedgerRecord, *, ended: bool) -> str:
        """The state in words, and why it went no further; `ended` says that there are no more windows."""
        each = ", ".join(f"{found[kind]} of {count} {kind}" for kind, count in self.counts.items())
        so_far = f"{each} in {len(record.own)} windows"
        if self.is_met(found):
            return so_far
        promised = [one.said.get("promised") for one in record.finished]
        looked_at = [kinds for kinds in promised if kinds is not None]
        missing = [kind for kind, count in self.counts.items() if found[kind] < count] if looked_at else []
        why = [_why(kind, sum(kind in kinds for kinds in looked_at), len(looked_at), ended) for kind in missing]
        end = ": the traffic holds no more (another --seed is other traffic)" if ended else " so far"
        return "; ".join([so_far + end, *why])


def _why(kind: str, promising: int, windows: int, ended: bool) -> str:
    if promising:
        return f"drives to the ego on lawful paths lead to {kind} in {promising} of {windows} windows"
    said = f"no drive to the ego on a lawful path leads to {kind} in any of {windows} windows"
    return f"{said}: this traffic cannot serve it" if ended else said


def parse_manoeuvres(words: Sequence[str], count: int) -> WantedManoeuvres | None:
    """Parse `cut_in=10`, or `cut_in` for `count` of them; None where nothing is asked for. Raises RegentsError."""
    counts: dict[str, int] = {}
    for word in words:
        kind, equals, number = word.partition("=")
        require_tags([kind], MANOEUVRES)
        if equals and not (number.isdecimal() and len(number) <= len(str(_MOST)) and 0 < int(number) <= _MOST):
            raise RegentsError(f"--manoeuvre {word}: expected a number from 1 after the =, as in {kind}=10")
        if kind in counts:
            raise RegentsError(f"--manoeuvre {kind} is given twice: expected each once")
        counts[kind] = int(number) if equals else count
    return WantedManoeuvres(counts) if counts else None
