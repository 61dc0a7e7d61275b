"""`regents train aim-bev --finetune`: crashes to learn from, how much of it to keep, and scores before and after.

Only evasions of what is in view can be learnt: the planner sees 19 m.

Who teaches, and what it gave, was measured: `docs/how-to/aim-bev.md`.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from regents_cosim.cli.options import FineTune
from regents_cosim.errors import RegentsError
from regents_cosim.system.scratch import scratch_folder

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.evaluation.drives.driving import Drive
    from regents_cosim.evaluation.training.mixture import Mixture
    from regents_cosim.scenario import Scenario


@dataclass(frozen=True)
class Cases:
    """Attacked cases, and ordinary ones."""

    adversarial: "list[Scenario]"
    ordinary: "list[Scenario]"


@dataclass(frozen=True)
class Course:
    """Cases to learn from, to choose the weights by, and to judge them by; no window is in two of them."""

    taught: Cases
    chosen_by: Cases
    judged_by: Cases


def course(cases: Path, suite: Path, options: FineTune) -> Course:
    """The cases that the options name; what is not named to judge by is held back from the training."""
    from regents_cosim.cases.suite import load_cases
    from regents_cosim.planners.aim_bev.lessons import common_horizon

    adversarial, ordinary = load_cases(suite), load_cases(cases)
    common_horizon([*ordinary, *adversarial])
    parts = [_parts(adversarial, options.held_out, "--held-out"), _parts(ordinary, options.ordinary, "--ordinary")]
    return Course(*(Cases(*part) for part in zip(*parts, strict=True)))


def _parts(scenarios: "list[Scenario]", others: Path | None, option: str) -> "tuple[list[Scenario], ...]":
    """What to train on, to choose by, and to judge by: the cases of `others` where those are named."""
    from regents_cosim.cases.suite import load_cases
    from regents_cosim.evaluation.training.before_after import hold_back

    rest, judged_by = hold_back(scenarios) if others is None else (scenarios, load_cases(others))
    taught, chosen_by = hold_back(rest)
    if not chosen_by:
        raise RegentsError(
            f"{len(scenarios)} cases of too few windows: a fifth of them is held back to choose the weights by, "
            f"and another to judge them by; expected at least 7 windows, or 5 and {option} CASES to judge by"
        )
    return taught, chosen_by, judged_by


def crashes_of(weights: Path, adversarial: "list[Scenario]", terminal: "Terminal") -> "list[Scenario]":
    """What AIM-BEV with these weights is to learn from. Raises RegentsError where there is nothing."""
    from regents_cosim.evaluation.training.failed_drives import failed_drives, teachable
    from regents_cosim.planners.aim_bev.train import drive_all

    drives = terminal.each(drive_all(adversarial, weights), "looking for crashes", len(adversarial))
    failed = list(failed_drives(adversarial, drives, f"aim-bev:{weights}"))
    crashes = teachable(failed)
    found = (
        f"aim-bev:{weights} crashes in {sum(case is not None for case in failed)} of {len(failed)} cases, "
        f"of which it could have avoided {len(crashes)} by braking in the last 3 s"
    )
    if not crashes:
        raise RegentsError(f"{found}; expected some to learn from (`regents attack` makes cases)")
    terminal.say(found)
    return crashes


def learnt_path(output: Path) -> Path:
    """Where the weights lie at the end of the training, before they are mixed with those before it."""
    return output.with_suffix(".learnt.safetensors")


def keep_best(before: Path, learnt: Path, output: Path, chosen_by: Cases, terminal: "Terminal") -> None:
    """Write the mixture of both weights to `output` that drives the cases to choose by best."""
    from regents_cosim.evaluation.training.mixture import SHARES, best
    from regents_cosim.planners.aim_bev.interpolate import interpolate
    from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights

    ends = load_weights(before), load_weights(learnt)
    with scratch_folder() as folder:
        mixtures = []
        for share in (0.0, *SHARES):
            weights = folder / f"{share:g}.safetensors"
            save_weights(interpolate(*ends, share), weights)
            mixtures.append(_driven(share, weights, chosen_by, terminal))
    chosen = best(mixtures[0], mixtures[1:])
    terminal.say(f"kept: {100 * chosen.share:.0f} % of what was learnt")
    save_weights(interpolate(*ends, chosen.share), output)


def _driven(share: float, weights: Path, cases: Cases, terminal: "Terminal") -> "Mixture":
    from regents_cosim.evaluation.training.mixture import mixture

    found = mixture(share, _drives(cases.adversarial, weights, terminal), _drives(cases.ordinary, weights, terminal))
    terminal.say(
        f"{100 * share:.0f} % of what was learnt: {found.collisions} of {len(cases.adversarial)} attacked cases crash, "
        f"{100 * found.completion:.1f} % of {len(cases.ordinary)} ordinary routes are driven"
    )
    return found


def show_before_after(before: Path, after: Path, judged_by: Cases, terminal: "Terminal") -> None:
    """The table that says whether the training helped."""
    from regents_cosim.evaluation.training.before_after import before_after

    rows = []
    for name, scenarios in vars(judged_by).items():
        rows += before_after(name, *(_drives(scenarios, weights, terminal) for weights in (before, after)))
    terminal.show(f"before ({before.name}) and after ({after.name})", [dataclasses.asdict(row) for row in rows])


def _drives(scenarios: "list[Scenario]", weights: Path, terminal: "Terminal") -> "list[Drive]":
    from regents_cosim.evaluation.drives.driving import score
    from regents_cosim.planners.aim_bev.train import drive_all

    drives = terminal.each(drive_all(scenarios, weights), f"driving with {weights.stem}", len(scenarios))
    return [score(scenario, tracks) for scenario, tracks in zip(scenarios, drives, strict=True)]
