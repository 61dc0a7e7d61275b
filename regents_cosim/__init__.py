"""A crash-test bench for driving planners that lives inside SUMO and highway-env.

Importing it loads neither JAX nor libsumo: every name below is loaded when it is first used.
"""

from __future__ import annotations

__version__: str
TYPE_CHECKING = False  # for type checkers; importing `typing` would delay the moment from which Ctrl-C is handled
if TYPE_CHECKING:
    from typing import Any

    from regents_cosim.attacks.attack import attack as attack
    from regents_cosim.attacks.methods.presets import KING as KING
    from regents_cosim.attacks.methods.presets import REGENTS as REGENTS
    from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED as REGENTS_FOCUSED
    from regents_cosim.attacks.methods.presets import AttackConfig as AttackConfig
    from regents_cosim.cases.files import load_case as load_case
    from regents_cosim.cases.shipped import network_config as network_config
    from regents_cosim.cases.shipped import networks as networks
    from regents_cosim.cases.suite import load_suite as load_suite
    from regents_cosim.errors import RegentsError as RegentsError
    from regents_cosim.evaluation.regression.evaluate import evaluate as evaluate
    from regents_cosim.evaluation.suites.building import Recipe as Recipe
    from regents_cosim.evaluation.suites.building import build_suite as build_suite
    from regents_cosim.exports.export import export as export
    from regents_cosim.mirror.bicycle import ControlArrays as ControlArrays
    from regents_cosim.mirror.bicycle import Motion as Motion
    from regents_cosim.planners.interface import AgentState as AgentState
    from regents_cosim.planners.interface import Control as Control
    from regents_cosim.planners.interface import Debug as Debug
    from regents_cosim.planners.interface import Observation as Observation
    from regents_cosim.planners.interface import Planner as Planner
    from regents_cosim.planners.interface import Scene as Scene
    from regents_cosim.planners.interface import Waypoints as Waypoints
    from regents_cosim.planners.jax_planner import CompiledScene as CompiledScene
    from regents_cosim.planners.jax_planner import JaxPlanner as JaxPlanner
    from regents_cosim.planners.under_test import PlannerUnderTest as PlannerUnderTest
    from regents_cosim.replays.replay import replay as replay
    from regents_cosim.reports.report import report as report
    from regents_cosim.saving import save_case as save_case
    from regents_cosim.scenario.scenario import Scenario as Scenario
    from regents_cosim.simulators.sumo.config import SumoInput as SumoInput
    from regents_cosim.sources.record import LogInput as LogInput
    from regents_cosim.sources.record import record as record
    from regents_cosim.training.fine_tuning import finetune as finetune
    from regents_cosim.training.fine_tuning import train as train
    from regents_cosim.training.lessons.train_config import TrainConfig as TrainConfig
    from regents_cosim.verdicts.judge import judge as judge

_NAMES = {
    "attacks.attack": "attack",
    "attacks.methods.presets": "AttackConfig KING REGENTS REGENTS_FOCUSED",
    "cases.files": "load_case",
    "cases.shipped": "network_config networks",
    "cases.suite": "load_suite",
    "errors": "RegentsError",
    "evaluation.regression.evaluate": "evaluate",
    "evaluation.suites.building": "Recipe build_suite",
    "exports.export": "export",
    "mirror.bicycle": "ControlArrays Motion",
    "planners.interface": "AgentState Control Debug Observation Planner Scene Waypoints",
    "planners.jax_planner": "JaxPlanner CompiledScene",
    "planners.under_test": "PlannerUnderTest",
    "replays.replay": "replay",
    "reports.report": "report",
    "saving": "save_case",
    "scenario.scenario": "Scenario",
    "sources.record": "LogInput record",
    "simulators.sumo.config": "SumoInput",
    "training.fine_tuning": "finetune train",
    "training.lessons.train_config": "TrainConfig",
    "verdicts.judge": "judge",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value  # a subpackage of the same name must not win the next look-up
    return value
