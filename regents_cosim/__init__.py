"""A crash-test bench for driving planners that lives inside SUMO and highway-env.

Importing it loads neither JAX nor libsumo: every name below is loaded when it is first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes a while to import, before Ctrl-C is seen to
if TYPE_CHECKING:
    from typing import Any

    from regents_cosim.attacks.attack import attack as attack
    from regents_cosim.attacks.presets import KING as KING
    from regents_cosim.attacks.presets import REGENTS as REGENTS
    from regents_cosim.attacks.presets import REGENTS_FOCUSED as REGENTS_FOCUSED
    from regents_cosim.attacks.presets import AttackConfig as AttackConfig
    from regents_cosim.cases.files import load_case as load_case
    from regents_cosim.cases.files import save_case as save_case
    from regents_cosim.cases.shipped import network_config as network_config
    from regents_cosim.mirror.bicycle import Controls as Controls
    from regents_cosim.planners.interface import Control as Control
    from regents_cosim.planners.interface import Observation as Observation
    from regents_cosim.planners.interface import Planner as Planner
    from regents_cosim.planners.interface import Waypoints as Waypoints
    from regents_cosim.planners.jax_planner import JaxPlanner as JaxPlanner
    from regents_cosim.replays.replay import replay as replay
    from regents_cosim.reports.report import report as report
    from regents_cosim.scenario import Scenario as Scenario
    from regents_cosim.sources.logs.formats import LogFormat as LogFormat
    from regents_cosim.sources.logs.record import record_log as record_log
    from regents_cosim.sources.logs.scene import LoggedScene as LoggedScene
    from regents_cosim.sources.record import record as record
    from regents_cosim.sources.sumo_config import SumoInput as SumoInput

_HOMES = {
    "Waypoints": "planners.interface",
    "Planner": "planners.interface",
    "Observation": "planners.interface",
    "Control": "planners.interface",
    "AttackConfig": "attacks.presets",
    "Controls": "mirror.bicycle",
    "JaxPlanner": "planners.jax_planner",
    "KING": "attacks.presets",
    "LogFormat": "sources.logs.formats",
    "LoggedScene": "sources.logs.scene",
    "REGENTS": "attacks.presets",
    "REGENTS_FOCUSED": "attacks.presets",
    "Scenario": "scenario",
    "SumoInput": "sources.sumo_config",
    "attack": "attacks.attack",
    "load_case": "cases.files",
    "network_config": "cases.shipped",
    "record": "sources.record",
    "record_log": "sources.logs.record",
    "replay": "replays.replay",
    "report": "reports.report",
    "save_case": "cases.files",
}
__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value  # a subpackage of the same name must not win the next look-up
    return value
