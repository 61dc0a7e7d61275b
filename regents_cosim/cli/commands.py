"""The commands: options in, calls of the package, tables out."""

import dataclasses
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from regents_cosim.cli.options import (
    Cases,
    Count,
    CountOrZero,
    FineTune,
    OutputOptions,
    ProgramOptions,
    SearchOptions,
    Seed,
    SumoOptions,
    Switch,
    TrafficOptions,
)
from regents_cosim.cli.shared import (
    draw,
    draw_stills,
    evaded_cases,
    exit_code,
    names_traffic,
    open_terminal,
    planner_errors,
    record_traffic,
    require_other_folder,
)
from regents_cosim.errors import PLANNER_FAILED, RegentsError

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.planners.aim_bev.train_config import Epoch


def _shown_default(value: object) -> str | None:
    """Defaults that say nothing are not shown; several words as they are typed."""
    if value is None or value is False or value in ("", ()):
        return None
    return " ".join(map(str, value)) if isinstance(value, tuple) else "on" if value is True else str(value)


app = App(
    name="regents",
    help="Crash-test driving planners: ordinary traffic in, a verified crash out.",
    help_format="plaintext",
    version=lambda: version("regents_cosim"),
    default_parameter=Parameter(negative_bool=(), negative_iterable=(), show_default=_shown_default),
)
training = App(name="train", help="Teach a planner to drive.")


@app.command
def record(
    *,
    traffic: TrafficOptions = TrafficOptions(),
    output: Annotated[Path, Parameter(["--output", "-o"])],
    executor: str = "local",
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
) -> int:
    """Cut windows of ordinary traffic into cases.

    Parameters
    ----------
    output
        folder for the cases
    executor
        where SUMO runs: local, or dask:ADDRESS
    """
    from regents_cosim.cases.suite import SuiteWriter
    from regents_cosim.reports.tables import RECORDED, case_row

    terminal = open_terminal(talk)
    suite = SuiteWriter(output, traffic.seed)
    scenarios = record_traffic(traffic, sumo, executor, terminal)
    for scenario in scenarios:
        suite.add(scenario)
    terminal.show(
        f"{len(scenarios)} cases in {output}",
        [case_row(scenario) for scenario in scenarios],
        essential=RECORDED,
    )
    return 0


