"""The record of an attack that an attacked scenario keeps."""

from dataclasses import dataclass, field
from typing import Literal

from regents_cosim.short_repr import ShortRepr

Outcome = Literal["collision", "no_collision", "no_candidate", "already_colliding", "diverged", "planner_error"]
Dynamics = Literal["bicycle", "highway"]  # how controls move a vehicle: the mirror's own model, or highway-env's
CollisionType = Literal[
    "rear_end_by_ego", "rear_end_by_adversary", "side_swipe", "t_bone", "head_on",
    "person_by_front", "person_by_side",
]  # fmt: skip


@dataclass(frozen=True)
class Collision:
    """The first contact of the ego with another road user."""

    agent: str  # id of the road user that the ego touches
    step: int
    time_s: float
    collision_type: CollisionType
    relative_speed: float  # [m/s] at the first step of contact
    attributed: bool  # the attack changed the controls of `agent`


@dataclass(frozen=True)
class ActTime:
    """The time that a planner outside the mirror took for its decisions; a measured time differs from run to run."""

    median_ms: float
    p99_ms: float
    decisions: int


# key in `settings` of a harmless neighbour: the share of the attack that is left in it
HARMLESS_SHARE = "harmless_share"
# key in `settings`: how far a careful driver gets there, as a share of the recorded way
CAREFUL_COMPLETION = "careful_completion"


@dataclass(frozen=True, repr=False)
class AttackRecord(ShortRepr):
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
    spoilt: bool = False  # the search ended without an acceptable collision, but came across others
    planner_error: str = ""  # the planner's failure, with its own traceback
    act_time: ActTime | None = None
    rollouts: int = 0  # rollouts of the traffic by all searches on this window together; 0: not counted
    drives: int = 0  # those that the planner made for them, where it drives in some of them alone; 0: in all
    against: tuple[str, ...] = ()  # only in cases of older versions: planners attacked beside `planner`
    crashed: tuple[str, ...] | None = None  # likewise: of these and `planner`, those that crash
    promised: tuple[str, ...] | None = None  # manoeuvres asked for that drives in the window lead to; None: not known
    dynamics: Dynamics | None = None  # the model that the controls belong to; None: not known, so a bicycle

    @property
    def crash(self) -> Collision | None:
        """The collision in which the attack ended; None where it ended otherwise."""
        return self.collision if self.outcome == "collision" else None

    @property
    def careful_completion(self) -> float | None:
        """How far a careful driver gets in a harmless neighbour of a crash, from 0 to 1; None for every other case."""
        found = self.settings.get(CAREFUL_COMPLETION)
        return float(found) if isinstance(found, int | float) and HARMLESS_SHARE in self.settings else None
