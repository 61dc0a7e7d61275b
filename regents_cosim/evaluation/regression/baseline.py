"""Baselines: the accepted outcomes of planners in every case of a suite. This module does not import JAX.

There is one file per suite, `<suite>/baseline.json`: by planner, simulator and case.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import msgspec

from regents_cosim.cases.json_files import with_new_keys
from regents_cosim.cases.provenance import versions
from regents_cosim.cases.shipped import require_own
from regents_cosim.checks.bounded import MIB, read_bounded
from regents_cosim.checks.names import require_file_name, require_inside
from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import CaseError, InputError, RegentsError, ScenarioError, require
from regents_cosim.system.files.atomic import explain_write, require_writable, write_atomic
from regents_cosim.system.files.locks import writing

SCHEMA = 1
FILE = "baseline.json"
_MOST_BYTES = 64 * MIB  # 1 KB for each case, planner and simulator


@dataclass(frozen=True)
class DriveOutcome:
    """The outcome of a planner's drive in one case."""

    hash: str  # hash of the case's content
    outcome: Literal["no_collision", "collision", "rear_ended", "planner_error"]
    agent: str | None = None  # agent that the ego meets
    step: int | None = None  # of the contact
    time_s: float | None = None  # of the contact
    collision_type: str | None = None
    metrics: dict[str, float | None] = field(default_factory=dict)  # those of `metrics.COMPARED`; None: undefined
    error: str = ""  # how the planner failed, on the first line, then its own traceback
    telling: bool | None = None  # whether the collision is; None: not known, or there is none
    flawless: bool | None = None  # likewise

    @property
    def failure(self) -> str:
        """How the planner failed, on one line."""
        return self.error.partition("\n")[0]

    @property
    def trace(self) -> str:
        """The traceback of the planner that failed; empty where it has none."""
        return self.error.partition("\n")[2]

    @property
    def properties(self) -> list[tuple[str, object]]:
        """The outcome as properties for JUnit."""
        hit = {
            "with": self.agent, "type": self.collision_type, "step": self.step, "time_s": self.time_s,
            "telling": self.telling, "flawless": self.flawless,
        }  # fmt: skip
        told = {
            "failure": self.failure or None,
            **{f"collision_{name}": of for name, of in hit.items()},
            **self.metrics,
        }
        return [("outcome", self.outcome), *((name, of) for name, of in told.items() if of is not None)]

    def __post_init__(self) -> None:
        told = [self.agent is not None, self.step is not None, self.time_s is not None, self.collision_type is not None]
        require(
            all(told) if self.outcome in ("collision", "rear_ended") else not any(told),
            f"an outcome {self.outcome!r} with {sum(told)} of agent, step, time_s and collision_type, "
            "expected all of them of a contact, and none otherwise",
        )


@dataclass(frozen=True)
class Baseline:
    """The content of baseline.json."""

    planners: dict[str, dict[str, dict[str, DriveOutcome]]] = field(default_factory=dict)  # planner, simulator, case
    versions: dict[str, str] = field(default_factory=dict)  # of the packages at the last acceptance
    schema: int = SCHEMA

    def __post_init__(self) -> None:
        for simulators in self.planners.values():
            for entries in simulators.values():
                for case in entries:
                    require_file_name(case, "case of a baseline")

    def of(self, planner: str, where: str) -> Mapping[str, DriveOutcome]:
        """The accepted outcomes of a planner in a simulator, by case."""
        return self.planners.get(planner, {}).get(where, {})

    def stranger(self, planner: str, where: str) -> str:
        """A message where it holds nothing of `planner` but something of other names; else empty."""
        known = sorted(name for name, simulators in self.planners.items() if simulators.get(where))
        if not known or planner in known:
            return ""
        return (
            f"the baseline holds nothing of a planner that is named {planner!r} in {where}; it goes by the name that "
            f"is typed, and knows {', '.join(known)} (say which of them it is with --as or --regents-as, or accept the "
            "new name)"
        )

    def accepting(
        self, planner: str, where: str, driven: Mapping[str, DriveOutcome], cases: Iterable[str]
    ) -> "Baseline":
        """The baseline with `driven` accepted, and without entries of this planner and simulator for cases not in
        `cases`. A planner without any entry is left out.
        """
        kept, listed = self.of(planner, where), set(cases)
        entries = {case: one for case, one in sorted({**kept, **driven}.items()) if case in listed}
        simulators = {**self.planners.get(planner, {}), where: entries}
        planners = {**self.planners, planner: {place: its for place, its in simulators.items() if its}}
        return replace(self, planners={name: its for name, its in planners.items() if its}, versions=versions())

    def rehashed(self, hashes: Mapping[str, tuple[str, str]]) -> "Baseline":
        """The baseline with new hashes (old, new) by case, for entries of the old content."""

        def entry(case: str, driven: DriveOutcome) -> DriveOutcome:
            old, new = hashes.get(case, ("", ""))
            return replace(driven, hash=new) if driven.hash == old else driven

        planners = {
            planner: {where: {c: entry(c, one) for c, one in entries.items()} for where, entries in simulators.items()}
            for planner, simulators in self.planners.items()
        }
        return replace(self, planners=planners)


@dataclass(frozen=True)
class _Schema:
    schema: int
    planners: msgspec.Raw | msgspec.UnsetType = msgspec.UNSET


def load_baseline(path: Path) -> Baseline:
    """Read a baseline; an empty one where there is no file. Raises CaseError for one that cannot be read."""
    if not path.exists():
        return Baseline()
    if path.name == FILE:  # of a suite
        require_inside(path, path.parent)
    try:
        text = read_bounded(path, _MOST_BYTES)
        said = from_json(text, _Schema)
        if said.schema != SCHEMA:
            raise CaseError(
                f"{path}: schema {said.schema}, this version reads {SCHEMA} "
                "(upgrade regents_cosim, or accept a new baseline in another file)"
            )
        if said.planners is msgspec.UNSET:  # another file with a schema, which is not an empty baseline
            raise InputError("it names no planners")
        return from_json(with_new_keys(text), Baseline)
    except (InputError, ScenarioError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise CaseError(
            f"{path}: not a baseline, or damaged or truncated ({str(error).splitlines()[0]}); "
            "restore it, or delete it and accept again"
        ) from error


def require_place(path: Path, option: str) -> None:
    """Raise RegentsError where no baseline could be saved in the file that `option` names, before any drive."""
    require_own(path, option)
    require_writable(path.parent)


def save_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline as a whole or not at all."""
    with explain_write(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, msgspec.json.format(msgspec.json.encode(baseline, order="sorted"), indent=1) + b"\n")


def update_baseline(path: Path, change: Callable[[Baseline], Baseline]) -> None:
    """Change the current content of the file, which may be newer than what this run has read, and save it.

    Raises CaseError where the file cannot be read, RegentsError where it cannot be written.
    """
    with explain_write(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        with writing(path.parent):
            before = load_baseline(path)
            after = change(before)
            if after.planners != before.planners:
                save_baseline(path, after)


def require_one_home(cases: Mapping[Path, Iterable[str]], files: Mapping[Path, Path]) -> None:
    """Raise RegentsError where suites with a common baseline have equally named cases; both arguments are by suite."""
    homes: dict[tuple[Path, str], Path] = {}
    for suite, names in cases.items():
        for name in names:
            other = homes.setdefault((files[suite], name), suite)
            if other != suite:
                raise RegentsError(
                    f"case {name} is in {other} and in {suite}, and one baseline cannot hold both: "
                    "leave --regents-baseline out, or run the suites one by one"
                )
