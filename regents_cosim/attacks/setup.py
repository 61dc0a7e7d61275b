"""The settings that all scenarios of an attack share."""

from dataclasses import dataclass, replace

from regents_cosim.attacks.descent.step import ExtraCost
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.starts.wanted_manoeuvres import DriveManoeuvres
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.scenario.attack_record import Dynamics
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True)
class AttackSetup:
    """How an attack searches, and against which planner."""

    config: AttackConfig
    planner: JaxPlanner | None  # None: not in JAX
    planner_name: str
    extra_cost: ExtraCost | None
    wanted: DriveManoeuvres | None = None  # only such crashes are wanted; None: any

    @property
    def chooses_drives(self) -> bool:
        """Whether searches begin only with drives that may lead to a wanted kind of crash."""
        by_drives = self.config.tries.starts > 0 and self.config.candidates.search == "per-candidate"
        return by_drives and self.wanted is not None and self.wanted.lawful

    def with_due_patience(self) -> "AttackSetup":
        """The setup without `near_m` where no search samples, as distant descents are then the only chance."""
        return self if self.config.tries.samples else replace(self, config=self.config.but(near_m=0.0))

    def dynamics(self, scenario: Scenario) -> Dynamics:
        """The model by which vehicles move in `scenario`."""
        return scenario.dynamics if self.config.traffic.dynamics == "recorded" else self.config.traffic.dynamics
