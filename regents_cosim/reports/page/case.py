"""A case on the page of the report: its row of the table, and the data for its player."""

import shlex
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from regents_cosim.evaluation.drives.crash_verdict import CaseEnd, CrashVerdict
from regents_cosim.planners.interface import Debug, DebugSteps
from regents_cosim.planners.names import is_built_in
from regents_cosim.reports.crash_moments import braking_line
from regents_cosim.reports.drawing.pictured_case import PicturedCase, contact_point
from regents_cosim.reports.drawing.texts.caption import COLLISION_TYPES, OUTCOMES, deadly_words
from regents_cosim.reports.drawing.texts.notes import mark_words
from regents_cosim.reports.page.crash_groups import FAULTS, NO_NEED, ReportedCrash, need_of, urgency
from regents_cosim.reports.page.map import PageMap
from regents_cosim.reports.page.packing import Spans, gaps, line, motion, packed, visible
from regents_cosim.scenario.attack_record import AttackRecord, Collision
from regents_cosim.scenario.collisions import collision_of_drive
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.sources.left_out import sentence_of
from regents_cosim.tags.table import tags_of
from regents_cosim.verdicts.careful.evasion import gaps_m
from regents_cosim.verdicts.words import (
    crash_words,
    holds_words,
    offences_words,
    prevention_words,
    telling_words,
    untold_words,
)

Change = Literal["broken", "worse", "better", "fixed", "unchanged"]
_CHANGES: tuple[Change | None, ...] = ("broken", "worse", None, "unchanged", "better", "fixed")  # the worst first
_OF_VERDICT = ("prevention", "rule", "clean", "telling", "flawless", "offences", "ego_offences")
_MOST_COSTS = 240  # most iterations drawn
_NOTHING = CaseEnd(crashed=False)


@dataclass(frozen=True, eq=False)
class PageDrive:
    """A case as one driver drove it."""

    driver: str
    tracks: Tracks | None  # of all agents; None where the planner failed
    error: str = ""
    closest: dict[str, float | None] | None = None  # how close it came to a collision, as in `Safety`; None: not known
    end: CaseEnd = _NOTHING
    debug: DebugSteps = ()  # what the planner thought before its crash

    @property
    def verdict(self) -> CrashVerdict | None:
        """The verdict on its crash; None without one."""
        return self.end.verdict


@dataclass(frozen=True)
class MotionRow:
    """One quantity of the adversary's motion: its 5th and 95th percentiles, up to the crash."""

    quantity: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]
    traffic: tuple[float, float]  # of all agents, before the attack
    limit: float  # of a car on a dry road
    beyond_percent: float  # share of the adversary's steps after the attack


