"""The metrics of a drive, each declared once: as a field of `DriveScores`.

From its declaration follow its value for every drive, its columns in the table over drives, its score in the report,
what `--fail-on` compares, and its row in the documentation. This module does not import JAX.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf
from statistics import fmean
from typing import Any, Literal

import numpy as np

from regents_cosim.evaluation.drives.ego_drive import EgoDrive, share_of_way
from regents_cosim.evaluation.statistics import mean_interval, wilson
from regents_cosim.short_repr import ShortRepr

Better = Literal["more", "less"]
Measure = Callable[[EgoDrive], float | None]  # None: nothing to measure


@dataclass(frozen=True)
class Column:
    """A column of the table over drives, and the score that the report makes of it."""

    name: str
    of: Callable[[Sequence[Any]], Any]  # of a metric's known values, if there are any; or of drives
    meaning: str = ""  # where it is of drives
    label: str = ""  # name of its score in the report; empty: it is none
    detail: str = ""  # small print of the score, with columns in braces; `cases`: their number
    text: str = "{}"  # value of the score
    interval: str = ""  # column of its interval, if it is a share in percent
    essential: bool = False  # a narrow terminal shows it, too
    unknown: Any = None  # what it is where no value is known


@dataclass(frozen=True)
class Metric:
    """What a metric means, and how it is measured, compared and averaged."""

    better: Better
    unit: str
    meaning: str
    measure: Measure
    columns: tuple[Column, ...]
    undefined: float = 0.0  # what it is compared as where there is nothing to measure
    event: bool = False  # whether `--fail-on` may forbid that it is more than zero
    name: str | None = ""  # in baselines and `--fail-on`, by default that of the field; None: it is not compared
    field: str = ""  # of `DriveResult`


def percent(name: str, **shown: Any) -> Column:
    """The mean of a share in percent."""
    return Column(name, lambda values: round(100.0 * fmean(values), 1), **shown)


def percentile(name: str, part: int, **shown: Any) -> Column:
    """A percentile. Near the worst: the median of ordinary traffic says little, and the worst is a single drive."""
    return Column(name, lambda values: round(float(np.percentile(values, part)), 2), **shown)


def share(name: str, of: str, label: str, detail: str, interval: Callable[..., tuple[float, float]]) -> list[Column]:
    """The mean of a share in percent with its 95 % interval, as a score of the report."""
    ends = Column(
        f"{of}_interval_percent", lambda v: tuple(round(100.0 * min(max(end, 0.0), 1.0), 1) for end in interval(v))
    )
    return [percent(name, label=label, detail=detail, text="{:.0f} %", interval=ends.name, essential=True), ends]


def metric(better: Better, unit: str, meaning: str, measure: Measure, *columns: Column, **more: Any) -> Any:
    """Declare a field as a metric (see `Metric`); it has the value `failed` where the planner fails."""
    failed = more.pop("failed", None)
    said = Metric(better, unit, meaning, measure, columns, **more)
    return field(default=failed, kw_only=True, metadata={"metric": said})


@dataclass(frozen=True, repr=False)
class DriveScores(ShortRepr):
    """The metrics of the drive of one case."""

    case: str
    source: str  # file that the traffic came from
    score: float = metric(
        "more", "", "driving score: completion times infraction", lambda drive: drive.completion * drive.infraction,
        *share("driving_score_percent", "driving", "Driving score", "mean of {n}", mean_interval),
        failed=0.0, undefined=1.0,
    )  # fmt: skip
    completion: float = metric(
        "more", "", "share of the recorded way, up to the first collision", lambda drive: drive.completion,
        *share("route_completion_percent", "completion", "Route completion", "mean of {n}", mean_interval),
        failed=0.0, undefined=1.0, name="route_completion",
    )  # fmt: skip
    infraction: float = metric(
        "more", "", "product of penalties: collision, red lights, off the road", lambda drive: drive.infraction,
        Column("infraction_score", lambda values: round(fmean(values), 3)), failed=1.0, name=None,
    )  # fmt: skip
    off_road: float = metric(
        "less", "", "share of the driven distance", lambda drive: share_of_way(drive.way, drive.off_road),
        percent("off_road_percent"), failed=0.0, event=True,
    )  # fmt: skip
    against_direction: float | None = metric(
        "less", "", "share of the driven distance in lanes of the other direction, where lanes are known",
        lambda drive: None if (those := drive.against_direction) is None else share_of_way(drive.way, those),
        percent("against_direction_percent"), event=True,
    )  # fmt: skip
    red_lights: int | None = metric(
        "less", "", "number that the ego runs, where lights are known", lambda drive: drive.red_lights,
        Column("red_lights", sum, "", "Red lights run", "in {red_light_cases} of {cases}", essential=True, unknown=0),
        Column("red_light_cases", lambda values: sum(map(bool, values)), unknown=0),
        Column("lights_known", len, unknown=0), event=True,
    )  # fmt: skip
    min_ttc_s: float | None = metric(
        "more", "s", "least time to collision, 0 after contact", lambda drive: drive.safety.min_ttc_s,
        percentile("min_ttc_p5_s", 5), undefined=inf,
    )  # fmt: skip
    min_pet_s: float | None = metric(
        "more", "s", "least post-encroachment time, 0 after contact", lambda drive: drive.safety.min_pet_s,
        percentile("min_pet_p5_s", 5), undefined=inf,
    )  # fmt: skip
    max_drac_m_s2: float | None = metric(
        "less", "m/s²", "greatest deceleration that avoids a crash", lambda drive: drive.safety.max_drac_m_s2,
        percentile("max_drac_p95_m_s2", 95),
    )  # fmt: skip
    min_gap_m: float | None = metric(
        "more", "m", "least distance to another road user", lambda drive: drive.safety.min_gap_m, undefined=inf
    )


_STORED = [replace(one.metadata["metric"], field=one.name) for one in fields(DriveScores) if one.metadata]
_COLLISION = Metric(
    "less", "", "1 where the ego collides", lambda drive: drive.collides,
    (Column("collisions", sum, essential=True),
     *share("collision_rate_percent", "collision", "Collision rate", "{collisions} of {cases}",
            lambda hits: wilson(sum(hits), len(hits)))), event=True, field="collision",
)  # fmt: skip
METRICS = (_COLLISION, *_STORED)
COMPARED = {one.name or one.field: one for one in METRICS if one.name is not None}  # by name in `--fail-on`


def measured(drive: EgoDrive) -> dict[str, Any]:
    """The values of the metrics that `DriveScores` stores."""
    return {one.field: one.measure(drive) for one in _STORED}
