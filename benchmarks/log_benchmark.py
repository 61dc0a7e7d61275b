"""`python -m benchmarks logs`: how well logs of every format are read, and how well the mirror follows them."""

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from benchmarks.reconstruction import reconstruction_row
from regents_cosim.scenario import Scenario
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.inspection import moving_centres, on_road
from regents_cosim.sources.logs.record import origin_of, scenes_of
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.windows import Windows


@dataclass(frozen=True)
class LogRow:
    """The results of one format."""

    format: str
    scenes: int
    agents: int
    windows: int
    on_road_percent: float | None  # centres of moving vehicles on the drivable area
    on_road_on_map_percent: float | None  # of those within 10 m of a mapped lane
    smooth_mean_cm: float | None  # position error of the smooth fit
    smooth_p99_cm: float | None
    read_s: float  # per scene: from the file to its windows


@dataclass
class _Tally:
    """The counts of one format so far."""

    scenes: int = 0
    agents: int = 0
    centres: int = 0
    inside: float = 0.0
    near: int = 0
    near_inside: float = 0.0
    seconds: float = 0.0
    windows: list[Scenario] = field(default_factory=list)


def log_rows(paths: list[Path], count: int = 8, horizon_s: float = 8.0) -> Iterator[LogRow]:
    """A row for each format found at `paths`; up to `count` windows of each scene are fitted."""
    tallies: dict[str, _Tally] = defaultdict(_Tally)
    asked = LogWindows(Windows(count, 0, horizon_s))
    for path in paths:
        begin = time.perf_counter()
        for file, name, scene in scenes_of(path):
            tally = tallies[name]
            found = list(islice(cut(scene, asked, origin_of(file, name, scene), Counter()), count))
            tally.seconds += time.perf_counter() - begin
            tally.scenes += 1
            tally.agents += len(scene.tracks)
            tally.windows += found
            centres, _ = moving_centres(scene)
            _count(tally, len(centres), *on_road(build_road(scene), centres))
            begin = time.perf_counter()
    for name, tally in tallies.items():
        yield _row(name, tally)


def _count(tally: _Tally, centres: int, inside: float | None, near: float | None) -> None:
    if inside is not None:
        tally.centres += centres
        tally.inside += inside * centres
    if near is not None:
        tally.near += centres
        tally.near_inside += near * centres


def _row(name: str, tally: _Tally) -> LogRow:
    fit = reconstruction_row(name, tally.windows) if tally.windows else None
    return LogRow(
        format=name,
        scenes=tally.scenes,
        agents=tally.agents,
        windows=len(tally.windows),
        on_road_percent=_percent(tally.inside, tally.centres),
        on_road_on_map_percent=_percent(tally.near_inside, tally.near),
        smooth_mean_cm=round(fit.smooth_mean_cm, 2) if fit else None,
        smooth_p99_cm=round(fit.smooth_p99_cm, 2) if fit else None,
        read_s=round(tally.seconds / tally.scenes, 3),
    )


def _percent(part: float, whole: int) -> float | None:
    return round(100.0 * part / whole, 2) if whole else None