@dataclass(frozen=True, eq=False)
class PageCase:
    """A case with the drives of all drivers."""

    scenario: Scenario
    runs: tuple[PageDrive, ...]
    motion: tuple[MotionRow, ...] = ()  # compares the adversary with the traffic

    @cached_property
    def endings(self) -> tuple[Collision | None, ...]:
        """The collision of each driver, by exact boxes."""
        return tuple(
            collision_of_drive(self.scenario, run.tracks) if run.tracks and run.end.crashed else None
            for run in self.runs
        )

    @property
    def change(self) -> Change | None:
        """How the second driver changes the case compared with the first; a failing planner has broken it.

        If both crash, the less urgent crash is better: for example one that is no longer telling.
        """
        if len(self.runs) < 2:
            return None
        first, second = (urgency(run.end) for run in self.runs)
        if first == second:
            return "unchanged"
        if NO_NEED in (first, second):
            return "broken" if first == NO_NEED else "fixed"
        return "worse" if second < first else "better"

    @property
    def verdict(self) -> CrashVerdict | None:
        """The verdict on the crash of the last driver that has one."""
        return next((run.verdict for run in reversed(self.runs) if run.verdict), None)

    @property
    def badness(self) -> tuple[Any, ...]:
        """The sort key of the page: by the urgency of the last driver's ending (`crash_groups`), then by its impact."""
        impact = max((hit.relative_speed for hit in self.endings if hit), default=-1.0)
        calls = [ttc for run in self.runs if run.closest and (ttc := run.closest["ttc_s"]) is not None]
        crash = self.crash.sort if self.crash else ()
        return urgency(self.runs[-1].end), crash, _CHANGES.index(self.change), -impact, min(calls, default=inf)

    @property
    def crash(self) -> ReportedCrash | None:
        """The crash, or the failure, of the last driver, which is the one to fix; None without one."""
        run, hit = self.runs[-1], self.endings[-1]
        if need_of(run.end) is None:
            return None
        words = "Planner failed" if run.end.failed or hit is None else _sentence(COLLISION_TYPES[hit.collision_type])
        return ReportedCrash(self.scenario.id, words, run.end, self.change == "broken")

    def entry(self, page_map: PageMap, folder: Path | None, driven: bool, tags: tuple[str, ...] | None) -> "PageEntry":
        """The entry for the page; `tags` where they are known."""
        case = self.scenario
        return PageEntry(
            row=self.row(page_map.index, tags),
            content=packed(visible(self.content(page_map, folder, driven))),
            badness=self.badness,
            crash=self.crash,
            endings=self.endings,
            runs=tuple(replace(run, tracks=None, debug=()) for run in self.runs),
            attack=case.attack and replace(case.attack, cost_history={}),
            network=network(case),
            of_sumo=case.road.sumo_net is not None,
        )

    def row(self, map_index: int, tags: tuple[str, ...] | None = None) -> dict[str, Any]:
        """The row of the table."""
        case, attack, verdict = self.scenario, self.scenario.attack, self.verdict
        return {
            "id": case.id,
            "network": network(case),
            "tags": tags_of(case) if tags is None else tags,
            "attacked": attack.planner if attack else "",
            "otherwise": self._otherwise(),
            "endings": [_plain(hit) for hit in self.endings],
            "errors": [run.error for run in self.runs],
            "closest": [run.closest for run in self.runs],
            "change": self.change,
            "need": need_of(self.runs[-1].end),
            "fault": FAULTS[verdict.at_fault] if verdict and verdict.at_fault else None,
            **{name: getattr(verdict, name, None) for name in _OF_VERDICT},
            "verdict": [run.verdict.words if run.verdict else None for run in self.runs],
            "map": map_index,
            "steps": case.tracks.steps,
            "dt": case.dt,
        }

    def _otherwise(self) -> str:
        """The text of the table for a case without a collision."""
        attack = self.scenario.attack
        if attack is None or attack.planner_error or attack.outcome in ("collision", "no_collision"):
            return "No collision"
        return _sentence(OUTCOMES[attack.outcome])

    def content(self, page_map: PageMap, folder: Path | None, driven: bool = False) -> dict[str, Any]:
        """The data of the player, the plots and the sheets; `folder` is the suite, `driven` as in the report."""
        case, origin = self.scenario, page_map.origin
        others = range(1, len(case.agents))
        runs = [run.tracks for run in self.runs]
        return {
            "agents": [
                {"id": agent.id, "kind": agent.kind, "size": [agent.length, agent.width]} for agent in case.agents
            ],
            "tracks": [motion(case.tracks, i, origin) for i in others],
            "runs": [motion(tracks, 0, origin) if tracks else [] for tracks in runs],
            "adversary": case.adversary,
            "log": None
            if case.log is None
            else {str(i): motion(case.log, i, origin) for i in (0, case.adversary) if i is not None},
            "evasion": motion(case.evasion, 0, origin) if case.evasion else None,
            "gaps": {
                "runs": [self._gap(tracks, case.tracks) for tracks in runs],
                "log": self._gap(case.log, case.log),
                "evasion": self._gap(case.evasion, case.tracks),
            },
            "contacts": [self._contact(tracks, hit) for tracks, hit in zip(runs, self.endings, strict=True)],
            "origin": origin.tolist(),
            "signals": {signal.id: signal.changes for signal in case.signals},
            "costs": _costs(case),
            "debug": [{str(step): _thought(one, origin) for step, one in run.debug} for run in self.runs],
            "stories": [  # the words of the verdicts are in the table
                crash_words(case.agents, tracks, hit) if tracks and hit else ""
                for tracks, hit in zip(runs, self.endings, strict=True)
            ],
            "braking": [
                braking_line(case, tracks, hit, with_careful=not driven)
                for tracks, hit in zip(runs, self.endings, strict=True)
            ],
            "marks": [] if driven else _marks(PicturedCase.of(case), origin),
            "motion": [asdict(row) for row in self.motion],
            "judgement": _judgement(case),
            "facts": _facts(case),
            "settings": _settings(case.attack) if case.attack else {},
            "commands": _commands(case, [run.driver for run in self.runs], driven, folder),
        }

    def _gap(self, ego: Tracks | None, others: Tracks | None) -> Spans:
        if ego is None or others is None or self.scenario.adversary is None:
            return []
        there = self.scenario.adversary
        return gaps(gaps_m(self.scenario.agents, ego, others, there), ego.valid[0] & others.valid[there])

    def _contact(self, tracks: Tracks | None, hit: Collision | None) -> list[float] | None:
        if tracks is None or hit is None:
            return None
        agent = self.scenario.index(hit.agent)
        return contact_point(self.scenario.agents, tracks, agent, hit.step).round(2).tolist()


