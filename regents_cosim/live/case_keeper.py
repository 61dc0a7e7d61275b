"""Keeps live attacks of interest as ordinary, judged cases, in a folder or in memory."""

from pathlib import Path

from regents_cosim.attack_record import Outcome
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.live.attacker import Attack
from regents_cosim.live.case import AttackSummary, case_of
from regents_cosim.live.host.frame import Frame
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.settings import LiveSettings
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario import Scenario
from regents_cosim.sources.windows import RecordingOrigin
from regents_cosim.verdicts.judge import judge

TAIL_S = 2.0  # time after the contact in a case
_NEAR_MISS_M = 2.0


class CaseKeeper:
    """Saves cases to `output`, or collects them in `cases` if there is none."""

    def __init__(self, settings: LiveSettings, planner: str, config: AttackConfig, output: Path | None) -> None:
        self._settings, self._planner, self._config = settings, planner, config
        self._writer = SuiteWriter(output, settings.seed) if output is not None else None
        self.cases: list[Scenario] = []

    def wants(self, attack: Attack, outcome: Outcome) -> bool:
        """Whether an attack with this outcome is kept."""
        near = self._settings.keep == "near-misses" and attack.closest_m < _NEAR_MISS_M
        return outcome == "collision" or near

    def keep(
        self,
        frames: list[Frame],
        step_s: float,
        road: RoadMap,
        source: RecordingOrigin,
        attack: Attack,
        outcome: Outcome,
        after: Forecast,
    ) -> str:
        """Keep the case of some frames, and return its id. For a crash, the forecast `after` is appended."""
        summary = AttackSummary(
            attack.plan.adversary, self._planner, self._config, outcome, attack.iterations, attack.rollouts,
            self._settings.replan_s, source, self._settings.seed,
        )  # fmt: skip
        case = case_of(frames, step_s, road, summary, attack.before, after, TAIL_S if outcome == "collision" else 0.0)
        if self._settings.judged:
            case = judge(case)
        if self._writer is None:
            self.cases.append(case)
        else:
            self._writer.add(case)
        return case.id
