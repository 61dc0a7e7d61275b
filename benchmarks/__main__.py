"""The commands behind our tables and pictures: `python -m benchmarks COMMAND --help`, from the top of a checkout."""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from cyclopts import App

from regents_cosim.cli.application import app as regents
from regents_cosim.cli.options import (
    ActTimeout,
    Cases,
    Count,
    Networks,
    Output,
    OutputIfAny,
    OutputOptions,
    PlannerName,
    Seed,
)
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S

app = App(
    name="python -m benchmarks",
    help="Measure, and draw, what the documentation shows.",
    help_format="plaintext",
    default_parameter=regents.default_parameter,
)


@app.command
def reconstruction(
    *, count: Count = 20, seed: Seed = 0, nets: Networks = (), talk: OutputOptions = OutputOptions()
) -> int:
    """Measure how well the mirror's controls reproduce SUMO's tracks, per network.

    Parameters
    ----------
    count
        windows per network
    """
    from benchmarks.reconstruction import reconstruction_row
    from regents_cosim.benchmarks.runs import network_traffic

    terminal = open_terminal(talk)
    traffic = network_traffic(nets, terminal, count=count, seed=seed)
    rows = [
        dataclasses.asdict(reconstruction_row(net, scenarios))
        for net, scenarios in terminal.each(traffic.items(), "fitting", len(traffic))
    ]
    terminal.show("position error of roll-outs against the recorded tracks", rows)
    return 0


