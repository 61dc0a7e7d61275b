"""The command line: options in, calls of the package, tables out. Nothing else lives here.

Heavy imports happen inside the commands, so that `--help` answers at once. What follows `--`
goes to SUMO. Exit codes: 0 clean, 1 a failed verification, 2 wrong usage or input.
"""

import dataclasses
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
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
    count: int = 8
    """windows wanted"""
    seed: int = 0
    """of SUMO and of the choice of windows"""
    horizon: float = 8.0
    """length of a window [s]"""
    radius: float = 100.0
    """agents that never come closer to the ego are left out [m]"""


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
def attack(
    cases: Annotated[Path | None, Parameter(show_default=False)] = None,
    traffic: Traffic = Traffic(),
    *,
    planner: str = "idm",
    method: Literal["regents", "king", "focused"] = "regents",
    output: Annotated[Path, Parameter(["--output", "-o"])],
    search: Literal["joint", "per-candidate"] | None = None,
    background: Literal["log", "reactive"] | None = None,
    iterations: int = 500,
    batch: int = 32,
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
    method
        preset: king and regents as published; focused, our own, finds more crashes that mean something
    search
        one search over all candidates, or one for each of the nearest (every adversary found is a case)
    background
        do other agents replay their log, or brake for what stands in their way; default: the preset's
    output
        folder for the attacked cases
    iterations
        updates at most
    batch
        scenarios held on the device at once
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
    from regents_cosim.attacks.presets import METHODS
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.reports.tables import attack_row, summary
    from regents_cosim.suite import SuiteWriter, load_cases

    terminal = _terminal(talk)
    if (cases is None) == (traffic.config is None and traffic.net is None):
        raise RegentsError("expected either a folder of cases or traffic (-c NAME.sumocfg), not both")
    if compile_cache:
        keep_compiled_programs()
    suite = SuiteWriter(output, traffic.seed)
    scenarios = load_cases(cases) if cases else _record(traffic, sumo, executor, terminal)
    preset = METHODS[method]
    config = dataclasses.replace(
        preset,
        search=search or preset.search,
        background=background or preset.background,
        iterations=iterations,
    )
    attacked = []
    for results in terminal.each(run_attack_each(scenarios, config, planner, batch), "attacking", len(scenarios)):
        for scenario in results:
            suite.add(scenario)
        attacked += results
    replays = _verify(attacked, executor, terminal) if verify else {}
    if pictures:
        _draw_stills(attacked, output, terminal)
    rows = [attack_row(scenario, replays.get(scenario.id)) for scenario in attacked]
    terminal.show(f"{method} against {planner}: {len(rows)} cases in {output}", rows, summary(attacked, replays))
    return _exit_code(replays.values(), terminal)


@app.command
def replay(
    cases: Path,
    *,
    where: Annotated[Literal["sumo", "mirror"], Parameter("--in")] = "sumo",
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
        in SUMO, or in the mirror
    ego
        track: as in the case; planner: driven in closed loop by the planner (default where --planner is given)
    planner
        who drives the ego; default the planner that was attacked
    gui
        show it in sumo-gui
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
        replays = replay_each(scenarios, where, driven_by if ego != "track" else None, gui, pool)
        found = list(terminal.each(replays, f"replaying in {where}", len(scenarios)))
    if record and found[0].replayed:
        _draw(found[0].replayed, record, beside_original, terminal)
    rows = [replay_row(result) for result in found]
    terminal.show(f"replayed in {where}, the ego driven by {driven_by or 'its track'}", rows)
    return _exit_code(found, terminal)


@app.command
def evaluate(cases: Path, *, planner: str, compile_cache: bool = True, talk: Talk = Talk()) -> int:
    """How well a planner drives: route completion, collision rate and driving score, in the mirror.

    Parameters
    ----------
    cases
        a case or a folder of cases; attacked ones are driven among their adversaries
    planner
        system under test: aim-bev, idm, log_replay, constant_velocity, package.module:attribute or file.py:attribute
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.evaluation.driving import drive_each, driving_rows
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.suite import load_cases

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    scenarios = load_cases(cases)
    drives = list(terminal.each(drive_each(scenarios, planner), f"driving {planner}", len(scenarios)))
    terminal.show(f"{planner} on {len(drives)} cases", [dataclasses.asdict(row) for row in driving_rows(drives)])
    return 0


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
    planners: tuple[str, ...] = ("log_replay", "idm"),
    methods: tuple[Literal["king", "regents", "focused"], ...] = ("king", "regents", "focused"),
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
    planners
        systems under test
    methods
        presets
    compile_cache
        keep compiled programs on disk (folder: $REGENTS_CACHE)
    """
    from regents_cosim.attacks.attack import attack_each
    from regents_cosim.attacks.presets import METHODS
    from regents_cosim.evaluation.benchmark import success_row
    from regents_cosim.mirror.compile_cache import keep_compiled_programs

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    windows = [s for found in _bench_traffic(nets, count, seed, terminal).values() for s in found]
    rows = []
    for planner in planners:
        for method in methods:
            results = attack_each(windows, METHODS[method], planner)
            attacked = list(terminal.each(results, f"{method} against {planner}", len(windows)))
            replays = _verify([case for found in attacked for case in found], "local", terminal)
            rows.append(dataclasses.asdict(success_row(METHODS[method], planner, attacked, list(replays.values()))))
    terminal.show(f"attacks on {len(windows)} windows", rows)
    return 0


# --- pieces shared by the commands ------------------------------------------------------------


def _terminal(talk: Talk) -> "Terminal":
    from regents_cosim.terminal import Terminal

    return Terminal(talk.quiet, talk.json)


def _record(traffic: Traffic, sumo: tuple[str, ...], executor: str, terminal: "Terminal") -> "list[Scenario]":
    from regents_cosim.sources.record import record as run_record
    from regents_cosim.sources.sumo_config import SumoInput
    from regents_cosim.workers import executor_for

    if traffic.config is None and traffic.net is None:
        raise RegentsError("no traffic named (expected -c NAME.sumocfg, or -n NET with -r ROUTES or --fcd LOG)")
    source = SumoInput(
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
            count=traffic.count,
            seed=traffic.seed,
            horizon_s=traffic.horizon,
            radius_m=traffic.radius,
            executor=pool,
        )
    if len(found) < traffic.count:
        terminal.say(f"found {len(found)} of the {traffic.count} windows asked for: the traffic holds no more")
    return found


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
