"""Whether crashes survive the transfer into a simulator, and how exactly tracks are reproduced there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.evaluation.statistics import wilson
from regents_cosim.replays.replay import Mode, Simulator, replay_each
from regents_cosim.replays.verify import Replay
from regents_cosim.scenario import Scenario

_PLACES: tuple[tuple[str, Simulator, Mode], ...] = (
    ("SUMO", "sumo", "track"),
    ("highway-env, track", "highway", "track"),
    ("highway-env, actions", "highway", "actions"),
)


@dataclass(frozen=True)
class TransferRow:
    """A suite in one simulator; errors are the largest over all cases, agents and steps."""

    simulator: str
    cases: int
    crashes: int
    same_crash: int  # of the crashes: the same agent at the same step, by our boxes
    same_crash_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    invented: int  # cases without a crash that have one in the simulator
    same_agent: int  # of the crashes: the same agent, at whatever step
    own_list: int  # of the crashes: the simulator itself says so
    position_error_mm: float
    yaw_error_deg: float


@dataclass(frozen=True)
class HighwayRow:
    """Attacks on the traffic of one environment of highway-env, and their transfer back into it."""

    environment: str
    method: str
    ego: str
    n: int  # windows without a collision before the attack
    successes: int
    success_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    track_same: int  # of the crashes: the same agent at the same step, on tracks
    track_error_mm: float
    actions_same: int  # the same by highway-env's own physics
    actions_error_mm: float
    crashed_flags: int  # of the crashes: highway-env says `crashed` of the same pair


def transfer_rows(cases: Sequence[Scenario]) -> list[TransferRow]:
    """One row for every simulator that can replay all of `cases`."""
    places = [place for place in _PLACES if place[1] != "sumo" or all(case.road.sumo_net for case in cases)]
    return [_transfer_row(name, cases, list(replay_each(cases, where, mode=mode))) for name, where, mode in places]


def highway_row(environment: str, config: AttackConfig, ego: str, attacked: Sequence[Scenario]) -> HighwayRow:
    """Scores of an attack on windows of `environment`."""
    judged = [s for s in attacked if s.attack and s.attack.outcome != "already_colliding"]
    crashes = [s for s in judged if s.attack and s.attack.outcome == "collision"]
    won = len({s.attack.case for s in crashes if s.attack})
    n = len({s.attack.case for s in judged if s.attack})
    track, actions = (
        _transfer_row(mode, crashes, list(replay_each(crashes, "highway", mode=mode))) for mode in ("track", "actions")
    )
    return HighwayRow(
        environment=environment,
        method=config.method,
        ego=ego,
        n=n,
        successes=won,
        success_percent=_percent(won, n),
        interval_percent=_interval(won, n),
        track_same=track.same_crash,
        track_error_mm=track.position_error_mm,
        actions_same=actions.same_crash,
        actions_error_mm=actions.position_error_mm,
        crashed_flags=track.own_list,
    )


def _transfer_row(name: str, cases: Sequence[Scenario], replays: Sequence[Replay]) -> TransferRow:
    crashes = [replay for replay in replays if replay.expected is not None]
    same = sum(replay.found == replay.expected for replay in crashes)
    return TransferRow(
        simulator=name,
        cases=len(cases),
        crashes=len(crashes),
        same_crash=same,
        same_crash_percent=_percent(same, len(crashes)),
        interval_percent=_interval(same, len(crashes)),
        invented=sum(replay.expected is None and replay.found is not None for replay in replays),
        same_agent=sum(bool(r.found and r.expected and r.found[0] == r.expected[0]) for r in crashes),
        own_list=sum(replay.reports_same_pair for replay in crashes),
        position_error_mm=max((_worst(replay.position_error_m) for replay in replays), default=0.0) * 1e3,
        yaw_error_deg=max((_worst(replay.yaw_error_deg) for replay in replays), default=0.0),
    )


def _worst(errors: Float[np.ndarray, "agent time"] | None) -> float:
    return 0.0 if errors is None else float(errors.max(initial=0.0))


def _interval(part: int, whole: int) -> tuple[float, float]:
    low, high = wilson(part, whole)
    return round(100.0 * low, 1), round(100.0 * high, 1)


def _percent(part: int, whole: int) -> float:
    return round(100.0 * part / whole, 1) if whole else 0.0