@app.command
def replan(
    *,
    planner: PlannerName,
    count: Count = 9,
    seed: Seed = 0,
    nets: Networks = (),
    every: tuple[int, ...] = (1, 10),
    method: Literal["king", "regents"] = "regents",
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure what changes, and how much time is saved, if the planner drives only in every k-th iteration.

    Parameters
    ----------
    count
        windows per network
    every
        values of the setting `replan_every`; the others are compared with the first
    method
        preset
    """
    from benchmarks.replanning import replan_rows
    from regents_cosim.benchmarks.runs import network_traffic

    terminal = open_terminal(talk)
    traffic = network_traffic(nets, terminal, count=count, seed=seed)
    windows = [scenario for found in traffic.values() for scenario in found]
    rows = replan_rows(windows, planner, every, method, act_timeout_s=act_timeout, progress=terminal)
    terminal.show(f"{planner} on {len(windows)} windows", [dataclasses.asdict(row) for row in rows])
    return 0


@app.command
def logs(
    paths: tuple[Path, ...],
    *,
    count: Count = 8,
    seed: Seed = 0,
    attack: bool = False,
    planner: PlannerName = "idm",
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure how well logs are read: vehicles on the road, error of the smooth fit, time. Or attack their windows.

    Parameters
    ----------
    paths
        logs, or folders of them
    count
        most windows per scene; where the log names an ego, others are drawn for those that remain
    seed
        of the egos that are drawn
    attack
        attack the windows with focused, and count per format which crashes are telling and why the others are not
    output
        folder for the runs of an attack; finished ones are not repeated
    """
    from benchmarks.log_benchmark import CRASHES, crash_rows, log_rows, logged_windows

    terminal = open_terminal(talk)
    if attack:
        with terminal.waiting("reading"):
            windows = logged_windows(paths, count, seed)
        rows = [dataclasses.asdict(row) for row in crash_rows(windows, planner, output, terminal)]
        terminal.show(f"windows of logs, attacked against {planner}", rows, essential=CRASHES)
        return 0
    with terminal.waiting("reading and fitting"):
        rows = [dataclasses.asdict(row) for row in log_rows(list(paths), count)]
    terminal.show("logged traffic, per format", rows)
    return 0


@app.command
def highway(
    *,
    count: Count = 25,
    seed: Seed = 0,
    envs: tuple[str, ...] = ("merge-v1", "roundabout-v1", "intersection-v2", "highway-v0"),
    policy: str = "idm",
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[Literal["king", "regents", "focused"], ...] = ("king", "regents"),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure how often attacks on highway-env's own traffic succeed, and whether highway-env reproduces the crashes.

    Parameters
    ----------
    count
        windows per environment
    envs
        environments of highway-env
    policy
        driver of the ego in the recordings
    planners
        systems under test
    methods
        presets
    """
    from benchmarks.highway import IN_HIGHWAY, highway_rows
    from regents_cosim.sources.record import record as run_record

    terminal = open_terminal(talk)
    windows = {
        env: run_record(f"highway:{env}", policy=policy, count=count, seed=seed)
        for env in terminal.each(envs, "recording traffic", len(envs))
    }
    rows = [dataclasses.asdict(row) for row in highway_rows(windows, planners, methods, terminal)]
    title = f"attacks on {sum(map(len, windows.values()))} windows, replayed in highway-env"
    terminal.show(title, rows, essential=IN_HIGHWAY)
    return 0


@app.command
def live(
    cases: Cases,
    *,
    planner: PlannerName = "idm",
    expected: str = "",
    method: Literal["focused-live", "regents-live", "king-live"] = "focused-live",
    crashes: bool = False,
    recorded: bool = False,
    seed: Seed = 0,
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure how often an adversary that plans from scratch crashes the planner in SUMO's live traffic.

    Each window begins as the case did before its attack. From there the planner drives the ego and SUMO all others,
    once without and once with an attack.

    Parameters
    ----------
    cases
        a case or a folder of cases recorded in SUMO; shipped:standard, shipped:quickstart and shipped:on_foot come with
        the package
    expected
        planner that predicts the ego, if it is not the one that drives; observed: an ego that keeps to its route at its
        recent speed and brakes for leaders
    method
        preset of the search
    crashes
        only use cases that are crashes
    recorded
        the adversary begins as recorded in the crash, and plans again during the run
    seed
        random seed of SUMO in the first window; it increases by one from window to window
    output
        folder for the crashes
    """
    from benchmarks.live_windows import LIVE_WINDOWS, drive_windows, live_rows
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.evaluation.crashes.scores import is_crash
    from regents_cosim.live.settings import live_config
    from regents_cosim.saving import SuiteWriter

    terminal = open_terminal(talk)
    found = [case for case in load_suite(cases) if case.road.sumo_net and (is_crash(case) or not (crashes or recorded))]
    require(bool(found), f"{cases}: no such case that was recorded in SUMO", RegentsError)
    writer = None if output is None else SuiteWriter(output, seed)
    ends = drive_windows(found, planner, expected, live_config(method), seed, recorded, terminal)
    for case, (_, attacked) in zip(found, ends, strict=True):
        for line in [str(attacked)] if isinstance(attacked, RegentsError) else attacked.told:
            terminal.say(f"{case.id}: {line}")
        if writer is not None and not isinstance(attacked, RegentsError) and attacked.case is not None:
            writer.add(attacked.case)
    rows = [dataclasses.asdict(row) for row in live_rows(found, ends)]
    terminal.show(f"{method} against {planner} in {len(found)} windows that go on live", rows, essential=LIVE_WINDOWS)
    return 0


@app.command
def gallery(
    *,
    output: Output,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Draw the figures of the ReGentS paper: gradients around the ego, and how KING fails.

    Parameters
    ----------
    output
        folder for the pictures, their page README.md, and the cases behind them
    """
    from benchmarks.gallery.make import make_gallery
    from regents_cosim.reports.tables import ATTACKED, attack_row

    terminal = open_terminal(talk)
    with terminal.waiting("making the gallery"):
        attacked = make_gallery(output)
    rows = [attack_row(scenario, None) for scenario in attacked]
    note = f"pictures and what they show: {output / 'README.md'}"
    terminal.show(f"{len(rows)} attacked scenes", rows, note, ATTACKED)
    return 0


@app.command
def ceiling(
    *,
    planner: PlannerName = "idm",
    methods: tuple[Literal["king", "regents", "focused"], ...] = ("king", "regents", "focused"),
    again: tuple[Literal["king", "regents", "focused", "random", "cma-es"], ...] = ("focused",),
    again_count: Count | None = None,
    count: Count = 34,
    seed: Seed = 0,
    nets: Networks = (),
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Count the windows that hold a telling crash: found by any method, or with ten times the roll-outs.

    Parameters
    ----------
    methods
        presets that search first
    again
        methods that try again, by the rules of focused with ten times the roll-outs, where none of the first found one
    again_count
        such windows of each network that are tried again at most; all by default
    count
        windows per network
    output
        folder for the runs; finished ones are not repeated
    """
    from benchmarks.ceiling import ceiling as found_of
    from benchmarks.ceiling import runs_again
    from regents_cosim.benchmarks.runs import columns, network_traffic, places_run
    from regents_cosim.planners.under_test import PlannerUnderTest

    terminal = open_terminal(talk)
    places, given = [*network_traffic(nets, terminal, count=count, seed=seed).values()], PlannerUnderTest.of(planner)
    *_, runs = places_run(places, given, columns(methods, False, {}), output, terminal)
    more = list(runs_again(places, given, again, runs, again_count, output, terminal))
    row = dataclasses.asdict(found_of(given.name, "all", runs, more))
    terminal.show(f"windows in which a telling or a flawless crash of {planner} is known", [row])
    return 0


@app.command
def false_alarms(
    *,
    count: Count = 40,
    seed: Seed = 0,
    nets: Networks = (),
    crashes: tuple[Path, ...] = (),
    ahead_s: tuple[float, ...] = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure how often the careful driver brakes where nothing happens, and how many crashes it prevents.

    The windows are taken by chance. `focused` prefers crashes that the driver prevents with the foresight of the
    package; other methods do not know it.

    Parameters
    ----------
    count
        windows per network
    crashes
        folders of attacked cases; counted are clean crashes whose adversaries do not break the law grossly
    ahead_s
        how far ahead the driver looks [s]; a row for each
    """
    from benchmarks.false_alarms import foresight_rows
    from regents_cosim.benchmarks.runs import network_traffic
    from regents_cosim.cases.suite import load_suite

    terminal = open_terminal(talk)
    places = network_traffic(nets, terminal, count=count, seed=seed, prefer="none")
    windows = [window for found in places.values() for window in found]
    attacked = [case for folder in crashes for case in load_suite(folder)]
    rows = [dataclasses.asdict(row) for row in foresight_rows(windows, attacked, ahead_s)]
    terminal.show(f"the careful driver in {len(windows)} windows without an attack", rows)
    return 0


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    try:
        return app(list(arguments), result_action="return_value")
    except RegentsError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
