"""The map of behaviours: crashes by manoeuvre, closing speed and how long they are to be seen, the best of each cell.

It is an archive as in MAP-Elites (Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv
1504.04909); the QD score is that of Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary
computation". All values are plain, so that no tracks need to be read for them.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import Any, Literal, get_args

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Behaviour, Header
from regents_cosim.norms.grades import Prevention
from regents_cosim.plain_text import counted
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.data_frames import Tabular
from regents_cosim.tags.table import MANOEUVRES, tags_of
from regents_cosim.verdicts.behaviour import behaviour_of
from regents_cosim.verdicts.judge import up_to_date

# from worst to best, each named by the best word that holds
Standing = Literal["crash", "clean", "preventable", "telling", "flawless"]
STANDINGS: tuple[Standing, ...] = get_args(Standing)


@dataclass(frozen=True)
class Crash:
    """The values of one crash that the map of behaviours needs."""

    case: str
    hash: str
    tags: tuple[str, ...]
    closing_m_s: float  # [m/s] relative speed at the contact
    departs_s: float | None  # [s] from when the adversary visibly leaves its log to the contact; None: never visible
    standing: Standing
    usual_percent: float | None  # how usual the adversary's motion is (docs/crashes.md); None: not known
    deviation_m: float  # [m] mean distance of the adversary from its log up to the contact

    @property
    def quality(self) -> float:
        """1 for a crash, 2 for a clean one, 3 if also preventable, 4 if telling, 5 if flawless.

        Up to 1 is added for how usual the adversary's motion is; an unknown value adds 0.
        """
        return 1.0 + STANDINGS.index(self.standing) + (self.usual_percent or 0.0) / 100.0

    @property
    def order(self) -> tuple[float, float, str]:
        """A sort key, least for the best crash of a cell: quality, then deviation, then the hash to break ties."""
        return -self.quality, self.deviation_m, self.hash


def crash_of(case: Scenario) -> Crash | None:
    """The crash of a case in memory; None if the case has no crash."""
    behaviour = behaviour_of(case)
    return None if behaviour is None else _crash(case, content_hash(case), tags_of(case), behaviour)


def crash_in(folder: Path) -> Crash | None:
    """The crash of a saved case; None if it has none. Tracks are read only for cases of older versions.

    Raises CaseError where the case cannot be read.
    """
    header = load_header(folder)
    if header.attack is None or header.attack.crash is None:
        return None
    old = header.judgement is not None and not header.judgement.is_current
    if header.tags is None or header.behaviour is None or old:
        found = crash_of(up_to_date(load_case(folder)))
        return found and replace(found, hash=header.hash)
    return _crash(header, header.hash, header.tags, header.behaviour)


def _crash(case: Header | Scenario, digest: str, tags: tuple[str, ...], behaviour: Behaviour) -> Crash | None:
    hit = case.attack.crash if case.attack else None
    if hit is None or case.attack is None or case.attack.careful_completion is not None:
        return None
    judged = case.judgement
    return Crash(
        case=case.id,
        hash=digest,
        tags=tags,
        closing_m_s=hit.relative_speed,
        departs_s=behaviour.departs_s,
        standing=_standing(judged),
        usual_percent=judged.usual if judged else None,
        deviation_m=behaviour.deviation_m,
    )


def _standing(judged: Judgement | None) -> Standing:
    if judged is None or not judged.clean:
        return "crash"
    if judged.telling:
        return "flawless" if judged.flawless else "telling"
    return "preventable" if judged.prevention is Prevention.PREVENTABLE else "clean"


Cell = tuple[str, ...]  # one label per axis
_OTHER = "none"


@dataclass(frozen=True)
class Axis:
    """One axis of the map."""

    name: str
    labels: tuple[str, ...]  # all labels, in order
    of: Callable[[Crash], str]  # gives the label of a crash


def _measured(
    name: str, edges: Sequence[int], unit: str, value: Callable[[Crash], float | None], unknown: str = ""
) -> Axis:
    """An axis that labels a crash by the bin of a value; `unknown` labels crashes without a value."""
    bounds = tuple(pairwise(edges))
    bins = (*(f"{low}-{high} {unit}" for low, high in bounds), f"{edges[-1]}+ {unit}")

    def label(crash: Crash) -> str:
        found = value(crash)
        return unknown if found is None else bins[max(bisect_right(edges, found) - 1, 0)]

    return Axis(name, (*bins, unknown) if unknown else bins, label)


AXES = (
    Axis("manoeuvre", (*MANOEUVRES, _OTHER), lambda crash: next((t for t in MANOEUVRES if t in crash.tags), _OTHER)),
    _measured("closing_speed", (0, 5, 10, 15, 20), "m/s", lambda crash: crash.closing_m_s),
    _measured("departure", range(8), "s", lambda crash: crash.departs_s, "not seen"),
)
NAMES = tuple(axis.name for axis in AXES)
CELLS = prod(len(axis.labels) for axis in AXES)  # number of cells, some of which no crash can fill


def cell_of(crash: Crash) -> Cell:
    """The cell of a crash."""
    return tuple(axis.of(crash) for axis in AXES)


class Archive(Tabular):
    """The best crash of each cell; which one that is does not depend on the order in which crashes are added."""

    def __init__(self, crashes: Iterable[Crash] = ()) -> None:
        self.crashes = 0  # added so far, the best of their cell or not
        self._best: dict[Cell, Crash] = {}
        for crash in crashes:
            self.add(crash)

    def add(self, crash: Crash) -> Cell:
        """Add a crash, and return its cell."""
        cell = cell_of(crash)
        self.crashes += 1
        self._best[cell] = min(self._best.get(cell, crash), crash, key=lambda one: one.order)
        return cell

    def elite(self, cell: Cell) -> Crash | None:
        """The best crash of a cell; None where the cell is empty."""
        return self._best.get(cell)

    @property
    def elites(self) -> dict[Cell, Crash]:
        """The best crash of every filled cell, in the order of the axes."""
        order = [{label: at for at, label in enumerate(axis.labels)} for axis in AXES]
        places = {cell: [at[label] for at, label in zip(order, cell, strict=True)] for cell in self._best}
        return {cell: self._best[cell] for cell in sorted(places, key=places.__getitem__)}

    @property
    def qd_score(self) -> float:
        """The sum of the quality of all elites."""
        return round(sum((crash.quality for crash in self.elites.values()), 0.0), 3)

    def improves(self, crash: Crash) -> str:
        """How a crash would improve its cell: `new cell`, `plainer`, `gentler`, or empty if it would not."""
        best = self.elite(cell_of(crash))
        if best is None:
            return "new cell"
        if crash.order >= best.order:
            return ""
        return "gentler" if crash.standing == best.standing else "plainer"

    def _rows(self) -> list[dict[str, Any]]:
        """One row for every filled cell."""
        return [
            {
                **dict(zip(NAMES, cell, strict=True)),
                "case": crash.case,
                "standing": crash.standing,
                "usual_percent": crash.usual_percent,
                "deviation_m": crash.deviation_m,
                "quality": round(crash.quality, 3),
            }
            for cell, crash in self.elites.items()
        ]

    def summary(self) -> str:
        """The counts of the map in one sentence."""
        counts = ((name, sum(crash.standing == name for crash in self.elites.values())) for name in STANDINGS[::-1])
        each = ", ".join(f"{count} {name if name != 'crash' else 'other'}" for name, count in counts if count)
        said = f"{len(self.elites)} of {CELLS} cells filled by {counted(self.crashes, 'crash')}"
        return said + (f" ({each})" if each else "") + f", QD score {self.qd_score:g}"

    def to_dict(self) -> dict[str, Any]:
        """All results as plain values; those of the elites are the table."""
        return {
            "axes": {axis.name: list(axis.labels) for axis in AXES},
            "cells": CELLS,
            "filled": len(self.elites),
            "crashes": self.crashes,
            "qd_score": self.qd_score,
            "elites": self._rows(),
        }


def archive_of(folders: Iterable[Path]) -> Archive:
    """The archive of the crashes in these case folders. Raises CaseError."""
    return Archive(filter(None, map(crash_in, folders)))
