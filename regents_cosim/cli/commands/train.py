"""`regents train`: teach a planner to drive."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App

from regents_cosim.cli.groups import OfTraffic, OfTraining
from regents_cosim.cli.options import CasePath, FineTune, Output, OutputOptions, SettingsFile, TrainOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.training.lessons.train_config import Epoch

training = App(name="train", help="Teach a planner to drive.")


@training.command(name="aim-bev")
def train_aim_bev(
    cases: Annotated[CasePath, OfTraffic],
    *,
    output: Output,
    options: TrainOptions = TrainOptions(),
    resume: Annotated[Path | None, OfTraining] = None,
    fine_tune: FineTune = FineTune(),
    settings: SettingsFile = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Teach AIM-BEV the traffic of recorded cases; needs torch (pip install '.[torch]').

    By default every vehicle near the ego of a case is a teacher. After each epoch the weights and a checkpoint are
    saved. With --finetune the network also learns from its own crashes.

    Parameters
    ----------
    cases
        a folder of recorded cases, as `regents record` makes them
    output
        file for the weights (.safetensors)
    resume
        a checkpoint to continue from, or weights to start from: a file, or the shipped aim-bev-hardened
    """
    from regents_cosim.planners.aim_bev.weights_file import BY_PLANNER, SHIPPED
    from regents_cosim.training.fine_tuning import finetune, train

    terminal = open_terminal(talk)
    resume = BY_PLANNER.get(str(resume), resume)
    from_crashes = fine_tune.finetune is not None
    config = options.config(from_crashes)
    show_epoch = partial(_show_epoch, output, config.epochs, not from_crashes, terminal)
    if fine_tune.finetune is None:
        if fine_tune.held_out or fine_tune.ordinary:
            raise RegentsError("--held-out and --ordinary judge a fine-tuning; expected --finetune SUITE with them")
        done = train(cases, output, config, resume=resume, progress=terminal, each_epoch=show_epoch)
        terminal.show(f"weights in {output}", done.to_dict())
        return 0
    weights = resume or SHIPPED
    found = finetune(
        cases, fine_tune.finetune, output, config, weights=weights, held_out=fine_tune.held_out,
        ordinary=fine_tune.ordinary, progress=terminal, each_epoch=show_epoch,
    )  # fmt: skip
    title = f"before ({weights.name}) and after ({output.name})"
    terminal.show(title, found.rows.to_dict())
    return 0


def _show_epoch(output: Path, of: int, resumable: bool, terminal: "Terminal", done: "list[Epoch]") -> None:
    from regents_cosim.system.interruption import announce_kept
    from regents_cosim.training.lessons.train_config import checkpoint_path

    last = done[-1]
    error = f"loss {last.loss_m:.3f} m, held back {last.held_back_m:.3f} m"
    terminal.say(f"epoch {len(done)} of {of}: {error}")
    if resumable:
        saved = checkpoint_path(output)
        announce_kept(f"epoch {len(done)} of {of} is saved; to go on: the same command with --resume {saved}")
