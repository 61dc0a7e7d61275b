"""The command line: options in, calls of the package, tables out. Nothing else lives here.

Heavy imports happen inside the commands, so that `--help` answers at once. What follows `--`
goes to SUMO. Exit codes: 0 clean, 1 a failed verification or planner, 2 wrong usage or input.
"""

import dataclasses
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.attacks.presets import AttackConfig
    from regents_cosim.replays.verify import Replay
    from regents_cosim.scenario import Scenario
    from regents_cosim.terminal import Terminal

app = App(
    name="regents",
    help="Crash-test driving planners: ordinary traffic in, a verified crash out.",
    help_format="plaintext",
    version=lambda: version("regents_cosim"),
)
bench = App(name="bench", help="Measure, and print the tables of the README.")
app.command(bench)
training = App(name="train", help="Teach a planner to drive.")
app.command(training)


@Parameter(name="*")
@dataclass(frozen=True)
class Traffic:
    """Ordinary traffic, in SUMO's own option names, and the windows to cut out of it."""

    config: Annotated[Path | None, Parameter(["--configuration-file", "-c"])] = None
    """SUMO configuration (.sumocfg)"""
    net: Annotated[Path | None, Parameter(["--net-file", "-n"])] = None
    """SUMO network (.net.xml, .net.xml.gz)"""
    routes: Annotated[str, Parameter(["--route-files", "-r"])] = ""
    """route files, separated by commas"""
    additional: Annotated[str, Parameter(["--additional-files", "-a"])] = ""
    """additional files, separated by commas"""
    begin: Annotated[float | None, Parameter(["--begin", "-b"])] = None
    """begin of the simulation [s]"""
    end: Annotated[float | None, Parameter(["--end", "-e"])] = None
    """end of the simulation [s]"""
    step_length: float = 0.1
    """step of the simulation [s]; recordings are made at 0.1 s only"""
    fcd: Path | None = None
    """an fcd-output of SUMO (xml, xml.gz, csv) to read instead of running SUMO; needs -n"""
    log: Path | None = None
    """logged traffic to read instead: a file, or a folder of files"""
    format: str = "auto"
    """of the log; auto tells it by the content, a wrong name lists all"""
    ego: str = "auto"
    """id of a logged road user; auto: the recorder's vehicle or the planning problem's, else one drawn by seed"""
    stride: float | None = None
    """from one window of a log to the next [s]; the horizon by default"""
    map: Path | None = None
    """lanelet2 map (.osm) of a log that does not lie beside it"""
    columns: Path | None = None
    """TOML file that names the columns of a table (csv, parquet)"""
    source: Annotated[str, Parameter("--from")] = ""
    """highway:ENVIRONMENT instead of SUMO, e.g. highway:merge-v1"""
    policy: str = "idm"
    """who drives the ego in highway-env: idm, mdp, random, package.module:attribute or file.py:attribute"""
    count: int = 8
    """windows wanted"""
    seed: int = 0
    """of SUMO and of the choice of windows"""
    horizon: float = 8.0
    """length of a window [s]; of a log that is shorter, all of it"""
    radius: float = 100.0
    """agents that never come closer to the ego are left out [m]"""


@Parameter(name="*")
@dataclass(frozen=True)
class Search:
    """How the attack searches; what is not given is the preset's."""

    method: Literal["regents", "king", "focused"] = "regents"
    """preset: king and regents of the papers; focused, our own, finds more crashes that mean something"""
    search: Literal["joint", "per-candidate"] | None = None
    """one search over all candidates, or one for each of the nearest (every adversary found is a case)"""
    background: Literal["log", "reactive"] | None = None
    """do other agents replay their log, or brake for what stands in their way"""
    dynamics: Literal["recorded", "bicycle", "highway"] | None = None
    """how vehicles move: by the mirror's bicycle, or exactly as in highway-env; recorded: as where the case is from"""
    gradient: Literal["adversary", "through-planner"] | None = None
    """is the planner's track constant to the gradient, or is the planner (in JAX) differentiated as well"""
    as_published: bool | None = None
    """do as the public ReGentS code where it departs from its paper (king and regents only)"""
    iterations: int | None = None
    """updates at most"""
    replan_every: int | None = None
    """iterations between two closed loops of the planner; 1 in the compiled loop, 10 for planners outside it"""
    max_deviation: float | None = None
    """of an action from the logged one, as a share of its limit; 0: no bound"""
    max_lateral_accel: float | None = None
    """of the adversary, unless its log has more [m/s^2]; 0: no bound"""

    def config(self) -> "AttackConfig":
        """The preset with what was given in its place."""
        from regents_cosim.attacks.presets import METHODS

        given = {name: value for name, value in vars(self).items() if name != "method" and value is not None}
        return dataclasses.replace(METHODS[self.method], **given)


