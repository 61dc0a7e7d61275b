"""AIM-BEV learns: from recorded traffic, and from its crashes, as much of them as ordinary traffic bears.

What `train`, `finetune` and the rounds of `train_adversarially` share. Torch trains, and drives many cases at once.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from regents_cosim.errors import MissingDependencyError, RegentsError, install_hint
from regents_cosim.evaluation.drives.driving import DriveResult, score
from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.system.atomic import require_writable
from regents_cosim.system.output_files import require_ours
from regents_cosim.system.progress import Progress
from regents_cosim.system.scratch import scratch_folder
from regents_cosim.training.before_after import hold_back
from regents_cosim.training.lessons.interpolate import interpolate
from regents_cosim.training.lessons.train_config import Epoch, TrainConfig, checkpoint_path
from regents_cosim.training.mixture import SHARES, Mixture, best, mixture

EachEpoch = Callable[[list[Epoch]], None]  # is told all epochs so far


@dataclass(frozen=True)
class AttackedAndOrdinary:
    """Attacked cases, and ordinary ones."""

    adversarial: list[Scenario]
    ordinary: list[Scenario]


@dataclass(frozen=True)
class LearningResult:
    """How a planner learnt from its crashes; its weights are in the file that was named."""

    epochs: tuple[Epoch, ...]
    kept: float  # share of what was learnt, 0 to 1


def learn(
    crashes: Sequence[Scenario],
    ordinary: list[Scenario],
    chosen_by: AttackedAndOrdinary,
    weights: Path,
    output: Path,
    config: TrainConfig,
    progress: Progress,
    each_epoch: EachEpoch,
) -> LearningResult:
    """Teach AIM-BEV with `weights` to evade `crashes`, each with the drive that avoids it, and to drive as before.

    Written to `output` is the mixture of the weights before and after that crashes least in the cases to choose by,
    and drives ordinary routes as far. Needs torch.
    """
    learnt = learnt_path(output)
    epochs = trained(ordinary, learnt, config, weights, crashes, progress, each_epoch)
    return LearningResult(tuple(epochs), _keep_best(weights, learnt, output, chosen_by, progress))


def learnt_path(output: Path) -> Path:
    """Where the weights lie at the end of the training, before they are mixed with those before it."""
    return output.with_suffix(".learnt.safetensors")


def trained(
    scenarios: list[Scenario],
    output: Path,
    config: TrainConfig,
    resume: Path | None,
    crashes: Sequence[Scenario],
    progress: Progress,
    each_epoch: EachEpoch,
) -> list[Epoch]:
    """Train for as many epochs as the configuration says; all of them."""
    output.parent.mkdir(parents=True, exist_ok=True)
    done: list[Epoch] = []
    for done in progress.each(_torch().train(scenarios, output, config, resume, crashes), "training", config.epochs):
        each_epoch(done)
    return done


def weights_file(output: Path | str) -> Path:
    """The file for weights that is named. Raises RegentsError, or MissingDependencyError where nothing can train."""
    path = Path(output)
    if path.suffix != ".safetensors":
        raise RegentsError(f"--output {output}: expected a name that ends in .safetensors")
    require_writable(path.parent)
    for one in (path, learnt_path(path), checkpoint_path(path), path.with_suffix(".png")):
        require_ours(one)
    _torch()
    return path


def parts(scenarios: list[Scenario], judged_by: list[Scenario] | None, option: str) -> tuple[list[Scenario], ...]:
    """What to train on, to choose by, and to judge by: every fifth window of the rest where nothing is named.

    Raises RegentsError where there are too few windows.
    """
    rest, held = hold_back(scenarios) if judged_by is None else (scenarios, judged_by)
    taught, chosen_by = hold_back(rest)
    if not chosen_by:
        raise RegentsError(
            f"{len(scenarios)} cases of too few windows: a fifth of them is held back to choose the weights by, "
            f"and another to judge them by; expected at least 7 windows, or 5 and {option} CASES to judge by"
        )
    return taught, chosen_by, held


def drives(scenarios: list[Scenario], weights: Path, progress: Progress) -> list[DriveResult]:
    """How AIM-BEV with these weights drives each of them."""
    driven = progress.each(driven_by(weights, scenarios), f"driving with {weights.stem}", len(scenarios))
    return [score(scenario, tracks) for scenario, tracks in zip(scenarios, driven, strict=True)]


def driven_by(weights: Path, scenarios: list[Scenario]) -> Iterator[Tracks]:
    """Its tracks."""
    return _torch().drive_all(scenarios, weights)


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
    found = mixture(share, drives(cases.adversarial, weights, progress), drives(cases.ordinary, weights, progress))
    progress.say(
        f"{100 * share:.0f} % of what was learnt: {found.collisions} of {len(cases.adversarial)} attacked cases crash, "
        f"{100 * found.completion:.1f} % of {len(cases.ordinary)} ordinary routes are driven"
    )
    return found


def _torch() -> ModuleType:
    """What trains. Raises MissingDependencyError without torch."""
    try:
        from regents_cosim.training.lessons import train as found
    except ModuleNotFoundError as error:
        raise MissingDependencyError(f"training needs {error.name}: {install_hint('torch')}") from error
    return found