@dataclass(frozen=True, eq=False)
class PageEntry:
    """A case on the page, with its tracks packed."""

    row: dict[str, Any]
    content: str  # packed data
    badness: tuple[Any, ...]
    crash: ReportedCrash | None
    endings: tuple[Collision | None, ...]
    runs: tuple[PageDrive, ...]  # without tracks
    attack: AttackRecord | None
    network: str
    of_sumo: bool

    @property
    def id(self) -> str:
        """The id of the case."""
        return self.row["id"]


def network(scenario: Scenario) -> str:
    """The name of the network or log of a case."""
    return scenario.provenance.file.removesuffix(".sumocfg") or scenario.provenance.source


def _plain(hit: Collision | None) -> dict[str, Any] | None:
    if hit is None:
        return None
    return {
        "agent": hit.agent,
        "step": hit.step,
        "collision_type": _sentence(COLLISION_TYPES[hit.collision_type]),
        "impact": round(hit.relative_speed, 2),
        "adversary": hit.attributed,
    }


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:]


def _marks(scene: PicturedCase, origin: Float[np.ndarray, " 2"]) -> list[dict[str, Any]]:
    """What is marked on the road, in metres from `origin`."""
    return [
        {
            "kind": mark.kind,
            "step": mark.step,
            "x": round(mark.pose[0] - float(origin[0]), 2),
            "y": round(mark.pose[1] - float(origin[1]), 2),
            "yaw": round(mark.pose[2], 3),
            "width": float(mark.width),
            "colour": "evasion" if mark.of_evasion else "adversary" if mark.agent else "ego",
            "words": mark_words(scene, mark),
        }
        for mark in scene.marks
    ]


def _thought(debug: Debug, origin: Float[np.ndarray, " 2"]) -> dict[str, Any]:
    return {
        "candidates": [line(path, origin) for path in debug.candidates],
        "costs": list(debug.costs),
        "chosen": None if debug.chosen is None else line(debug.chosen, origin),
        "predictions": [line(path, origin) for path in debug.predictions],
        "text": debug.text,
    }


def _settings(attack: AttackRecord) -> dict[str, Any]:
    """The settings of an attack, with the fields that say how the vehicles move and who else was attacked."""
    moves = {"dynamics": attack.dynamics} if attack.dynamics else {}
    names = {"against": attack.against, "crashed": attack.crashed, "promised": attack.promised}
    return attack.settings | moves | {name: ", ".join(some) for name, some in names.items() if some}


