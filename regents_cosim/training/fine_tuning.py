"""`train` and `finetune`: AIM-BEV learns from recorded traffic, and from its own crashes.

A fine-tuning lets weights crash, and teaches the crashes that they could have avoided by what is in view (19 m to each
side, or as far as the weights say). It keeps as much of what was learnt as ordinary traffic bears, and reports what
that changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from regents_cosim.cases.suite import cases_of
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult, driving_row
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.planners.aim_bev.network_inputs import shown_to
from regents_cosim.planners.aim_bev.weights_file import SHIPPED
from regents_cosim.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import Progress, ShowProgress, progress_for
from regents_cosim.training.failed_drives import failed_drives, teachable
from regents_cosim.training.learning import (
    AttackedAndOrdinary,
    EachEpoch,
    driven_by,
    drives,
    learn,
    parts,
    trained,
    weights_file,
)
from regents_cosim.training.lessons.classroom import common_horizon
from regents_cosim.training.lessons.train_config import FINE_TUNING, Epoch, TrainConfig, require_as_begun

AnyCases = Path | str | Sequence[Scenario]  # a case or a folder of cases, or cases in memory


@dataclass(frozen=True, repr=False)
class BeforeAfterRow(ShortRepr):
    """The scores of one planner on some cases, with 95 % intervals."""

    cases: str
    weights: str  # "before" or "after"
    n: int
    collisions: int
    collision_rate_percent: float
    collision_interval_percent: tuple[float, float]
    from_behind: int  # collisions in which an agent on its log drives into the ego, which may have braked
    route_completion_percent: float
    completion_interval_percent: tuple[float, float]
    alone: int  # cases in which this planner collides and the other does not
    p_value: float  # p-value of the hypothesis that both collide equally often (McNemar)


@dataclass(frozen=True, repr=False)
class FineTuned(ShortRepr):
    """The result of a fine-tuning; its weights are in the named file."""

    epochs: tuple[Epoch, ...]
    kept: float  # share of the change of weights that is kept, 0 to 1
    rows: tuple[BeforeAfterRow, ...]  # scores on attacked and ordinary cases that were held back, before and after


@dataclass(frozen=True)
class SplitCases:
    """Cases to learn from, to choose the weights by, and to judge them by; no window is in two of them."""

    taught: AttackedAndOrdinary
    chosen_by: AttackedAndOrdinary
    judged_by: AttackedAndOrdinary


def train(
    cases: AnyCases,
    output: Path | str,
    config: TrainConfig | None = None,
    *,
    resume: Path | None = None,
    progress: ShowProgress = True,
    each_epoch: EachEpoch = lambda done: None,
) -> list[Epoch]:
    """Teach AIM-BEV the traffic of recorded cases; the weights are written to `output` (.safetensors) after each epoch.

    `resume` is a checkpoint to continue, or weights for a warm start. `each_epoch` is called with all epochs so far.
        This needs torch. Raises RegentsError, MissingDependencyError.
    """
    path = weights_file(output)
    return trained(cases_of(cases), path, config or TrainConfig(), resume, [], progress_for(progress), each_epoch)


def finetune(
    cases: AnyCases,
    suite: AnyCases,
    output: Path | str,
    config: TrainConfig = FINE_TUNING,
    *,
    weights: Path = SHIPPED,
    held_out: AnyCases | None = None,
    ordinary: AnyCases | None = None,
    progress: ShowProgress = True,
    each_epoch: EachEpoch = lambda done: None,
) -> FineTuned:
    """Teach AIM-BEV to avoid its crashes in `suite`, and ordinary traffic (`cases`) as before.

    The training begins with `weights`. `output` (.safetensors) gets the mixture of the weights before and after that
    crashes least and drives ordinary routes as far. Scores are on `held_out` attacked cases and on `ordinary` ones, by
    default every fifth window of either, which is not taught; another fifth chooses the mixture. This needs torch.
    Raises RegentsError where there is nothing to learn from, MissingDependencyError.
    """
    require_as_begun(config)
    path, progress = weights_file(output), progress_for(progress)
    course = _course(cases_of(cases), cases_of(suite), held_out, ordinary)
    crashes = _crashes(weights, course.taught.adversarial, progress)
    epochs, kept = learn(crashes, course.taught.ordinary, course.chosen_by, weights, path, config, progress, each_epoch)
    rows = []
    for name, scenarios in vars(course.judged_by).items():
        rows += before_after(name, *(drives(scenarios, one, progress) for one in (weights, path)))
    return FineTuned(tuple(epochs), kept, tuple(rows))


def before_after(cases: str, before: Sequence[DriveResult], after: Sequence[DriveResult]) -> list[BeforeAfterRow]:
    """The rows of both planners on the same cases, in the same order."""
    hits = [[drive.hits is not None for drive in drives] for drives in (before, after)]
    p_value = round(mcnemar(*hits), 4)
    rows = []
    for weights, driven, mine, others in (("before", before, *hits), ("after", after, *hits[::-1])):
        row = driving_row(cases, driven)
        rows.append(
            BeforeAfterRow(
                cases,
                weights,
                row.n,
                row.collisions,
                row.collision_rate_percent,
                row.collision_interval_percent,
                sum(drive.collision_type == "rear_end_by_adversary" for drive in driven),
                row.route_completion_percent,
                row.completion_interval_percent,
                alone=sum(a and not b for a, b in zip(mine, others, strict=True)),
                p_value=p_value,
            )
        )
    return rows


def _course(
    ordinary: list[Scenario], adversarial: list[Scenario], held_out: AnyCases | None, others: AnyCases | None
) -> SplitCases:
    """Split the cases; where none are named to judge by, some are held back from the training."""
    common_horizon([*ordinary, *adversarial])
    judged_by = [None if named is None else cases_of(named) for named in (held_out, others)]
    split = [parts(adversarial, judged_by[0], "--held-out"), parts(ordinary, judged_by[1], "--ordinary")]
    return SplitCases(*(AttackedAndOrdinary(*part) for part in zip(*split, strict=True)))


def _crashes(weights: Path, adversarial: list[Scenario], progress: Progress) -> list[Scenario]:
    """The crashes from which AIM-BEV with these weights is to learn. Raises RegentsError without any."""
    driven = progress.each(driven_by(weights, adversarial), "looking for crashes", len(adversarial))
    failed = list(failed_drives(adversarial, driven, f"aim-bev:{weights}", shown_to(weights).camera.view_m))
    crashes = teachable(failed)
    found = (
        f"aim-bev:{weights} crashes in {sum(case is not None for case in failed)} of {len(failed)} cases, "
        f"of which a careful driver avoids {len(crashes)} by what it sees of the other"
    )
    if not crashes:
        raise RegentsError(f"{found}; expected some to learn from (`regents attack` makes cases)")
    progress.say(found)
    return crashes
