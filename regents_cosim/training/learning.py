"""Lets AIM-BEV learn from recorded traffic and from its crashes, as much as ordinary traffic bears.

`train` and `finetune` share this. Torch trains, and drives many cases at once.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from types import ModuleType

import numpy as np

from regents_cosim.errors import MissingDependencyError, RegentsError, install_hint, require
from regents_cosim.evaluation.drives.driving import DriveResult, score
from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.system.files.atomic import require_writable, scratch_folder
from regents_cosim.system.files.output_files import require_ours
from regents_cosim.system.progress import Progress
from regents_cosim.training.lessons.train_config import Epoch, TrainConfig, checkpoint_path

SHARES = (0.25, 0.5, 0.75, 1.0)  # shares of the way from the weights before to those after
_AT_MOST_WORSE = 0.02  # largest loss of ordinary routes, as a share
_HELD_BACK = 5  # every so many windows one is held back


@dataclass(frozen=True)
class Mixture:
    """A share of a fine-tuning, and the scores of its weights in the cases to choose by."""

    share: float
    collisions: int  # collisions in attacked cases
    completion: float  # driven share of ordinary routes, 0 to 1


def mixture(share: float, attacked: Sequence[DriveResult], ordinary: Sequence[DriveResult]) -> Mixture:
    """Score some drives for the choice."""
    collisions = sum(drive.hits is not None for drive in attacked)
    return Mixture(share, collisions, fmean(drive.completion for drive in ordinary))


def best(before: Mixture, mixtures: Sequence[Mixture]) -> Mixture:
    """Choose the mixture with fewest collisions among those that lose at most 2 points of ordinary routes.

    `before` is one of them. Among equals the one that changes the weights least is chosen.
    """
    bearable = [m for m in (before, *mixtures) if m.completion >= before.completion - _AT_MOST_WORSE]
    return min(bearable, key=lambda m: (m.collisions, m.share))


def interpolate(before: dict[str, np.ndarray], after: dict[str, np.ndarray], share: float) -> dict[str, np.ndarray]:
    """`before` + `share` (`after` - `before`), array by array. Raises RegentsError where they hold different arrays.

    Thereby more is kept of what was known before. Source: WiSE-FT (Wortsman et al. 2022).
    """
    shapes = [{name: values.shape for name, values in weights.items()} for weights in (before, after)]
    require(shapes[0] == shapes[1], "weights of two different networks, expected the same arrays in both", RegentsError)
    mixed = {}
    for name, values in before.items():
        begun = values.astype(np.float32)
        mixed[name] = begun + np.float32(share) * (after[name].astype(np.float32) - begun)
    return mixed


EachEpoch = Callable[[list[Epoch]], None]  # gets all epochs so far


@dataclass(frozen=True)
class AttackedAndOrdinary:
    """Attacked cases and ordinary cases."""

    adversarial: list[Scenario]
    ordinary: list[Scenario]


def learn(
    crashes: Sequence[Scenario],
    ordinary: list[Scenario],
    chosen_by: AttackedAndOrdinary,
    weights: Path,
    output: Path,
    config: TrainConfig,
    progress: Progress,
    each_epoch: EachEpoch,
) -> tuple[list[Epoch], float]:
    """Teach AIM-BEV with `weights` to evade `crashes`, each with the drive that avoids it, and to drive as before.

    `output` gets the mixture of the weights before and after that crashes least in the cases to choose by, and drives
    ordinary routes as far. Returns the epochs, and the share of the change of weights that is kept, 0 to 1. This needs
    torch.
    """
    learnt = learnt_path(output)
    epochs = trained(ordinary, learnt, config, weights, crashes, progress, each_epoch)
    return epochs, _keep_best(weights, learnt, output, chosen_by, progress)


def learnt_path(output: Path) -> Path:
    """The file of the weights at the end of the training, before they are mixed with the former ones."""
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
    """Train for all epochs of the configuration, and return their scores."""
    output.parent.mkdir(parents=True, exist_ok=True)
    done: list[Epoch] = []
    for done in progress.each(_torch().train(scenarios, output, config, resume, crashes), "training", config.epochs):
        each_epoch(done)
    return done


def weights_file(output: Path | str) -> Path:
    """Check the name of the file for weights. Raises RegentsError, or MissingDependencyError without torch."""
    path = Path(output)
    if path.suffix != ".safetensors":
        raise RegentsError(f"--output {output}: expected a name that ends in .safetensors")
    require_writable(path.parent)
    for one in (path, learnt_path(path), checkpoint_path(path)):
        require_ours(one)
    _torch()
    return path


def parts(scenarios: list[Scenario], judged_by: list[Scenario] | None, option: str) -> tuple[list[Scenario], ...]:
    """Split cases into those to train on, to choose by, and to judge by: every fifth window where none are named.

    Raises RegentsError for too few windows.
    """
    rest, held = hold_back(scenarios) if judged_by is None else (scenarios, judged_by)
    taught, chosen_by = hold_back(rest)
    if not chosen_by:
        raise RegentsError(
            f"{len(scenarios)} cases of too few windows: a fifth of them is held back to choose the weights by, "
            f"and another to judge them by; expected at least 7 windows, or 5 and {option} CASES to judge by"
        )
    return taught, chosen_by, held


def hold_back(scenarios: Sequence[Scenario]) -> tuple[list[Scenario], list[Scenario]]:
    """Split cases into those to train on and those to judge by, which are of every fifth window.

    No window is on both sides. The window of an attacked case is the one that was attacked.
    """
    windows = sorted({_window(scenario) for scenario in scenarios})
    held = set(windows[_HELD_BACK - 1 :: _HELD_BACK])
    return [s for s in scenarios if _window(s) not in held], [s for s in scenarios if _window(s) in held]


def _window(scenario: Scenario) -> str:
    return scenario.attack.case if scenario.attack else scenario.id


def drives(scenarios: list[Scenario], weights: Path, progress: Progress) -> list[DriveResult]:
    """The drive of AIM-BEV with these weights in each case."""
    driven = progress.each(driven_by(weights, scenarios), f"driving with {weights.stem}", len(scenarios))
    return [score(scenario, tracks) for scenario, tracks in zip(scenarios, driven, strict=True)]


def driven_by(weights: Path, scenarios: list[Scenario]) -> Iterator[Tracks]:
    """The tracks of a drive by these weights."""
    return _torch().drive_all(scenarios, weights)


def _keep_best(before: Path, learnt: Path, output: Path, chosen_by: AttackedAndOrdinary, progress: Progress) -> float:
    """Write the mixture of both weights that drives the cases to choose by best; return its share."""
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
    """Import the module that trains. Raises MissingDependencyError without torch."""
    try:
        from regents_cosim.training.lessons import train as found
    except ModuleNotFoundError as error:
        raise MissingDependencyError(f"training needs {error.name}: {install_hint('torch')}") from error
    return found
