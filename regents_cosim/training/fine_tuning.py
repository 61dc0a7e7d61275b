"""`train` and `finetune`: AIM-BEV learns from recorded traffic, and from its own crashes.

A fine-tuning lets weights crash, and teaches the crashes that they could have avoided by what is in view (19 m to each
side, or as far as the weights say). It keeps as much of what was learnt as ordinary traffic bears, and reports what
that changed. Torch trains, and drives many cases at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from types import ModuleType

import numpy as np

from regents_cosim.cases.suite import cases_of
from regents_cosim.errors import MissingDependencyError, RegentsError, install_hint, require
from regents_cosim.evaluation.drives.driving import DriveResult, driving_row, score
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.planners.aim_bev.network_inputs import NetworkInputs
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights, save_weights
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.data_frames import Rows
from regents_cosim.system.files.atomic import scratch_folder
from regents_cosim.system.files.output_files import require_output
from regents_cosim.system.progress import Progress, ShowProgress, progress_for
from regents_cosim.training.failed_drives import failed_drives, teachable
from regents_cosim.training.lessons.classroom import common_horizon
from regents_cosim.training.lessons.train_config import (
    FINE_TUNING,
    Epoch,
    TrainConfig,
    checkpoint_path,
    require_as_begun,
)

SHARES = (0.25, 0.5, 0.75, 1.0)  # shares of the way from the weights before to those after
_AT_MOST_WORSE = 0.02  # largest loss of ordinary routes, as a share
_HELD_BACK = 5  # every so many windows one is held back

AnyCases = Path | str | Sequence[Scenario]  # a case or a folder of cases, or cases in memory
EachEpoch = Callable[[list[Epoch]], None]  # gets all epochs so far


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
    rows: Rows[BeforeAfterRow]  # scores on attacked and ordinary cases that were held back, before and after


@dataclass(frozen=True)
class AttackedAndOrdinary:
    """Attacked cases and ordinary cases."""

    adversarial: list[Scenario]
    ordinary: list[Scenario]


def train(
    cases: AnyCases,
    output: Path | str,
    config: TrainConfig | None = None,
    *,
    resume: Path | None = None,
    progress: ShowProgress = True,
    each_epoch: EachEpoch = lambda done: None,
) -> Rows[Epoch]:
    """Teach AIM-BEV the traffic of recorded cases; the weights are written to `output` (.safetensors) after each epoch.

    `resume` is a checkpoint to continue, or weights for a warm start. `each_epoch` is called with all epochs so far.
    This needs torch. Raises RegentsError, MissingDependencyError.
    """
    path = _weights_file(output)
    return _trained(cases_of(cases), path, config or TrainConfig(), resume, [], progress_for(progress), each_epoch)


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
    path, progress = _weights_file(output), progress_for(progress)
    taught, chosen_by, judged_by = _split(cases_of(cases), cases_of(suite), held_out, ordinary)
    crashes, learnt = _crashes(weights, taught.adversarial, progress), learnt_path(path)
    epochs = _trained(taught.ordinary, learnt, config, weights, crashes, progress, each_epoch)
    kept = _keep_best(weights, learnt, path, chosen_by, progress)
    rows = Rows[BeforeAfterRow]()
    for name, scenarios in vars(judged_by).items():
        rows += before_after(name, *(_drives(scenarios, one, progress) for one in (weights, path)))
    return FineTuned(tuple(epochs), kept, rows)


def before_after(cases: str, before: Sequence[DriveResult], after: Sequence[DriveResult]) -> list[BeforeAfterRow]:
    """The rows of both planners on the same cases, in the same order."""
    hits = [[drive.collision for drive in drives] for drives in (before, after)]
    p_value = round(mcnemar(*hits), 4)
    rows = []
    for weights, driven, mine, others in (("before", before, *hits), ("after", after, *hits[::-1])):
        row = driving_row(cases, driven)
        from_behind = sum(drive.collision_type == "rear_end_by_adversary" for drive in driven)
        alone = sum(a and not b for a, b in zip(mine, others, strict=True))
        made = BeforeAfterRow(
            cases, weights, row.n, row.collisions, row.collision_rate_percent, row.collision_interval_percent,
            from_behind, row.route_completion_percent, row.completion_interval_percent, alone, p_value,
        )  # fmt: skip
        rows.append(made)
    return rows


def _split(
    ordinary: list[Scenario], adversarial: list[Scenario], held_out: AnyCases | None, others: AnyCases | None
) -> list[AttackedAndOrdinary]:
    """The cases to learn from, to choose the weights by, and to judge them by; no window is in two of them.

    Where none are named to judge by, some are held back from the training. Raises RegentsError for too few windows.
    """
    common_horizon([*ordinary, *adversarial])
    judged_by = [None if named is None else cases_of(named) for named in (held_out, others)]
    split = [_parts(adversarial, judged_by[0], "--held-out"), _parts(ordinary, judged_by[1], "--ordinary")]
    return [AttackedAndOrdinary(*part) for part in zip(*split, strict=True)]


def _parts(scenarios: list[Scenario], judged_by: list[Scenario] | None, option: str) -> tuple[list[Scenario], ...]:
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


def _crashes(weights: Path, adversarial: list[Scenario], progress: Progress) -> list[Scenario]:
    """The crashes from which AIM-BEV with these weights is to learn. Raises RegentsError without any."""
    driven = progress.each(_torch().drive_all(adversarial, weights), "looking for crashes", len(adversarial))
    view_m = NetworkInputs.to(load_weights(weights)).camera.view_m
    failed = list(failed_drives(adversarial, driven, f"aim-bev:{weights}", view_m))
    crashes = teachable(failed)
    found = (
        f"aim-bev:{weights} crashes in {sum(case is not None for case in failed)} of {len(failed)} cases, "
        f"of which a careful driver avoids {len(crashes)} by what it sees of the other"
    )
    if not crashes:
        raise RegentsError(f"{found}; expected some to learn from (`regents attack` makes cases)")
    progress.say(found)
    return crashes


def _weights_file(output: Path | str) -> Path:
    """Check the name of the file for weights. Raises RegentsError, or MissingDependencyError without torch."""
    path = Path(output)
    if path.suffix != ".safetensors":
        raise RegentsError(f"--output {output}: expected a name that ends in .safetensors")
    for one in (path, learnt_path(path), checkpoint_path(path)):
        require_output(one)
    _torch()
    return path


def learnt_path(output: Path) -> Path:
    """The file of the weights at the end of the training, before they are mixed with the former ones."""
    return output.with_suffix(".learnt.safetensors")


def _trained(
    scenarios: list[Scenario],
    output: Path,
    config: TrainConfig,
    resume: Path | None,
    crashes: Sequence[Scenario],
    progress: Progress,
    each_epoch: EachEpoch,
) -> Rows[Epoch]:
    output.parent.mkdir(parents=True, exist_ok=True)
    done: list[Epoch] = []
    for done in progress.each(_torch().train(scenarios, output, config, resume, crashes), "training", config.epochs):
        each_epoch(done)
    return Rows(done)


def _drives(scenarios: list[Scenario], weights: Path, progress: Progress) -> list[DriveResult]:
    driven = progress.each(_torch().drive_all(scenarios, weights), f"driving with {weights.stem}", len(scenarios))
    return [score(scenario, tracks) for scenario, tracks in zip(scenarios, driven, strict=True)]


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
    found = mixture(share, _drives(cases.adversarial, weights, progress), _drives(cases.ordinary, weights, progress))
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
