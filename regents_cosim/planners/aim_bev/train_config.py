"""Settings and scores of a training of AIM-BEV, without torch, which trains it (`train`)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from regents_cosim.checks.ranges import SEED, Range, check_ranges
from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.aim_bev.network_inputs import LEAST_VIEW_M, MOST_VIEW_M
from regents_cosim.short_repr import ShortRepr


@dataclass(frozen=True, repr=False)
class TrainConfig(ShortRepr):
    """The settings of a training: how long and how fast to learn, and from which teacher."""

    epochs: int = 40
    seed: int = 0
    lessons: int = 4096  # new lessons per epoch
    kept: int = 4  # epochs in which a lesson is repeated
    batch: int = 64
    learning_rate: float = 1e-3  # of Adam; falls to a hundredth of it along a cosine
    frozen: int = 0  # first layers of the encoder that do not learn; an epoch costs half with 4, a quarter with 8
    warm_up: int = 3  # epochs before the network drives by itself, if it begins without weights
    drives: int = 40  # drives of the network by itself, per epoch
    teacher: Literal["log", "idm", "careful"] = "log"  # the log, or the driver in the egos' places (`teacher`)
    # the log's end, or a route point ahead (`own_way`); None: as the weights
    target: Literal["end", "route"] | None = None
    view: float | None = None  # [m] view to each side; None: as the weights
    evading: float = 0.25  # share of the lessons and drives, if there are crashes to learn from
    urgent: float = 0.25  # share of the lessons in which a careful teacher brakes for a danger, or nearly does
    threads: int = 2  # threads of torch

    def __post_init__(self) -> None:
        check_ranges(self, _RANGES)
        if self.view is not None:
            _VIEW.check("view", self.view)
        require(
            self.lessons >= self.batch,
            f"lessons is {self.lessons}, expected at least {self.batch}: that many are taught at a time",
            RegentsError,
        )
        for share in (self.evading, self.urgent):
            require(0 < share < 1, f"a share {share} of lessons, expected one between 0 and 1", RegentsError)


_RANGES = {
    "epochs": Range(1, 100_000, "passes over the lessons", whole=True),
    "seed": SEED,
    "lessons": Range(1, 10_000_000, "new lessons in an epoch", whole=True),
    "kept": Range(1, 1000, "epochs that a lesson is repeated in", whole=True),
    "batch": Range(1, 100_000, "lessons that are taught at a time", whole=True),
    "learning_rate": Range(1e-9, 1.0, "the learning rate of Adam"),
    "frozen": Range(0, 13, "first layers of the encoder that learn no more", whole=True),
    "drives": Range(0, 100_000, "drives of the network by itself per epoch", whole=True),
    "threads": Range(1, 1024, "threads of torch", whole=True),
}
_VIEW = Range(LEAST_VIEW_M, MOST_VIEW_M, "metres that the network sees ahead, behind and to each side")

# For trained weights lessons cost more than passes over them, and evasions take about ten passes. The log cannot teach
# evasions: with it, 66 of 106 held-out attacks ended in a crash before and 64 after, and ordinary traffic suffered.
FINE_TUNING = TrainConfig(
    epochs=8, lessons=2048, kept=10, frozen=4, drives=24, learning_rate=5e-4, teacher="idm", evading=0.4
)


def require_as_begun(config: TrainConfig, way: str) -> None:
    """Raise RegentsError where the inputs of weights that learn from crashes are to change."""
    for name in ("target", "view"):
        given = getattr(config, name)
        require(given is None, f"--{name} {given} with {way}, expected the {name} of the weights", RegentsError)


@dataclass(frozen=True)
class Epoch:
    """The losses and scores of one epoch of training."""

    epoch: int
    loss_m: float  # mean absolute error of the waypoints' coordinates
    held_back_m: float  # the same error on windows that are not taught
    practice_collision_rate: float | None
    practice_away_m: float | None  # mean distance from the log


def checkpoint_path(output: Path) -> Path:
    """The path of the checkpoint for a training that writes its weights to `output`."""
    return output.with_suffix(".checkpoint.safetensors")
