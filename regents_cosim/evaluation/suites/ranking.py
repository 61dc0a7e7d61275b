"""Ranks planners on one suite, in the order in which they are named, each compared with the one before."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from regents_cosim.evaluation.drives.crash_verdict import CrashCounts
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.evaluation.statistics import mcnemar, percent, percent_interval
from regents_cosim.system.data_frames import Rows


@dataclass(frozen=True)
class RankRow:
    """The result of one planner on all cases of a suite; a case in which it fails counts as a crash."""

    planner: str
    n: int
    crashes: int
    crash_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    telling_crashes: int
    flawless_crashes: int  # telling ones whose adversary keeps every rule
    ego_at_fault: int  # crashes for which the planner is to blame, alone or with the other
    other_at_fault: int  # crashes for which the other alone is to blame
    rear_ended: int  # no crashes: a follower that replays its log drives into the ego's rear
    ordinary_crashes: int  # without an attack, also in the harmless neighbours of crashes
    ordinary_completion_percent: float | None  # route completion without an attack; None if no case is
    harmless_crashes: int  # in the harmless neighbours of crashes
    held_up: int  # harmless neighbours in which it gets less than 80 % as far as a careful driver
    failed: int  # cases with a crash, or in which it is held up
    only_this: int | None = None  # cases in which it crashes and the planner before it does not
    only_before: int | None = None  # cases in which the planner before it crashes and it does not
    p_value: float | None = None  # of the hypothesis that both crash equally often (McNemar, exact)


def rank_rows(driven: Sequence[tuple[str, Sequence[DriveResult]]]) -> Rows[RankRow]:
    """A row for each planner and its drives of the same cases, compared with the planner before."""
    rows = Rows[RankRow]()
    before: list[bool] | None = None
    for planner, drives in driven:
        hits = [drive.collision or bool(drive.error) for drive in drives]
        rows.append(_row(planner, drives, hits, before))
        before = hits
    return rows


def _row(planner: str, drives: Sequence[DriveResult], hits: list[bool], before: list[bool] | None) -> RankRow:
    pairs = list(zip(hits, before, strict=True)) if before is not None else None
    counts = CrashCounts.of(drive.end for drive in drives)
    crashes = counts.crashes + counts.failed
    harmless = [drive.careful_completion is not None for drive in drives]
    blame = [drive.verdict.blame for drive in drives if drive.verdict]
    ordinary = [drive.completion for drive in drives if drive.ordinary]
    return RankRow(
        planner=planner,
        n=len(drives),
        crashes=crashes,
        crash_percent=percent(crashes, len(drives)),
        interval_percent=percent_interval(crashes, len(drives)),
        telling_crashes=counts.telling,
        flawless_crashes=counts.flawless,
        ego_at_fault=blame.count(0),
        other_at_fault=blame.count(2),
        rear_ended=sum(drive.rear_ended for drive in drives),
        ordinary_crashes=counts.ordinary,
        ordinary_completion_percent=round(100.0 * fmean(ordinary), 1) if ordinary else None,
        harmless_crashes=sum(hit and calm for hit, calm in zip(hits, harmless, strict=True)),
        held_up=sum(drive.held_up for drive in drives),
        failed=sum(hit or drive.held_up for hit, drive in zip(hits, drives, strict=True)),
        only_this=sum(now and not was for now, was in pairs) if pairs is not None else None,
        only_before=sum(was and not now for now, was in pairs) if pairs is not None else None,
        p_value=float(f"{mcnemar(hits, before):.3g}") if before is not None else None,
    )