@Parameter(name="*")
@dataclass(frozen=True)
class Talk:
    """How results are shown."""

    quiet: bool = False
    """no progress, only the result"""
    json: bool = False
    """print the result as JSON"""


SumoOptions = Annotated[tuple[str, ...], Parameter("--sumo-option", show=False, allow_leading_hyphen=True)]


@app.command
def record(
    traffic: Traffic = Traffic(),
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    executor: str = "local",
    talk: Talk = Talk(),
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
    from regents_cosim.reports.tables import case_row
    from regents_cosim.suite import SuiteWriter

    terminal = _terminal(talk)
    suite = SuiteWriter(output, traffic.seed)
    scenarios = _record(traffic, sumo, executor, terminal)
    for scenario in scenarios:
        suite.add(scenario)
    terminal.show(
        f"{len(scenarios)} cases in {output}",
        [case_row(scenario) for scenario in scenarios],
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
    talk: Talk = Talk(),
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
    from regents_cosim.reports.tables import inspection_notes, inspection_row
    from regents_cosim.sources.logs.formats import Beside
    from regents_cosim.sources.logs.inspection import inspect_scene
    from regents_cosim.sources.logs.record import scenes_of

    terminal = _terminal(talk)
    found = []
    for _, name, scene in scenes_of(log, format, Beside(map, columns)):
        found.append(inspect_scene(scene, name))
        if output is not None:
            draw_scene(scene, output)
    rows = [dataclasses.asdict(one) if talk.json else inspection_row(one) for one in found]
    terminal.show(f"{len(rows)} scenarios in {log}", rows, inspection_notes(found))
    return 0


@app.command
def attack(
    cases: Annotated[Path | None, Parameter(show_default=False)] = None,
    traffic: Traffic = Traffic(),
    *,
    planner: str = "idm",
    output: Annotated[Path, Parameter(["--output", "-o"])],
    search: Search = Search(),
    batch: int = 32,
    engine: Literal["auto", "threads", "lanes"] = "auto",
    act_timeout: float = 10.0,
    executor: str = "local",
    verify: bool = True,
    pictures: bool = True,
    compile_cache: bool = True,
    talk: Talk = Talk(),
    sumo: SumoOptions = (),
) -> int:
    """Find how another road user could make the planner crash; verify every crash in SUMO.

    Parameters
    ----------
    cases
        a case or a folder of cases, as `regents record` makes them; or name traffic with -c
    planner
        system under test: aim-bev, idm, log_replay, constant_velocity, package.module:attribute or file.py:attribute
    output
        folder for the attacked cases
    batch
        scenarios held on the device at once
    engine
        one scenario per core (threads), or `batch` searches in one program (lanes); auto: lanes where there is a GPU
    act_timeout
        a planner outside JAX that takes longer over one decision has failed [s]
    executor
        where SUMO runs: local, or dask:ADDRESS
    verify
        replay every crash in SUMO
    pictures
        draw a still picture into every case
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.attacks.attack import attack_each as run_attack_each
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.reports.tables import attack_row, summary
    from regents_cosim.suite import SuiteWriter, load_cases

    terminal = _terminal(talk)
    if (cases is None) == (not _names_traffic(traffic)):
        raise RegentsError(
            "expected either a folder of cases or traffic "
            "(-c NAME.sumocfg, --from highway:ENVIRONMENT, --log PATH), not both"
        )
    if compile_cache:
        keep_compiled_programs()
    config = search.config()
    suite = SuiteWriter(output, traffic.seed)
    scenarios = load_cases(cases) if cases else _record(traffic, sumo, executor, terminal)
    attacked = []
    runs = run_attack_each(scenarios, config, planner, batch, engine=engine, act_timeout_s=act_timeout)
    for results in terminal.each(runs, "attacking", len(scenarios)):
        for scenario in results:
            suite.add(scenario)
        attacked += results
    replays = _verify(attacked, executor, terminal) if verify else {}
    if pictures:
        _draw_stills(attacked, output, terminal)
    rows = [attack_row(scenario, replays.get(scenario.id)) for scenario in attacked]
    terminal.show(f"{config.label} against {planner}: {len(rows)} cases in {output}", rows, summary(attacked, replays))
    return max(_exit_code(replays.values(), terminal), _planner_errors(attacked, terminal))


@app.command
def replay(
    cases: Path,
    *,
    where: Annotated[Literal["sumo", "highway", "mirror"], Parameter("--in")] = "sumo",
    mode: Literal["track", "actions"] = "track",
    ego: Literal["track", "planner"] | None = None,
    planner: str | None = None,
    gui: bool = False,
    record: Path | None = None,
    beside_original: bool = False,
    executor: str = "local",
    talk: Talk = Talk(),
    sumo: SumoOptions = (),
) -> int:
    """Replay a case, or every case of a folder, and say whether the same crash happens.

    Parameters
    ----------
    cases
        a case or a folder of cases
    where
        in SUMO, in highway-env, or in the mirror
    mode
        in highway-env the others are placed on their tracks, or moved by its own physics (actions)
    ego
        track: as in the case; planner: driven in closed loop by the planner (default where --planner is given)
    planner
        who drives the ego; default the planner that was attacked; also sumo, and highway-env's agents:
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
    from regents_cosim.replays.replay import replay_each
    from regents_cosim.reports.tables import replay_row
    from regents_cosim.suite import load_cases
    from regents_cosim.workers import executor_for

    terminal = _terminal(talk)
    scenarios = load_cases(cases)
    if (record or gui) and len(scenarios) > 1:
        raise RegentsError(f"{cases} holds {len(scenarios)} cases; --record and --gui show one, name its folder")
    if record and record.suffix not in (".gif", ".png"):
        raise RegentsError(f"--record {record}: expected a name that ends in .gif (moves) or .png (a still)")
    if beside_original and (record is None or record.suffix != ".gif" or scenarios[0].attack is None):
        raise RegentsError("--beside-original shows an attacked case in the .gif that --record names")
    driven_by = planner
    if ego == "planner" and planner is None:
        driven_by = _attacked_planner(scenarios)
    with executor_for(executor) as pool:
        replays = replay_each(scenarios, where, driven_by if ego != "track" else None, gui, pool, mode)
        found = list(terminal.each(replays, f"replaying in {where}", len(scenarios)))
    if record and found[0].replayed:
        _draw(found[0].replayed, record, beside_original, terminal)
    rows = [replay_row(result) for result in found]
    terminal.show(f"replayed in {where}, the ego driven by {driven_by or 'its track'}", rows)
    return _exit_code(found, terminal)


@app.command
def evaluate(
    cases: Path,
    *,
    planner: str,
    where: Annotated[Literal["mirror", "sumo", "highway"], Parameter("--in")] = "mirror",
    act_timeout: float = 10.0,
    executor: str = "local",
    compile_cache: bool = True,
    talk: Talk = Talk(),
) -> int:
    """How well a planner drives: route completion, collision rate and driving score.

    Parameters
    ----------
    cases
        a case or a folder of cases; attacked ones are driven among their adversaries
    planner
        system under test: aim-bev, idm, log_replay, constant_velocity, package.module:attribute or file.py:attribute;
        in highway-env also its own agents: highway:idm, highway:mdp, highway:random, highway:package.module:attribute
    where
        in the mirror, in SUMO, or in highway-env
    act_timeout
        in the mirror, a planner outside JAX that takes longer over one decision has failed [s]
    executor
        where SUMO runs: local, or dask:ADDRESS
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.evaluation.driving import drive_each, driving_rows
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.suite import load_cases
    from regents_cosim.workers import executor_for

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    scenarios = load_cases(cases)
    with executor_for(executor) as pool:
        found = drive_each(scenarios, planner, act_timeout, where, pool)
        drives = list(terminal.each(found, f"driving {planner}", len(scenarios)))
    rows = [dataclasses.asdict(row) for row in driving_rows(drives)]
    terminal.show(f"{planner} on {len(drives)} cases in {where}", rows)
    errors = [drive for drive in drives if drive.error]
    for drive in errors:
        terminal.say(f"{drive.case}: {drive.error}")
    return 1 if errors else 0


@training.command(name="aim-bev")
def train_aim_bev(
    cases: Path,
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    epochs: int = 40,
    lessons: int = 4096,
    drives: int = 40,
    frozen: int = 0,
    learning_rate: float = 1e-3,
    threads: int = 2,
    seed: int = 0,
    resume: Path | None = None,
    talk: Talk = Talk(),
) -> int:
    """Teach AIM-BEV the traffic of recorded cases; needs torch (pip install 'regents_cosim[torch]').

    Every vehicle near the ego of a case is a teacher. After each epoch the weights, a checkpoint and a picture of
    the training are written.

    Parameters
    ----------
    cases
        a folder of cases, as `regents record` makes them
    output
        file for the weights (.safetensors)
    epochs
        passes; the learning rate falls to a hundredth over them
    lessons
        new ones per epoch; each is repeated in four epochs
    drives
        drives of the network by itself per epoch, from whose states it learns as well
    frozen
        first layers of the encoder that learn no more, for a warm start; an epoch costs half with 4, a quarter with 8
    learning_rate
        of Adam, at the first epoch
    threads
        of torch
    seed
        of everything that is drawn
    resume
        a checkpoint to go on from, or weights for a warm start
    """
    from regents_cosim.atomic import require_writable
    from regents_cosim.reports.curve import draw_curve
    from regents_cosim.suite import load_cases

    terminal = _terminal(talk)
    if output.suffix != ".safetensors":
        raise RegentsError(f"--output {output}: expected a name that ends in .safetensors")
    require_writable(output.parent)
    try:
        from regents_cosim.planners.aim_bev.train import TrainConfig, train
    except ModuleNotFoundError as error:
        raise RegentsError(f"training needs {error.name}: pip install 'regents_cosim[torch]'") from error
    config = TrainConfig(
        epochs, seed, lessons, learning_rate=learning_rate, frozen=frozen, drives=drives, threads=threads
    )
    scenarios = load_cases(cases)
    output.parent.mkdir(parents=True, exist_ok=True)
    done = []
    for done in terminal.each(train(scenarios, output, config, resume), "training", epochs):
        last = done[-1]
        terminal.say(f"epoch {len(done)} of {epochs}: loss {last.loss_m:.3f} m, held back {last.held_back_m:.3f} m")
        lines = {"loss [m]": [e.loss_m for e in done], "held back [m]": [e.held_back_m for e in done]}
        draw_curve("AIM-BEV: error of the waypoints", lines, output.with_suffix(".png"))
    terminal.show(f"weights in {output}", [dataclasses.asdict(epoch) for epoch in done])
    return 0


@app.command
def gallery(
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    compile_cache: bool = True,
    talk: Talk = Talk(),
) -> int:
    """Make the figures of the ReGentS paper anew: gradients around the ego, and how KING fails.

    Parameters
    ----------
    output
        folder for the pictures, their page README.md, and the cases behind them
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.evaluation.gallery.make import make_gallery
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.reports.tables import attack_row

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    with terminal.waiting("making the gallery"):
        attacked = make_gallery(output)
    rows = [attack_row(scenario, None) for scenario in attacked]
    terminal.show(f"{len(rows)} attacked scenes", rows, f"pictures and what they show: {output / 'README.md'}")
    return 0


@bench.command
def reconstruction(*, count: int = 20, seed: int = 0, nets: tuple[str, ...] = (), talk: Talk = Talk()) -> int:
    """How well the mirror's controls reproduce SUMO's tracks, per network.

    Parameters
    ----------
    count
        windows per network
    nets
        shipped networks, or .sumocfg files; all shipped ones by default
    """
    from regents_cosim.evaluation.benchmark import reconstruction_row

    terminal = _terminal(talk)
    traffic = _bench_traffic(nets, count, seed, terminal)
    rows = [
        dataclasses.asdict(reconstruction_row(net, scenarios))
        for net, scenarios in terminal.each(traffic.items(), "fitting", len(traffic))
    ]
    terminal.show("position error of roll-outs against the recorded tracks", rows)
    return 0


@bench.command
def success(
    *,
    count: int = 20,
    seed: int = 0,
    nets: tuple[str, ...] = (),
    logs: tuple[Path, ...] = (),
    planners: tuple[str, ...] = ("log_replay", "idm"),
    methods: tuple[Literal["king", "regents", "focused"], ...] = ("king", "regents", "focused"),
    as_published: bool = False,
    searches: tuple[Literal["joint", "per-candidate"], ...] = (),
    backgrounds: tuple[Literal["log", "reactive"], ...] = (),
    replan_every: int | None = None,
    compile_cache: bool = True,
    talk: Talk = Talk(),
) -> int:
    """How often attacks make planners crash, each crash verified in SUMO.

    Parameters
    ----------
    count
        windows per network
    nets
        shipped networks, or .sumocfg files; all shipped ones by default
    logs
        logged traffic (files, or folders of them) in place of networks; `count` windows of each
    planners
        systems under test
    methods
        presets
    as_published
        do as the public ReGentS code where it departs from its paper (king and regents only)
    searches
        one search over all candidates, one for each of the nearest, or both; the preset's by default
    backgrounds
        others replay their log, or brake for what stands in their way, or both; the preset's by default
    replan_every
        iterations between two closed loops of the planners
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.attacks.attack import attack_each
    from regents_cosim.evaluation.benchmark import success_row
    from regents_cosim.mirror.compile_cache import keep_compiled_programs

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    traffic = _bench_logs(logs, count, seed, terminal) if logs else _bench_traffic(nets, count, seed, terminal)
    windows = [scenario for found in traffic.values() for scenario in found]
    rows = []
    for planner, method, search, background in product(planners, methods, searches or (None,), backgrounds or (None,)):
        config = Search(method, search, background, as_published=as_published, replan_every=replan_every).config()
        results = attack_each(windows, config, planner)
        attacked = list(terminal.each(results, f"{method} against {planner}", len(windows)))
        replays = _verify([case for found in attacked for case in found], "local", terminal)
        rows.append(dataclasses.asdict(success_row(config, planner, attacked, list(replays.values()))))
    terminal.show(f"attacks on {len(windows)} windows", rows)
    return 0


@bench.command
def replan(
    *,
    planner: str,
    count: int = 9,
    seed: int = 0,
    nets: tuple[str, ...] = (),
    every: tuple[int, ...] = (1, 10),
    method: Literal["king", "regents"] = "regents",
    act_timeout: float = 10.0,
    compile_cache: bool = True,
    talk: Talk = Talk(),
) -> int:
    """What it changes, and saves, to let the planner drive in every k-th iteration of the search only.

    Parameters
    ----------
    planner
        system under test
    count
        windows per network
    nets
        shipped networks, or .sumocfg files; all shipped ones by default
    every
        values of --replan-every; the first is what the others are compared with
    method
        preset
    act_timeout
        a planner outside JAX that takes longer over one decision has failed [s]
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from time import perf_counter

    from regents_cosim.attacks.attack import attack as run_attack
    from regents_cosim.evaluation.replanning import replan_row
    from regents_cosim.mirror.compile_cache import keep_compiled_programs

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    windows = [scenario for found in _bench_traffic(nets, count, seed, terminal).values() for scenario in found]
    runs = {}
    for one in every:
        config = Search(method, replan_every=one).config()
        for _ in run_attack(_one_of_each_shape(windows), config, planner, act_timeout_s=act_timeout):
            pass  # compiles
        begin = perf_counter()
        results = run_attack(windows, config, planner, act_timeout_s=act_timeout)
        attacked = list(terminal.each(results, f"every {one}", len(windows)))
        runs[one] = attacked, perf_counter() - begin
    first = runs[every[0]][0]
    rows = [replan_row(one, attacked, first, seconds) for one, (attacked, seconds) in runs.items()]
    terminal.show(f"{planner} on {len(windows)} windows", [dataclasses.asdict(row) for row in rows])
    return 0


@bench.command
def logs(paths: tuple[Path, ...], *, count: int = 8, talk: Talk = Talk()) -> int:
    """How well logs are read: vehicles on the road, error of the smooth fit, time.

    Parameters
    ----------
    paths
        logs, or folders of them
    count
        windows per scene at most
    """
    from regents_cosim.evaluation.log_benchmark import log_rows

    terminal = _terminal(talk)
    with terminal.waiting("reading and fitting"):
        rows = [dataclasses.asdict(row) for row in log_rows(list(paths), count)]
    terminal.show("logged traffic, per format", rows)
    return 0


@bench.command
def highway(
    *,
    count: int = 25,
    seed: int = 0,
    envs: tuple[str, ...] = ("merge-v1", "roundabout-v1", "intersection-v2", "highway-v0"),
    policy: str = "idm",
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[Literal["king", "regents", "focused"], ...] = ("king", "regents"),
    compile_cache: bool = True,
    talk: Talk = Talk(),
) -> int:
    """How often attacks on highway-env's own traffic succeed, and whether the crashes happen in highway-env.

    Parameters
    ----------
    count
        windows per environment
    envs
        environments of highway-env
    policy
        who drives the ego in the recordings
    planners
        systems under test
    methods
        presets
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.attacks.attack import attack_each
    from regents_cosim.attacks.presets import METHODS
    from regents_cosim.evaluation.transfer import highway_row
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.sources.record import record as run_record

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    windows = {
        env: run_record(f"highway:{env}", policy=policy, count=count, seed=seed)
        for env in terminal.each(envs, "recording traffic", len(envs))
    }
    rows = []
    for planner in planners:
        for method in methods:
            for env, found in windows.items():
                results = attack_each(found, METHODS[method], planner)
                attacked = [s for each in terminal.each(results, f"{method} in {env}", len(found)) for s in each]
                rows.append(dataclasses.asdict(highway_row(env, METHODS[method], planner, attacked)))
    terminal.show(f"attacks on {sum(map(len, windows.values()))} windows, replayed in highway-env", rows)
    return 0


@bench.command
def transfer(cases: Path, *, talk: Talk = Talk()) -> int:
    """Whether the crashes of a folder of cases happen in SUMO (where that is their source) and in highway-env.

    Parameters
    ----------
    cases
        a case or a folder of cases
    """
    from regents_cosim.evaluation.transfer import transfer_rows
    from regents_cosim.suite import load_cases

    terminal = _terminal(talk)
    with terminal.waiting("replaying"):
        rows = [dataclasses.asdict(row) for row in transfer_rows(load_cases(cases))]
    terminal.show(f"transfer of {cases}", rows)
    return 0


# --- pieces shared by the commands ------------------------------------------------------------


def _terminal(talk: Talk) -> "Terminal":
    from regents_cosim.terminal import Terminal

    return Terminal(talk.quiet, talk.json)


def _record(traffic: Traffic, sumo: tuple[str, ...], executor: str, terminal: "Terminal") -> "list[Scenario]":
    from regents_cosim.sources.record import record as run_record
    from regents_cosim.sources.sumo_config import SumoInput
    from regents_cosim.workers import executor_for

    if not _names_traffic(traffic):
        raise RegentsError(
            "no traffic named (expected -c NAME.sumocfg, -n NET with -r ROUTES or --fcd LOG, "
            "--from highway:ENVIRONMENT, or --log PATH)"
        )
    if traffic.log is not None:
        return _record_log(traffic, terminal)
    if traffic.source and not traffic.source.startswith("highway:"):
        raise RegentsError(f"--from {traffic.source}: expected highway:ENVIRONMENT, e.g. highway:merge-v1")
    source = traffic.source or SumoInput(
        config=traffic.config,
        net=traffic.net,
        routes=_files(traffic.routes),
        additional=_files(traffic.additional),
        begin_s=traffic.begin,
        end_s=traffic.end,
        extra=(*sumo, *(() if traffic.step_length == 0.1 else (f"--step-length={traffic.step_length}",))),
    )
    with executor_for(executor) as pool, terminal.waiting("recording traffic"):
        found = run_record(
            source,
            fcd=traffic.fcd,
            policy=traffic.policy,
            count=traffic.count,
            seed=traffic.seed,
            horizon_s=traffic.horizon,
            radius_m=traffic.radius,
            executor=pool,
        )
    if len(found) < traffic.count:
        terminal.say(f"found {len(found)} of the {traffic.count} windows asked for: the traffic holds no more")
    return found


def _record_log(traffic: Traffic, terminal: "Terminal") -> "list[Scenario]":
    from regents_cosim.sources.logs.formats import Beside
    from regents_cosim.sources.logs.record import record_log

    if traffic.config or traffic.net or traffic.fcd or traffic.source:
        raise RegentsError("--log stands alone; SUMO's own fcd-output is read with --fcd LOG -n NET")
    assert traffic.log is not None
    with terminal.waiting("reading the log"):
        return record_log(
            traffic.log,
            format=traffic.format,
            ego=traffic.ego,
            count=traffic.count,
            seed=traffic.seed,
            horizon_s=traffic.horizon,
            stride_s=traffic.stride,
            radius_m=traffic.radius,
            beside=Beside(traffic.map, traffic.columns),
            tell=terminal.say,
        )


def _names_traffic(traffic: Traffic) -> bool:
    return bool(traffic.config or traffic.net or traffic.source or traffic.log)


def _files(names: str) -> tuple[Path, ...]:
    return tuple(Path(name.strip()) for name in names.split(",") if name.strip())


def _bench_traffic(nets: tuple[str, ...], count: int, seed: int, terminal: "Terminal") -> "dict[str, list[Scenario]]":
    from regents_cosim.shipped import NETWORKS, network_config
    from regents_cosim.sources.record import record as run_record

    configs = {net: Path(net) if net.endswith(".sumocfg") else network_config(net) for net in nets or NETWORKS}
    return {
        net: run_record(config, count=count, seed=seed)
        for net, config in terminal.each(configs.items(), "recording traffic", len(configs))
    }


def _one_of_each_shape(windows: "list[Scenario]") -> "list[Scenario]":
    """A scenario for each of the shapes that programs are compiled for."""
    from regents_cosim.mirror.world import padded_agents

    return list({(padded_agents(len(w.agents)), w.tracks.steps): w for w in windows}.values())


def _bench_logs(logs: tuple[Path, ...], count: int, seed: int, terminal: "Terminal") -> "dict[Path, list[Scenario]]":
    from regents_cosim.sources.logs.record import record_log

    return {
        log: record_log(log, count=count, seed=seed, tell=terminal.say)
        for log in terminal.each(logs, "reading logs", len(logs))
    }


def _verify(attacked: "list[Scenario]", executor: str, terminal: "Terminal") -> "dict[str, Replay]":
    """Replays in SUMO of the crashes among `attacked` that have a SUMO network, by case."""
    from regents_cosim.replays.replay import replay_each
    from regents_cosim.workers import executor_for

    crashes = [s for s in attacked if s.attack and s.attack.outcome == "collision" and s.road.sumo_net]
    with executor_for(executor) as pool:
        replays = replay_each(crashes, "sumo", executor=pool)
        return {replay.case: replay for replay in terminal.each(replays, "verifying in SUMO", len(crashes))}


def _attacked_planner(scenarios: "list[Scenario]") -> str:
    planners = {scenario.attack.planner for scenario in scenarios if scenario.attack}
    if len(planners) != 1:
        raise RegentsError("the cases do not name one planner that was attacked; name it with --planner")
    return planners.pop()


def _draw_stills(attacked: "list[Scenario]", suite: Path, terminal: "Terminal") -> None:
    from regents_cosim.reports.picture import draw_still

    for scenario in terminal.each(attacked, "drawing", len(attacked)):
        draw_still(scenario, suite / scenario.id / "still.png")


def _draw(scenario: "Scenario", path: Path, beside_original: bool, terminal: "Terminal") -> None:
    from regents_cosim.reports.picture import animate, animate_pair, draw_still

    with terminal.waiting(f"drawing {path}"):
        if beside_original:
            animate_pair(scenario.before_attack(), scenario, path)
        else:
            (animate if path.suffix == ".gif" else draw_still)(scenario, path)


def _planner_errors(attacked: "list[Scenario]", terminal: "Terminal") -> int:
    """1 where the planner failed; says how."""
    records = [scenario.attack for scenario in attacked if scenario.attack and scenario.attack.planner_error]
    for record in records:
        terminal.say(f"{record.case}: {record.planner_error.partition(chr(10))[0]}")
    return 1 if records else 0


def _exit_code(replays: "Iterable[Replay]", terminal: "Terminal") -> int:
    """1 where a replay differs from its case; says why."""
    failed = [replay for replay in replays if not replay.verified]
    for replay in failed:
        terminal.say(f"{replay.case}: {replay.reason}")
    return 1 if failed else 0


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Our words, and those after `--`, which are SUMO's."""
    words = list(arguments)
    at = words.index("--") if "--" in words else len(words)
    return words[:at], words[at + 1 :]


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    mine, for_sumo = _split(arguments)
    words = [*mine, *(f"--sumo-option={word}" for word in for_sumo)]
    try:
        code = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _complain(f"{error} (see `regents {mine[0] if mine else ''} --help`)", 2)
    except RegentsError as error:
        return _complain(str(error), error.exit_code)
    except BrokenPipeError:  # whoever read the table has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return _complain("interrupted; cases that were finished are saved", 130)
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point `regents`."""
    sys.exit(run(sys.argv[1:]))


def _complain(message: str, code: int) -> int:
    print(f"regents: {' '.join(message.split())}", file=sys.stderr)
    return code
