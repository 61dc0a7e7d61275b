"""Settings and scores of a training of AIM-BEV, without torch, which trains it (`train`)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from regents_cosim.checks.arguments import require_one_of
from regents_cosim.checks.ranges import SEED, Range, check_ranges
from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.aim_bev.architecture import LEAST_VIEW_M, MOST_VIEW_M
from regents_cosim.short_repr import ShortRepr

Teacher = Literal["log", "idm", "careful"]


@dataclass(frozen=True, repr=False)
class TrainConfig(ShortRepr):
    """The settings of a training: how long and how fast to learn, and from which teacher."""

    epochs: int = 40
    """number of passes, over which the learning rate falls to a hundredth; default 40, or 8 with --finetune"""
    seed: int = 0
    """random seed of the training"""
    lessons: int = 4096
    """number of new lessons per epoch; default 4096, or 2048 with --finetune"""
    kept: int = 4
    """number of epochs in which a lesson is repeated; default 4, or 10 with --finetune"""
    batch: int = 64
    """number of lessons in a batch"""
    learning_rate: float = 1e-3
    """learning rate of Adam in the first epoch; default 1e-3, or 5e-4 with --finetune"""
    frozen: int = 0
    """number of first layers of the encoder that stay as they are; an epoch costs half with 4, a quarter with 8;
    default 0, or 4 with --finetune"""
    warm_up: int = 3
    """number of epochs before the network drives by itself, if it begins without weights"""
    drives: int = 40
    """number of drives of the network per epoch, whose states it also learns from; default 40, or 24 with
    --finetune"""
    teacher: Teacher = "log"
    """log: every vehicle near an ego shows how to drive; idm: an IDM in the ego's place, which sees only as far as
    the network and also teaches in states that the network drove to; careful: as idm, but it brakes fully while the
    careful driver of UN R157 would expect a collision; default idm with --finetune, else log"""
    target: Literal["end", "route"] | None = None
    """where the network drives to: end: the end of its log; route: a point of its route 20 m ahead, with only the
    lights of its own route visible, also taught with all lights red and all green (needs --teacher idm); default:
    as the weights of --resume, else end"""
    view: float | None = None
    """how far the network sees ahead, behind and to each side [m], with the same number of pixels at the same cost;
    default: as the weights of --resume, else 19.2 as in the papers"""
    evading: float = 0.25
    """share of crashes among the lessons and drives, with --finetune; default 0.4"""
    urgent: float = 0.25
    """share of the lessons in which a careful teacher brakes for a danger, or might have to"""
    threads: int = 2
    """number of threads of torch"""

    def __post_init__(self) -> None:
        check_ranges(self, _RANGES)
        require_one_of(self.teacher, get_args(Teacher), "teacher")
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

# For trained weights lessons cost more than passes over them, and evasions take several passes. The log cannot teach
# them: its drivers never had to evade.
FINE_TUNING = TrainConfig(
    epochs=8, lessons=2048, kept=10, frozen=4, drives=24, learning_rate=5e-4, teacher="idm", evading=0.4
)


def require_as_begun(config: TrainConfig) -> None:
    """Raise RegentsError where the inputs of weights that learn from crashes are to change."""
    for name in ("target", "view"):
        given = getattr(config, name)
        require(given is None, f"--{name} {given} with --finetune, expected the {name} of the weights", RegentsError)


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
