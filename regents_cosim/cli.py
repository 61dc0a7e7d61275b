"""The command line: options in, calls of the package, tables out. Nothing else lives here.

Heavy imports happen inside the commands, so that `--help` answers at once. What follows `--`
goes to SUMO. Exit codes: 0 clean, 1 a failed verification, 2 wrong usage or input.
"""

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.replay.verify import Verification
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
Compiled = Annotated[bool, Parameter(negative="--no-compile-cache")]


@app.command
def record(
    traffic: Traffic = Traffic(),  # noqa: B008  frozen
    *,
    output: Annotated[Path, Parameter(["--output", "-o"])],
    executor: str = "local",
    talk: Talk = Talk(),  # noqa: B008
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
    from regents_cosim.suite import SuiteWriter

    terminal = _terminal(talk)
    scenarios = _record(traffic, sumo, executor, terminal)
    suite = SuiteWriter(output, traffic.seed)
    for scenario in scenarios:
        suite.add(scenario)
    terminal.show(
        f"{len(scenarios)} cases in {output}",
        [
            {
                "case": s.id,
                "ego": s.ego.id,
                "agents": len(s.agents),
                "begin_s": s.provenance.begin_s,
                "horizon_s": round((s.tracks.steps - 1) * s.dt, 6),
                "overlaps": len(s.overlaps),
            }
            for s in scenarios
        ],
    )
    return 0


@app.command
def attack(
    cases: Annotated[Path | None, Parameter(show_default=False)] = None,
    traffic: Traffic = Traffic(),  # noqa: B008
    *,
    planner: str = "idm",
    method: Literal["regents", "king"] = "regents",
    output: Annotated[Path, Parameter(["--output", "-o"])],
    iterations: int = 500,
    batch: int = 32,
    executor: str = "local",
    verify: bool = True,
    pictures: bool = True,
    compile_cache: bool = True,
    talk: Talk = Talk(),  # noqa: B008
    sumo: SumoOptions = (),
) -> int:
    """Find how another road user could make the planner crash; verify every crash in SUMO.

    Parameters
    ----------
    cases
        a case or a folder of cases, as `regents record` makes them; or name traffic with -c
    planner
        system under test: idm, log_replay, constant_velocity, package.module:attribute or file.py:attribute
    method
        preset of the attack
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
    from regents_cosim.attack.attack import attack as run_attack
    from regents_cosim.attack.presets import METHODS
    from regents_cosim.mirror.compile_cache import keep_compiled_programs
    from regents_cosim.suite import SuiteWriter

    terminal = _terminal(talk)
    if compile_cache:
        keep_compiled_programs()
    suite = SuiteWriter(output, traffic.seed)
    scenarios = _cases_or_traffic(cases, traffic, sumo, executor, terminal)
    config = dataclasses.replace(METHODS[method], iterations=iterations)
    attacked = []
    for scenario in terminal.each(run_attack(scenarios, config, planner, batch), "attacking", len(scenarios)):
        suite.add(scenario)
        attacked.append(scenario)
    verified = _verify(attacked, executor, terminal) if verify else {}
    if pictures:
        _draw_stills(attacked, output, terminal)
    rows = [_attack_row(scenario, verified.get(scenario.id)) for scenario in attacked]
    terminal.show(f"{config.method} against {planner}: {len(rows)} cases in {output}", rows, _summary(attacked, verified))
    return _exit_code(verified.values())


@app.command
def replay(
    cases: Path,
    *,
    where: Annotated[Literal["sumo", "mirror"], Parameter("--in")] = "sumo",
    ego: Literal["track", "planner"] | None = None,
    planner: str | None = None,
    gui: bool = False,
    record: Path | None = None,
    executor: str = "local",
    talk: Talk = Talk(),  # noqa: B008
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
    executor
        where SUMO runs: local, or dask:ADDRESS
    """
    from regents_cosim.replay.replay import replay_each
    from regents_cosim.suite import load_cases

    terminal = _terminal(talk)
    scenarios = load_cases(cases)
    if (record or gui) and len(scenarios) > 1:
        raise RegentsError(f"{cases} holds {len(scenarios)} cases; --record and --gui show one, name its folder")
    driven_by = None
    if ego == "planner" or (ego is None and planner is not None):
        driven_by = planner or _attacked_planner(scenarios)
    jobs = replay_each(scenarios, where, driven_by, gui, _executor(executor), sumo)
    replays = list(terminal.each(jobs, f"replaying in {where}", len(scenarios)))
    if record:
        _record_picture(scenarios[0], replays[0], record, terminal)
    rows = [_replay_row(scenario, found) for scenario, found in zip(scenarios, replays, strict=True)]
    terminal.show(f"replayed in {where}, ego by {driven_by or 'its track'}", rows, _reasons(scenarios, replays))
    return _exit_code(replays)
