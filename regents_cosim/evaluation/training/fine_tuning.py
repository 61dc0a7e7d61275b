"""`train` and `finetune`: AIM-BEV learns from recorded traffic, and from its own crashes.

A fine-tuning takes the crashes of the weights that it begins with which could have been avoided by what is in view (the
planner sees 19 m), keeps as much of what was learnt as ordinary traffic bears, and says what that changed.

Who teaches, and what it gave, was measured: `docs/how-to/aim-bev.md`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from regents_cosim.cases.suite import cases_of
from regents_cosim.errors import MissingDependencyError, RegentsError, require
from regents_cosim.evaluation.drives.driving import Drive, score
from regents_cosim.evaluation.training.before_after import BeforeAfterRow, before_after, hold_back
from regents_cosim.evaluation.training.failed_drives import failed_drives, teachable
from regents_cosim.evaluation.training.mixture import SHARES, Mixture, best, mixture
from regents_cosim.planners.aim_bev.interpolate import interpolate
from regents_cosim.planners.aim_bev.lessons import common_horizon
from regents_cosim.planners.aim_bev.train_config import FINE_TUNING, Epoch, TrainConfig
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights, save_weights
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.system.atomic import require_writable
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.scratch import scratch_folder

AnyCases = Path | str | Sequence[Scenario]  # a case or a folder of cases, or cases in memory


@dataclass(frozen=True)
class FineTuned:
    """What a fine-tuning gave; its weights are in the file that was named."""

    epochs: tuple[Epoch, ...]
    kept: float  # share of what was learnt, 0 to 1
    rows: tuple[BeforeAfterRow, ...]  # attacked and ordinary cases that were held back, before and after


@dataclass(frozen=True)
class AttackedAndOrdinary:
    """Attacked cases, and ordinary ones."""

    adversarial: list[Scenario]
    ordinary: list[Scenario]


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
    progress: Progress = SILENT,
    each_epoch: Callable[[list[Epoch]], None] = lambda done: None,
) -> list[Epoch]:
    """Teach AIM-BEV the traffic of recorded cases; the weights are written to `output` (.safetensors) after each epoch.

    `resume` is a checkpoint to go on from, or weights for a warm start. `each_epoch` is told all epochs so far. Needs
    torch. Raises RegentsError, MissingDependencyError.
    """
    path = _weights(output)
    return _trained(cases_of(cases), path, config or TrainConfig(), resume, [], progress, each_epoch)


def finetune(
    cases: AnyCases,
    suite: AnyCases,
    output: Path | str,
    config: TrainConfig = FINE_TUNING,
    *,
    weights: Path = SHIPPED,
    held_out: AnyCases | None = None,
    ordinary: AnyCases | None = None,
    progress: Progress = SILENT,
    each_epoch: Callable[[list[Epoch]], None] = lambda done: None,
) -> FineTuned:
    """Teach AIM-BEV to avoid its crashes in `suite`, and ordinary traffic (`cases`) as before.

    It begins with `weights`, and writes to `output` (.safetensors) the mixture of those before and after that crashes
    least and drives ordinary routes as far. Scores before and after are on `held_out` attacked cases and on `ordinary`
    ones, by default every fifth window of either, which is not taught; another fifth chooses the mixture. Needs torch.
    Raises RegentsError where there is nothing to learn from, MissingDependencyError.
    """
    require(config.target is None, "--target with --finetune, expected the target of the weights", RegentsError)
    path = _weights(output)
    course = _course(cases_of(cases), cases_of(suite), held_out, ordinary)
    crashes = _crashes(weights, course.taught.adversarial, progress)
    learnt = learnt_path(path)
    epochs = _trained(course.taught.ordinary, learnt, config, weights, crashes, progress, each_epoch)
    kept = _keep_best(weights, learnt, path, course.chosen_by, progress)
    rows = []
    for name, scenarios in vars(course.judged_by).items():
        rows += before_after(name, *(_drives(scenarios, one, progress) for one in (weights, path)))
    return FineTuned(tuple(epochs), kept, tuple(rows))


def learnt_path(output: Path) -> Path:
    """Where the weights lie at the end of the training, before they are mixed with those before it."""
    return output.with_suffix(".learnt.safetensors")


def _weights(output: Path | str) -> Path:
    path = Path(output)
    if path.suffix != ".safetensors":
        raise RegentsError(f"--output {output}: expected a name that ends in .safetensors")
    require_writable(path.parent)
    _torch()
    return path


def _torch() -> ModuleType:
    """What trains. Raises MissingDependencyError without torch."""
    try:
        from regents_cosim.planners.aim_bev import train as found
    except ModuleNotFoundError as error:
        raise MissingDependencyError(f"training needs {error.name}: pip install 'regents_cosim[torch]'") from error
    return found


def _trained(
    scenarios: list[Scenario],
    output: Path,
    config: TrainConfig,
    resume: Path | None,
    crashes: list[Scenario],
    progress: Progress,
    each_epoch: Callable[[list[Epoch]], None],
) -> list[Epoch]:
    output.parent.mkdir(parents=True, exist_ok=True)
    done: list[Epoch] = []
    for done in progress.each(_torch().train(scenarios, output, config, resume, crashes), "training", config.epochs):
        each_epoch(done)
    return done


def _course(
    ordinary: list[Scenario], adversarial: list[Scenario], held_out: AnyCases | None, others: AnyCases | None
) -> SplitCases:
    """The cases that are named; what is not named to judge by is held back from the training."""
    common_horizon([*ordinary, *adversarial])
    parts = [_parts(adversarial, held_out, "--held-out"), _parts(ordinary, others, "--ordinary")]
    return SplitCases(*(AttackedAndOrdinary(*part) for part in zip(*parts, strict=True)))


def _parts(scenarios: list[Scenario], others: AnyCases | None, option: str) -> tuple[list[Scenario], ...]:
    """What to train on, to choose by, and to judge by: the cases of `others` where those are named."""
    rest, judged_by = hold_back(scenarios) if others is None else (scenarios, cases_of(others))
    taught, chosen_by = hold_back(rest)
    if not chosen_by:
        raise RegentsError(
            f"{len(scenarios)} cases of too few windows: a fifth of them is held back to choose the weights by, "
            f"and another to judge them by; expected at least 7 windows, or 5 and {option} CASES to judge by"
        )
    return taught, chosen_by, judged_by


def _crashes(weights: Path, adversarial: list[Scenario], progress: Progress) -> list[Scenario]:
    """What AIM-BEV with these weights is to learn from. Raises RegentsError where there is nothing."""
    drives = progress.each(_driven_by(weights, adversarial), "looking for crashes", len(adversarial))
    failed = list(failed_drives(adversarial, drives, f"aim-bev:{weights}"))
    crashes = teachable(failed)
    found = (
        f"aim-bev:{weights} crashes in {sum(case is not None for case in failed)} of {len(failed)} cases, "
        f"of which it could have avoided {len(crashes)} by braking in the last 3 s"
    )
    if not crashes:
        raise RegentsError(f"{found}; expected some to learn from (`regents attack` makes cases)")
    progress.say(found)
    return crashes


def _keep_best(before: Path, learnt: Path, output: Path, chosen_by: AttackedAndOrdinary, progress: Progress) -> float:
    """Write the mixture of both weights to `output` that drives the cases to choose by best; its share."""
    ends = load_weights(before), load_weights(learnt)
    with scratch_folder() as folder:
        mixtures = []
        for share in (0.0, *SHARES):
            weights = folder / f"{share:g}.safetensors"
            save_weights(interpolate(*ends, share), weights)
            mixtures.append(_mixture(share, weights, chosen_by, progress))
    chosen = best(mixtures[0], mixtures[1:])
    progress.say(f"kept: {100 * chosen.share:.0f} % of what was learnt")
    save_weights(interpolate(*ends, chosen.share), output)
    return chosen.share


def _mixture(share: float, weights: Path, cases: AttackedAndOrdinary, progress: Progress) -> Mixture:
    found = mixture(share, _drives(cases.adversarial, weights, progress), _drives(cases.ordinary, weights, progress))
    progress.say(
        f"{100 * share:.0f} % of what was learnt: {found.collisions} of {len(cases.adversarial)} attacked cases crash, "
        f"{100 * found.completion:.1f} % of {len(cases.ordinary)} ordinary routes are driven"
    )
    return found


def _drives(scenarios: list[Scenario], weights: Path, progress: Progress) -> list[Drive]:
    drives = progress.each(_driven_by(weights, scenarios), f"driving with {weights.stem}", len(scenarios))
    return [score(scenario, tracks) for scenario, tracks in zip(scenarios, drives, strict=True)]


def _driven_by(weights: Path, scenarios: list[Scenario]) -> Iterator[Tracks]:
    return _torch().drive_all(scenarios, weights)
