"""How an attack went: what an attacked scenario keeps of it."""

from dataclasses import dataclass, field
from typing import Literal

from regents_cosim.brief import Brief

Outcome = Literal["collision", "no_collision", "no_candidate", "already_colliding", "diverged", "planner_error"]
CollisionKind = Literal[
    "rear_end_by_ego", "rear_end_by_adversary", "side_swipe", "t_bone", "head_on",
    "person_by_front", "person_by_side",
]  # fmt: skip


@dataclass(frozen=True)
class Collision:
    """The first contact of the ego."""

    agent: str  # who the ego hits, or is hit by
    step: int
    time_s: float
    kind: CollisionKind
    relative_speed: float  # [m/s] at the first step of contact
    attributed: bool  # the attack changed the controls of `agent`


@dataclass(frozen=True)
class ActTime:
    """How long a planner outside the mirror took for its decisions: measured, so never twice the same."""

    median_ms: float
    p99_ms: float
    decisions: int


HARMLESS_SHARE = "harmless_share"  # settings of a harmless neighbour: the share of an attack that is left in it
CAREFUL_COMPLETION = "careful_completion"  # and how far a careful driver gets there, a share of the recorded way


@dataclass(frozen=True, repr=False)
class AttackRecord(Brief):
    """The result of an attack on one scenario."""

    case: str  # id of the scenario before the attack
    method: str
    planner: str
    outcome: Outcome
    iterations: int
    collision: Collision | None = None
    candidates: tuple[str, ...] = ()  # agents whose controls the attack was allowed to change
    settings: dict[str, float | int | str | bool] = field(default_factory=dict)
    cost_history: dict[str, tuple[float, ...]] = field(default_factory=dict)  # per term and iteration
    spoilt: bool = False  # it ended without a collision that it accepts, but came across others
    planner_error: str = ""  # how the planner failed, with its own traceback
    act_time: ActTime | None = None
    rollouts: int = 0  # of the traffic, made by all searches on its window together; 0: not counted

    @property
    def careful_completion(self) -> float | None:
        """How far a careful driver gets in a harmless neighbour of a crash; None for every other case."""
        found = self.settings.get(CAREFUL_COMPLETION)
        return float(found) if isinstance(found, int | float) and HARMLESS_SHARE in self.settings else None
