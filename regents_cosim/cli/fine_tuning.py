"""`regents train aim-bev --finetune`: crashes to learn from, and scores before and after."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from regents_cosim.cli.options import FineTune
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.scenario import Scenario
    from regents_cosim.terminal import Terminal


@dataclass(frozen=True)
class Course:
    """Cases to learn from and cases to judge by."""

    ordinary: "list[Scenario]"
    adversarial: "list[Scenario]"
    held_out: "dict[str, list[Scenario]]"  # by name


def course(cases: Path, suite: Path, options: FineTune) -> Course:
    """The cases that the options name; what is not named to judge by is held back from the training."""
    from regents_cosim.planners.aim_bev.lessons import common_horizon
    from regents_cosim.suite import load_cases

    ordinary, adversarial = load_cases(cases), load_cases(suite)
    common_horizon([*ordinary, *adversarial])
    adversarial, held_attacks = _held_back(adversarial, options.held_out, "--held-out")
    ordinary, held_ordinary = _held_back(ordinary, options.ordinary, "--ordinary")
    return Course(ordinary, adversarial, {"adversarial": held_attacks, "ordinary": held_ordinary})


def _held_back(
    scenarios: "list[Scenario]", others: Path | None, option: str
) -> "tuple[list[Scenario], list[Scenario]]":
    """What to train on, and what to judge by: the cases of `others` where those are named."""
    from regents_cosim.evaluation.before_after import hold_back
    from regents_cosim.suite import load_cases

    if others is not None:
        return scenarios, load_cases(others)
    taught, held = hold_back(scenarios)
    if not held:
        raise RegentsError(f"{len(taught)} cases of fewer than 5 windows, expected more, or {option} CASES to judge by")
    return taught, held


def crashes_of(weights: Path, adversarial: "list[Scenario]", terminal: "Terminal") -> "list[Scenario]":
    """What AIM-BEV with these weights is to learn from. Raises RegentsError where there is nothing."""
    from regents_cosim.evaluation.failed_drives import failed_drives, teachable

    drives = failed_drives(adversarial, f"aim-bev:{weights}")
    failed = list(terminal.each(drives, "looking for crashes", len(adversarial)))
    crashes = teachable(failed)
    found = (
        f"aim-bev:{weights} crashes in {sum(case is not None for case in failed)} of {len(failed)} cases, "
        f"of which it could have avoided {len(crashes)} by braking"
    )
    if not crashes:
        raise RegentsError(f"{found}; expected some to learn from (`regents attack` makes cases)")
    terminal.say(found)
    return crashes


def show_before_after(before: Path, after: Path, held_out: "dict[str, list[Scenario]]", terminal: "Terminal") -> None:
    """The table that says whether the training helped."""
    from regents_cosim.evaluation.before_after import before_after
    from regents_cosim.evaluation.driving import drive_each

    rows = []
    for name, scenarios in held_out.items():
        drives = [
            list(terminal.each(drive_each(scenarios, f"aim-bev:{weights}"), f"driving {name} cases", len(scenarios)))
            for weights in (before, after)
        ]
        rows += before_after(name, *drives)
    terminal.show(f"before ({before.name}) and after ({after.name})", [dataclasses.asdict(row) for row in rows])
