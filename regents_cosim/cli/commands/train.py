"""`regents train`: teach a planner to drive."""

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from regents_cosim.cli.options import Cases, Count, CountOrZero, FineTune, Output, OutputOptions, Seed
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.planners.aim_bev.train_config import Epoch

training = App(name="train", help="Teach a planner to drive.")


@training.command(name="aim-bev")
def train_aim_bev(
    cases: Cases,
    *,
    output: Output,
    epochs: Count | None = None,
    lessons: Count | None = None,
    drives: CountOrZero | None = None,
    frozen: CountOrZero | None = None,
    learning_rate: Annotated[float | None, Parameter(validator=Number(gt=0.0, lte=10.0))] = None,
    teacher: Literal["log", "idm"] | None = None,
    threads: Count = 2,
    seed: Seed = 0,
    resume: Path | None = None,
    fine_tune: FineTune = FineTune(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Teach AIM-BEV the traffic of recorded cases; needs torch (pip install 'regents_cosim[torch]').

    Every vehicle near the ego of a case is a teacher. After each epoch the weights, a checkpoint and a picture of
    the training are written. With --finetune it also learns from its own crashes.

    Parameters
    ----------
    cases
        a folder of cases, as `regents record` makes them
    output
        file for the weights (.safetensors)
    epochs
        passes; the learning rate falls to a hundredth over them; 40, or 8 with --finetune
    lessons
        new ones per epoch; each is repeated in four epochs; 4096, or 2048 that are repeated to the end with --finetune
    drives
        drives of the network by itself per epoch, from whose states it learns as well; 40, or 24 with --finetune
    frozen
        first layers of the encoder that learn no more, for a warm start; an epoch costs half with 4, a quarter with 8;
        0, or 4 with --finetune
    learning_rate
        of Adam, at the first epoch; 1e-3, or 5e-4 with --finetune
    teacher
        "log": every vehicle near an ego shows how to drive; "idm": an IDM in the ego's place that sees no further than
        the view, which can tell what to do wherever the network has got to by itself; "idm" with --finetune, else "log"
    threads
        of torch
    seed
        of everything that is drawn
    resume
        a checkpoint to go on from, or weights for a warm start
    """
    from regents_cosim.evaluation.training.fine_tuning import finetune, train
    from regents_cosim.planners.aim_bev.train_config import FINE_TUNING, TrainConfig
    from regents_cosim.planners.aim_bev.weights_file import SHIPPED

    terminal = open_terminal(talk)
    given = {
        "epochs": epochs, "lessons": lessons, "drives": drives, "frozen": frozen, "learning_rate": learning_rate,
        "teacher": teacher, "evading": fine_tune.evading,
    }  # fmt: skip
    config = dataclasses.replace(
        FINE_TUNING if fine_tune.finetune else TrainConfig(),
        **{name: value for name, value in given.items() if value is not None},
        seed=seed,
        threads=threads,
    )
    show_epoch = partial(_show_epoch, output, config.epochs, fine_tune.finetune is None, terminal)
    if fine_tune.finetune is None:
        if fine_tune.held_out or fine_tune.ordinary:
            raise RegentsError("--held-out and --ordinary judge a fine-tuning; expected --finetune SUITE with them")
        done = train(cases, output, config, resume=resume, progress=terminal, each_epoch=show_epoch)
        terminal.show(f"weights in {output}", [dataclasses.asdict(epoch) for epoch in done])
        return 0
    weights = resume or SHIPPED
    found = finetune(
        cases, fine_tune.finetune, output, config, weights=weights, held_out=fine_tune.held_out,
        ordinary=fine_tune.ordinary, progress=terminal, each_epoch=show_epoch,
    )  # fmt: skip
    title = f"before ({weights.name}) and after ({output.name})"
    terminal.show(title, [dataclasses.asdict(row) for row in found.rows])
    return 0


def _show_epoch(output: Path, of: int, resumable: bool, terminal: "Terminal", done: "list[Epoch]") -> None:
    """A line, and the curve so far."""
    from regents_cosim.planners.aim_bev.train_config import checkpoint_path
    from regents_cosim.reports.curve import draw_curve
    from regents_cosim.system.interruption import keep

    last = done[-1]
    error = f"loss {last.loss_m:.3f} m, held back {last.held_back_m:.3f} m"
    terminal.say(f"epoch {len(done)} of {of}: {error}")
    lines = {"loss [m]": [e.loss_m for e in done], "held back [m]": [e.held_back_m for e in done]}
    names = [f"epoch {number}" for number in range(1, len(done) + 1)]
    draw_curve("AIM-BEV: error of the waypoints", lines, names, output.with_suffix(".png"))
    if resumable:
        saved = checkpoint_path(output)
        keep(f"epoch {len(done)} of {of} is saved; to go on: the same command with --resume {saved}")