@app.command
def inspect(
    log: Path,
    *,
    format: str = "auto",
    map: Path | None = None,
    columns: Path | None = None,
    output: Annotated[Path | None, Parameter(["--output", "-o"])] = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Say what logged traffic holds, and draw it.

    Parameters
    ----------
    log
        a file of logged traffic, or a folder of files
    format
        of the log; auto tells it by the content
    map
        lanelet2 map (.osm) that does not lie beside the log
    columns
        TOML file that names the columns of a table (csv, parquet)
    output
        folder for one picture per scenario
    """
    from regents_cosim.reports.log_picture import draw_scene
    from regents_cosim.reports.tables import INSPECTED, inspection_notes, inspection_row
    from regents_cosim.sources.logs.formats import CompanionFiles
    from regents_cosim.sources.logs.inspection import inspect_scene
    from regents_cosim.sources.logs.record import scenes_of

    terminal = open_terminal(talk)
    found = []
    for _, name, scene in scenes_of(log, format, CompanionFiles(map, columns)):
        found.append(inspect_scene(scene, name))
        if output is not None:
            draw_scene(scene, output)
    rows = [dataclasses.asdict(one) if talk.json else inspection_row(one) for one in found]
    terminal.show(f"{len(rows)} scenarios in {log}", rows, inspection_notes(found), INSPECTED)
    return 0


@app.command
def attack(
    cases: Cases | None = None,
    *,
    traffic: TrafficOptions = TrafficOptions(),
    planner: str = "idm",
    against: tuple[str, ...] = (),
    output: Annotated[Path, Parameter(["--output", "-o"])],
    search: SearchOptions = SearchOptions(),
    batch: Count = 32,
    engine: Literal["auto", "threads", "batched"] = "auto",
    act_timeout: float = 10.0,
    executor: str = "local",
    judge: Switch = True,
    verify: Switch = True,
    pictures: Switch = True,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
) -> int:
    """Find how another road user could make the planner crash; verify every crash in SUMO.

    Parameters
    ----------
    cases
        a case or a folder of cases, as `regents record` makes them; or name traffic with -c
    planner
        system under test: aim-bev, aim-bev:WEIGHTS, idm, log_replay, constant_velocity, sumo, highway:AGENT,
        torch:MODULE, exec:COMMAND, package.module:attribute or file.py:attribute
    against
        another planner (in JAX) that the same adversary is to make crash; as many as you like
    output
        folder for the attacked cases
    batch
        scenarios held on the device at once
    engine
        one scenario per core (threads), or `batch` searches in one program (batched); auto: batched on a GPU.
        The two round differently: their results are not equal bit for bit, and a search may end otherwise
    act_timeout
        a planner outside JAX that takes longer over one decision has failed [s]
    executor
        where SUMO runs: local, or dask:ADDRESS
    judge
        say of every crash what spoils it as a test, and whether the ego could have avoided it
    verify
        replay every crash in SUMO
    pictures
        draw a still picture into every case
    """
    from regents_cosim.attacks.attack import attack_each as run_attack_each
    from regents_cosim.cases.suite import SuiteWriter, load_suite
    from regents_cosim.replays.replay import verify_in_sumo
    from regents_cosim.reports.tables import ATTACKED, attack_row, summary
    from regents_cosim.system.workers import executor_for
    from regents_cosim.verdicts.judgement import judge_each

    terminal = open_terminal(talk)
    if (cases is None) == (not names_traffic(traffic)):
        raise RegentsError(
            "expected either a folder of cases or traffic "
            "(-c NAME.sumocfg, --from highway:ENVIRONMENT, --log PATH), not both"
        )
    if cases and sumo:
        raise RegentsError("what follows -- goes to SUMO, which records nothing here: leave it out, or name traffic")
    programs.keep()
    config = search.config()
    if cases is not None:
        require_other_folder(output, cases)
    suite = SuiteWriter(output, traffic.seed)
    scenarios = load_suite(cases) if cases else record_traffic(traffic, sumo, executor, terminal)
    attacked = []
    runs = run_attack_each(scenarios, config, planner, batch, engine=engine, act_timeout_s=act_timeout, against=against)
    for results in terminal.each(runs, "attacking", len(scenarios)):
        judged = list(judge_each(results)) if judge else results
        for scenario in judged:
            suite.add(scenario)
        attacked += judged
    with executor_for(executor) as pool:
        replays = verify_in_sumo(attacked, pool, terminal) if verify else {}
    if pictures:
        draw_stills(attacked, output, terminal)
    rows = [attack_row(scenario, replays.get(scenario.id)) for scenario in attacked]
    planners = " and ".join((planner, *against))
    title = f"{config.label} against {planners}: {len(rows)} cases in {output}"
    terminal.show(title, rows, summary(attacked, replays), ATTACKED)
    return max(exit_code(replays.values(), terminal), planner_errors(attacked, terminal))


@app.command
def replay(
    cases: Cases,
    *,
    where: Annotated[Literal["sumo", "highway", "mirror"], Parameter("--in")] = "sumo",
    mode: Literal["track", "actions"] = "track",
    background: Literal["log", "reactive"] = "log",
    ego: Literal["track", "planner", "evasion"] | None = None,
    planner: str | None = None,
    gui: bool = False,
    record: Path | None = None,
    beside_original: bool = False,
    executor: str = "local",
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Replay a case, or every case of a folder, and say whether the same crash happens.

    Parameters
    ----------
    cases
        a case or a folder of cases; shipped:standard and shipped:quickstart come with the package
    where
        in SUMO, in highway-env, or in the mirror
    mode
        in highway-env the others are placed on their tracks, or moved by its own physics (actions)
    background
        in SUMO the others follow their tracks, or only the adversary does and SUMO drives the rest (reactive)
    ego
        track: as in the case; planner: driven in closed loop by the planner (default where --planner is given);
        evasion: by the drive that avoids the collision
    planner
        who drives the ego; default the planner that was attacked, if it is one of ours: what a case names is not run;
        also sumo, and highway-env's agents:
        highway:idm, highway:mdp, highway:random, highway:package.module:attribute
    gui
        show it in the simulator's own window, sumo-gui or highway-env's
    record
        file for a picture of one case: .gif moves, .png is a still
    beside_original
        show the traffic before the attack beside it (.gif)
    executor
        where SUMO runs: local, or dask:ADDRESS
    """
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.planners.find import attacked_planner
    from regents_cosim.replays.replay import replay_each
    from regents_cosim.reports.tables import REPLAYED, replay_row, replay_summary, traffic_row
    from regents_cosim.system.workers import executor_for

    terminal = open_terminal(talk)
    scenarios = load_suite(cases)
    if (record or gui) and len(scenarios) > 1:
        raise RegentsError(f"{cases} holds {len(scenarios)} cases; --record and --gui show one, name its folder")
    if record and record.suffix not in (".gif", ".png"):
        raise RegentsError(f"--record {record}: expected a name that ends in .gif (moves) or .png (a still)")
    if beside_original and (record is None or record.suffix != ".gif" or scenarios[0].attack is None):
        raise RegentsError("--beside-original shows an attacked case in the .gif that --record names")
    driven_by = planner
    if ego == "planner" and planner is None:
        driven_by = attacked_planner(scenarios)
    if ego == "evasion":
        scenarios, driven_by = evaded_cases(scenarios, terminal), None
    with executor_for(executor) as pool:
        replays = replay_each(scenarios, where, driven_by if ego != "track" else None, gui, pool, mode, background)
        found = list(terminal.each(replays, f"replaying in {where}", len(scenarios)))
    if record and found[0].replayed:
        draw(found[0].replayed, record, beside_original, terminal)
    rows = [
        replay_row(result, not talk.json) | (traffic_row(result) if background == "reactive" else {})
        for result in found
    ]
    at_the_wheel = "its evasion" if ego == "evasion" else driven_by or "its track"
    title = f"replayed in {where}, the ego driven by {at_the_wheel}"
    terminal.show(title, rows, replay_summary(found, ego == "evasion"), REPLAYED)
    return exit_code(found, terminal)


@app.command
def export(
    case: Cases,
    *,
    to: Literal["fcd", "csv", "openscenario", "commonroad"],
    output: Annotated[Path, Parameter(["--output", "-o"])],
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Write a case as other tools read it.

    Parameters
    ----------
    case
        folder of one case
    to
        fcd: SUMO's FCD with net and configuration, which plain sumo-gui opens; csv: a table of tracks;
        openscenario: OpenSCENARIO 1.2 and OpenDRIVE; commonroad: CommonRoad 2020a
    output
        new folder for the files
    """
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.exports.export import export as run_export

    terminal = open_terminal(talk)
    scenarios = load_suite(case)
    if len(scenarios) > 1:
        raise RegentsError(f"{case} holds {len(scenarios)} cases; export takes one, name its folder")
    with terminal.waiting(f"writing {output}"):
        files = run_export(scenarios[0], to, output)
    rows = [{"file": file.name, "bytes": file.stat().st_size} for file in files]
    terminal.show(f"{scenarios[0].id} as {to} in {output}", rows)
    return 0


@app.command
def report(
    cases: Cases,
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    planner: tuple[str, ...] = (),
    act_timeout: float = 10.0,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """One HTML file with the scores, every case in a player, and what is known of it; opens anywhere, offline.

    Parameters
    ----------
    cases
        a case or a folder of cases; shipped:standard and shipped:quickstart come with the package
    output
        file for the page (.html); the scores and the table go into a .json beside it
    planner
        who drives the egos, among the adversaries of each case; once more: a second one beside it, to see what it fixes
        and breaks. Without it the report shows the drives that the cases hold
    act_timeout
        a planner outside JAX that takes longer over one decision has failed [s]
    """
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.reports.report import check_report, drive_for_report, judge_rest, report_of, save_report
    from regents_cosim.reports.tables import SCORED

    terminal = open_terminal(talk)
    check_report(output, planner)
    loaded = load_suite(cases)
    scenarios = list(terminal.each(judge_rest(loaded), "judging crashes", len(loaded)))
    programs.keep()
    driven = {
        name: list(terminal.each(drive_for_report(scenarios, name, act_timeout), f"driving {name}", len(scenarios)))
        for name in planner
    }
    with terminal.waiting(f"writing {output}"):
        made = report_of(scenarios, driven, cases)
        save_report(made, output)
    rows = [{"score": s.label, "driver": s.driver, "value": s.value, "detail": s.detail} for s in made.scores]
    terminal.show(f"{len(scenarios)} cases in {output}", rows, essential=SCORED)
    errors = [(case.scenario.id, run) for case in made.cases for run in case.runs if run.error]
    for name, run in errors:
        terminal.say(f"{name}: {run.driver}: {run.error}")
    return PLANNER_FAILED if errors else 0


@training.command(name="aim-bev")
def train_aim_bev(
    cases: Cases,
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
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


@app.command
def gallery(
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Make the figures of the ReGentS paper anew: gradients around the ego, and how KING fails.

    Parameters
    ----------
    output
        folder for the pictures, their page README.md, and the cases behind them
    """
    from regents_cosim.benchmarks.gallery.make import make_gallery
    from regents_cosim.reports.tables import ATTACKED, attack_row

    terminal = open_terminal(talk)
    programs.keep()
    with terminal.waiting("making the gallery"):
        attacked = make_gallery(output)
    rows = [attack_row(scenario, None) for scenario in attacked]
    note = f"pictures and what they show: {output / 'README.md'}"
    terminal.show(f"{len(rows)} attacked scenes", rows, note, ATTACKED)
    return 0
