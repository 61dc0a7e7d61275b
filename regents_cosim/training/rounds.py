"""`train_adversarially`: attack the planner, let it learn from its crashes, attack the new planner, and so on.

Every round has windows of its own, and so have the attacks that judge the last one. The weights of a round count only
if they drive ordinary traffic as well as in the beginning; else the next round begins where this one did.
"""

from dataclasses import dataclass
from pathlib import Path

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.cases.suite import cases_of
from regents_cosim.checks.names import inside, require_no_link
from regents_cosim.errors import require_file
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights, save_weights
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import open_ledger
from regents_cosim.runs.steps import Steps
from regents_cosim.runs.window_job import Still
from regents_cosim.saving import make_suite
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import ShowProgress, progress_for
from regents_cosim.training.before_after import BeforeAfterRow
from regents_cosim.training.fine_tuning import AnyCases
from regents_cosim.training.fresh_windows import FreshWindows
from regents_cosim.training.learning import EachEpoch, parts, weights_file
from regents_cosim.training.lessons.classroom import common_horizon
from regents_cosim.training.rounds_course import OrdinaryCases, RoundRow, RoundsCourse
from regents_cosim.training.rounds_settings import Rounds


@dataclass(frozen=True, repr=False)
class AdversariallyTrained(ShortRepr):
    """The result of the rounds; the weights are in the named file."""

    rounds: tuple[RoundRow, ...]
    rows: tuple[BeforeAfterRow, ...]  # scores on unseen windows: ordinary, with old attacks, with fresh ones
    suite: Path  # folder of the suite with crashes of all rounds


def train_adversarially(
    cases: AnyCases,
    output: Path | str,
    rounds: Rounds | None = None,
    *,
    weights: Path = SHIPPED,
    ordinary: AnyCases | None = None,
    into: Path | None = None,
    still: Still | None = None,
    progress: ShowProgress = True,
    each_epoch: EachEpoch = lambda done: None,
) -> AdversariallyTrained:
    """Let AIM-BEV learn, round by round, from attacks on its last weights; `output` (.safetensors) gets the final ones.

    `cases` are ordinary traffic, which is taught between the crashes. Every fifth window of it is driven at the gate,
    or that of `ordinary`; another fifth chooses how much is kept. Crashes of new kinds join the suite `into` (default:
    one beside `output`), with a picture each where `still` draws one.

    Finished work lies in `OUTPUT.rounds/`: the same call continues after a stop, to the same bytes. This needs torch.
    Raises RegentsError, MissingDependencyError.
    """
    path, rounds, progress = weights_file(output), rounds or Rounds(), progress_for(progress)
    held = None if ordinary is None else cases_of(ordinary)
    split = OrdinaryCases(*parts(cases_of(cases), held, "--ordinary"))
    given = [*split.taught, *split.chosen_by, *split.judged_by]
    steps, dt = common_horizon(given)
    require_file(weights, "weights")
    folder = require_no_link(rounds_folder(path))
    traffic = FreshWindows(rounds.nets, rounds.first_seed, round((steps - 1) * dt, 6), Steps(folder), progress)
    traffic.require_unseen(given, rounds.rounds + 1)
    suite = into or inside(folder, "suite")
    make_suite(suite, rounds.first_seed)
    with open_ledger(folder, identity("train", rounds.settings() | {"into": suite}, {})) as ledger:
        course = RoundsCourse(rounds, weights, split, traffic, folder, suite, still, ledger, progress, each_epoch)
        course.plan(sha256_of(weights), *map(content_hash, given), *traffic.digests())
        course.go()
        save_weights(load_weights(course.last()), path)
        ledger.finish()
        return AdversariallyTrained(tuple(course.rows()), tuple(course.held_out()), suite)


def rounds_folder(output: Path) -> Path:
    """The folder for the rounds of a training that writes its weights to `output`."""
    return output.with_suffix(".rounds")
