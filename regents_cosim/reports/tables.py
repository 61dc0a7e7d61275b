"""Rows of the tables on the terminal: one per case, with plain values that JSON can hold."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import timedelta
from statistics import fmean
from typing import Any

import numpy as np

from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import NAMED_ONLY, NETWORKS, SUITES, WITH_PERSONS, suite_folder
from regents_cosim.evaluation.drives.crash_verdict import CrashCounts, end_of_case
from regents_cosim.evaluation.drives.driving import COLUMNS
from regents_cosim.replays.verify import Replay
from regents_cosim.runs.behaviour_map import AXES, Archive, Standing
from regents_cosim.runs.status import RunStatus
from regents_cosim.scenario.judgement import Holds
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.logs.inspection import Inspection

# The columns of each table that a narrow terminal shows first.
RECORDED = ("case", "ego_kind", "ego_length_m", "agents", "overlaps")
INSPECTED = ("scenario", "format", "duration_s", "ego", "overlaps", "off_road_percent")
ATTACKED = ("case", "when_s", "adversary", "collision_type", "telling", "flawless")
ATTACKED_IN_VAIN = ("case", "why", *ATTACKED[1:])  # for windows without a crash
REPLAYED = ("case", "verified", "found")
LIVED = ("seed", "ego", "ended", "after_s", "telling", "flawless", "SUMO_verified")
DRIVEN = ("source", "n", *(column.name for column in COLUMNS if column.essential))
COMPARED = ("case", "verdict", "now")
RANKED = (
    "planner", "n", "crashes", "telling_crashes", "flawless_crashes", "crash_percent", "ego_at_fault", "rear_ended",
    "ordinary_completion_percent", "held_up", "only_this", "only_before", "p_value",
)  # fmt: skip
LISTED = ("case", "collision_type", "tags", "telling", "flawless", "clean", "prevention")
COVERED = ("case", "standing", "quality")
CHECKED = ("case", "problem")
STATUS = ("state", "done", "failed", "left", "time_left")
JUDGED = ("case", "telling", "flawless", "before", "prevention", "conduct")
TRANSFERRED = ("place", "cases", "crashes", "same_crash", "same_crash_percent", "interval_percent")
CROSSED = ("adversaries_of", "planner", "n", "crashes", "crash_percent", "interval_percent")
SCORED = ("score", "driver", "value")


def shipped_rows() -> list[dict[str, Any]]:
    """The suites and networks that come with the package, by the names that commands accept."""
    suites = [(name, f"suite of {len(find_cases(suite_folder(name)))} cases") for name in SUITES]
    networks = [(name, "SUMO network with traffic") for name in NETWORKS + NAMED_ONLY]
    networks += [(name, "SUMO network with traffic, pedestrians and cyclists") for name in WITH_PERSONS]
    return [{"name": f"shipped:{name}", "what": what} for name, what in (*suites, *networks)]


def case_row(scenario: Scenario) -> dict[str, Any]:
    """The row of a recorded case."""
    return {
        "case": scenario.id,
        "ego": scenario.ego.id,
        "ego_kind": scenario.ego.kind,
        "ego_length_m": scenario.ego.length,
        "agents": len(scenario.agents),
        "begin_s": scenario.provenance.begin_s,
        "horizon_s": round((scenario.tracks.steps - 1) * scenario.dt, 6),
        "overlaps": len(scenario.overlaps),
    }


_INSPECTED = (
    "scenario", "format", "agents", "duration_s", "dt_s", "ego", "map", "mean_m_s", "max_m_s", "overlaps",
    "off_road_percent", "off_road_on_map_percent",
)  # fmt: skip


def inspection_row(found: Inspection) -> dict[str, Any]:
    """The row of a scene of a log, with columns that fit a terminal."""
    row = vars(found) | {
        "agents": found.kinds,
        "map": f"{found.lanes} lanes, {found.edges} kerbs, {found.areas} areas, {found.signals} lights",
    }
    return {name: row[name] for name in _INSPECTED}


def inspection_notes(found: Sequence[Inspection]) -> str:
    """The assumptions of readers, with the number of scenes or the name of the one."""
    about: dict[str, list[str]] = {}
    for one in found:
        for note in one.notes:
            about.setdefault(note, []).append(one.scenario)
    return "\n".join(f"{s[0] if len(s) == 1 else f'{len(s)} scenarios'}: {note}" for note, s in about.items())


_GRADES = ("telling", "flawless", "prevention", "conduct", "clean")


def attack_row(scenario: Header | Scenario, replay: Replay | None, why: str | None = None) -> dict[str, Any]:
    """The row of an attacked case, with its replay in SUMO if there was one, and why it holds no crash."""
    record = scenario.attack
    hit = record.collision if record else None
    judged = scenario.judgement
    return {
        "case": scenario.id,
        "outcome": record.outcome if record else None,
        "why": "planner_failed" if record and record.outcome == "planner_error" else why,
        "iterations": record.iterations if record else None,
        "drives": record.drives if record else None,
        "when_s": hit.time_s if hit else None,
        "adversary": hit.agent if hit else None,
        "collision_step": hit.step if hit else None,
        "collision_type": hit.collision_type if hit else None,
        "impact_m_s": round(hit.relative_speed, 2) if hit else None,
        "attributed": hit.attributed if hit else None,
        **{grade: getattr(judged, grade, None) for grade in _GRADES},
        "offences": ", ".join(offence.name for offence in judged.law.adversary) if judged and judged.law else None,
        "usual_percent": judged.usual if judged else None,
        "SUMO_verified": replay.verified if replay else None,
        **{f"holds_{how}": holds for how, holds in asdict(judged.holds if judged else Holds()).items()},
    }


def status_row(status: RunStatus) -> dict[str, Any]:
    """The row on a run's progress; the remaining time in hours, minutes and seconds."""
    shown = ("state", "command", "shard", "units", "done", "failed", "left", "per_hour")
    time_left = None if status.left_s is None else str(timedelta(seconds=round(status.left_s)))
    return {name: getattr(status, name) for name in shown} | {"time_left": time_left}


