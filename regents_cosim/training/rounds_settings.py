"""Settings of the rounds of a training against fresh attacks."""

from dataclasses import asdict, dataclass, field

from regents_cosim.attacks.methods.presets import OURS, AttackConfig
from regents_cosim.cases.shipped import NETWORKS
from regents_cosim.checks.ranges import SEED, Range, check_ranges
from regents_cosim.errors import RegentsError, require
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.short_repr import ShortRepr
from regents_cosim.training.lessons.train_config import FINE_TUNING, TrainConfig, require_as_begun

REPLAN_EVERY = 25  # iterations between two drives of the network: attacks end alike, in a fifteenth of the time
ATTACK = OURS.but(replan_every=REPLAN_EVERY)


@dataclass(frozen=True, repr=False)
class Rounds(ShortRepr):
    """Settings: how often, where and how long a planner is attacked, and how it learns from that."""

    rounds: int = 3
    nets: tuple[str, ...] = NETWORKS  # shipped SUMO networks, or .sumocfg files
    windows: int = 24  # windows of each network, in each round
    held_out: int = 24  # windows of each network to judge by at the end
    first_seed: int = 1  # SUMO's seed in round 1; each round takes the next, the judgement the one after the last
    attack: AttackConfig = ATTACK
    training: TrainConfig = FINE_TUNING
    neighbours: bool = True  # also teach the harmless neighbours of crashes
    verify: bool = True  # replay crashes that join the suite in SUMO
    axes: Axes = field(default_factory=Axes)  # axes of the suite's map of behaviours

    def __post_init__(self) -> None:
        """Raise RegentsError for invalid values."""
        check_ranges(self, _RANGES)
        require(
            self.training.teacher != "log",
            "the log cannot teach what to do where nothing like it was logged: rounds need --teacher idm",
            RegentsError,
        )
        require_as_begun(self.training, "--adversarial")

    def settings(self) -> dict[str, object]:
        """All settings by name, for the ledger."""
        return asdict(self)


_RANGES = {
    "rounds": Range(1, 1000, "rounds of attack and training", whole=True),
    "windows": Range(1, 1_000_000, "windows of each network in each round", whole=True),
    "held_out": Range(1, 1_000_000, "windows of each network to judge by", whole=True),
    "first_seed": SEED,
}