def _costs(case: Scenario) -> dict[str, Any]:
    """The terms of the cost over the iterations, thinned out; the last iteration is kept."""
    history = {name: values for name, values in case.attack.cost_history.items() if values} if case.attack else {}
    length = max(map(len, history.values()), default=0)
    kept = np.unique(np.linspace(0, length - 1, min(length, _MOST_COSTS)).astype(int)) if length else np.array([], int)
    terms = {name: [float(f"{values[i]:.4g}") for i in kept if i < len(values)] for name, values in history.items()}
    return {"iterations": kept.tolist(), "terms": terms}


def _judgement(case: Scenario) -> list[tuple[str, str]]:
    """What the crash says about the planner, as rows of the page."""
    judgement = case.judgement
    if judgement is None:
        return []
    # a file may name other flaws
    flaws = "; ".join(flaw.sentence for flaw in judgement.flaws)
    said = [("Telling", telling_words(judgement)), ("As a test", flaws or "clean: nothing spoils it")]
    if (law := judgement.law) is not None:
        said += [
            ("Adversary against the rules", offences_words(law.adversary)),
            ("Ego against the rules", offences_words(law.ego)),
        ]
        said += [("Cannot be told", unknown)] if (unknown := untold_words(law)) else []
    if judgement.death_risk is not None:
        said.append(("Impact", f"{deadly_words(judgement.death_risk)} (Rosén and Sander 2009)"))
    if not judgement.telling and judgement.careful:
        said.append(("Careful driver", prevention_words(judgement)))
    if holds := holds_words(judgement.holds):
        said.append(("Holds", holds))
    if judgement.fault is not None:
        fault = judgement.fault
        said.append(("At fault", f"{fault.at_fault}, by {fault.rule.replace('_', ' ')}: {fault.reason}"))
    return said


def _facts(case: Scenario) -> list[tuple[str, str]]:
    """The origin of the case and of its attack, as rows of the page."""
    source, attack = case.provenance, case.attack
    facts = [
        ("Traffic", f"{source.source}, {source.file}, from {source.begin_s:g} s"),
        ("Checksum", f"sha256 {source.sha256}"),
        ("Seed", str(source.seed)),
        ("Ego", case.ego.id),
        *([("Adversary", attack.collision.agent)] if attack and attack.collision else []),
        ("Road users", f"{len(case.agents)}, over {(case.tracks.steps - 1) * case.dt:.1f} s in steps of {case.dt:g} s"),
    ]
    if attack is not None:
        facts += [
            (
                "Attack",
                f"{attack.method} against {attack.planner}: {OUTCOMES[attack.outcome]}, {attack.iterations} iterations"
                + f", {attack.drives} drives of the planner in the window" * bool(attack.drives),
            ),
            ("Candidates", ", ".join(attack.candidates) or "none"),
        ]
    if source.left_out:
        facts.append(("Left out", "; ".join(sentence_of(one) for one in source.left_out)))
    if source.command:
        facts.append(("Recorded by", source.command))
    return [*facts, ("Versions", ", ".join(f"{name} {number}" for name, number in source.versions.items()))]


def _commands(case: Scenario, drivers: list[str], driven: bool, folder: Path | None) -> list[tuple[str, str]]:
    """Shell commands for watching a case that lies in a `folder`, and for driving it again.

    They contain no text of the case, which may be a stranger's command. If the drives were made for this report
    (`driven`), drivers are named as on the user's own command line.
    """
    if folder is None:
        return []
    place = shlex.quote(str(folder / case.id))
    found = [("Watch it in SUMO", f"regents replay {place} --in sumo --gui")]
    if case.evasion is not None:
        found.append(("Watch the careful driver", f"regents replay {place} --in sumo --gui --ego evasion"))
    names = [name if driven or is_built_in(name) else None for name in drivers]
    again = [
        (f"Drive it again with {name}", f"regents replay {place} --in mirror --planner {shlex.quote(name)}")
        if name
        else ("Drive it with a planner of yours", f"regents replay {place} --in mirror --planner YOUR_PLANNER")
        for name in names
    ]
    return [*again, *found]