def judged_row(before: Scenario, after: Scenario) -> dict[str, Any]:
    """The row of a crash that was judged again; `before` tells whether it was telling by its older judgement."""
    row = attack_row(after, None)
    shown = ("case", "collision_type", *_GRADES, "offences", "usual_percent")
    was = before.judgement.telling if before.judgement else None
    return {**{name: row[name] for name in shown}, "before": was}


_LETTERS: dict[Standing, str] = {"flawless": "F", "telling": "T", "preventable": "P", "clean": "C", "crash": "x"}


def coverage_map(archive: Archive) -> str:
    """The map of behaviours in letters, the manoeuvres down, the closing speeds across, the departures in each."""
    manoeuvres, speeds, departures = (axis.labels for axis in AXES)
    elites = archive.elites

    def letters(manoeuvre: str, speed: str) -> str:
        cells = [(manoeuvre, speed, departure) for departure in departures]
        return "".join(_LETTERS[elites[cell].standing] if cell in elites else "." for cell in cells)

    room, wide = max(map(len, manoeuvres)), len(departures) + 2
    lines = [f"{'':{room}}  " + "".join(f"{speed:{wide}}" for speed in speeds)]
    lines += [f"{one:{room}}  " + "".join(f"{letters(one, speed):{wide}}" for speed in speeds) for one in manoeuvres]
    lines += [f"in each: {AXES[-1].name} {', '.join(departures)}"]
    lines += ["F flawless, T telling, P preventable, C clean, x other, . empty"]
    return "\n".join(line.rstrip() for line in lines)


def summary(attacked: Sequence[Header | Scenario], replays: Mapping[str, Replay]) -> str:
    """The number of crashes, of telling ones, and of those that SUMO confirms.

    It also says for how many it is unknown whether they are telling, and how often the planner drove where that is
    counted.
    """
    said = str(CrashCounts.of(map(end_of_case, attacked)))
    said += f", {sum(r.verified for r in replays.values())} verified in SUMO" if replays else ""
    drives = {case.attack.case: case.attack.drives for case in attacked if case.attack}
    return f"{said}; the planner drove {fmean(drives.values()):.0f} times a window" if any(drives.values()) else said


def replay_row(replay: Replay, in_words: bool = False) -> dict[str, Any]:
    """The row of a replayed case; errors are the largest over all scripted agents and steps.

    `in_words`: the table says that there is no collision; in JSON it is null.

    The simulator's own list of collisions is a second opinion: whether it contains the expected pair, and its length.
    """
    none = "no collision" if in_words and replay.replayed else None
    return {
        "case": replay.case,
        "verified": replay.verified,
        "expected": _contact(replay.expected) or none,
        "found": _contact(replay.found) or none,
        "position_error_mm": _worst(replay.position_error_m, 1e3),
        "yaw_error_deg": _worst(replay.yaw_error_deg, 1.0),
        "own_list_has_it": replay.reports_same_pair if replay.expected else None,
        "own_list_pairs": len({frozenset((hit.collider, hit.victim)) for hit in replay.own_collisions}),
    }


def replay_summary(replays: Sequence[Replay], evaded: bool) -> str:
    """The number of replays that end as they should, and what that means where a careful driver drives the ego."""
    good = sum(replay.verified for replay in replays)
    return f"{good} of {len(replays)} {'without a collision, as the evasion promises' if evaded else 'as expected'}"


def traffic_row(replay: Replay) -> dict[str, Any]:
    """The row of a case replayed in live traffic: agents that the simulator drove, and the shift of the collision."""
    steps = None
    if replay.found and replay.expected and replay.shift_m is not None:
        steps = replay.found[1] - replay.expected[1]
    return {
        "driven": len(replay.driven),
        "unmatched": len(replay.unmatched),
        "steps_later": steps,
        "shift_m": replay.shift_m,
    }


def _contact(contact: tuple[str, int] | None) -> str | None:
    return f"{contact[0]} at step {contact[1]}" if contact else None


def _worst(errors: np.ndarray | None, factor: float) -> float | None:
    return None if errors is None else factor * float(errors.max(initial=0.0))
