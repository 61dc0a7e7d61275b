"""`regents bench`: a table of methods, of the simulators that show crashes, and of planners among others' crashes."""

import dataclasses
from pathlib import Path
from typing import Literal

from cyclopts import App

from regents_cosim.cli.options import (
    ActTimeout,
    Cases,
    Count,
    Networks,
    OutputIfAny,
    OutputOptions,
    PlannerOfCase,
    SearchRules,
    Seed,
)
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S


def table1(
    *,
    count: Count = 34,
    seed: tuple[Seed, ...] = (0,),
    nets: Networks = (),
    logs: tuple[Path, ...] = (),
    prefer: Literal["conflicts", "none"] = "conflicts",
    horizon: float = 8.0,
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[str, ...] = (),
    equal_protocol: bool = False,
    rules: SearchRules = SearchRules(),
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Make the results table of the ReGentS paper on your own traffic, with additional measures.

    Every crash is judged and verified in SUMO, and every pair of methods is compared on the same windows.

    Parameters
    ----------
    count
        windows per network and seed
    seed
        random seed of SUMO's traffic and of the choice of windows; several give several runs of traffic
    logs
        logged traffic (files, or folders of them), with --count windows of each; replaces the networks, or is added to
        those of --nets
    prefer
        which egos come first: conflicts: those whose path another vehicle can cross or join; none: no preference
    horizon
        length of a window [s]
    planners
        systems under test; log_replay is the open loop, in which the ego replays its track
    methods
        any that `attack --method` takes, by default king, regents and focused
    equal_protocol
        also run every method by the protocol of focused (per candidate, with the same candidates, attempts, roll-outs,
        accepted crashes and reactions), so that only cost and search differ; king and regents as in their papers stay
        in the table
    output
        folder for table1.md, table1.json and the runs. Finished runs are not repeated: an interrupted table continues,
        and a table of more places reuses the runs of a smaller one
    """
    from regents_cosim.benchmarks.runs import columns, tables, traffic_of
    from regents_cosim.benchmarks.table1 import table1 as make_table
    from regents_cosim.benchmarks.table1_sections import markdown, sections

    wanted = columns(methods, equal_protocol, vars(rules))
    terminal = open_terminal(talk)
    places = traffic_of(nets, logs, seed, terminal, count=count, prefer=prefer, horizon_s=horizon)
    grown = tables(places, planners, wanted, output=output, progress=terminal)
    *_, found = make_table([]), *grown
    grids = [(part.title.lstrip("# "), part.rows()) for part in sections(found)]
    terminal.publish(markdown(found), found.to_dict(), grids)
    return 0


bench = App(name="bench", help="Compare methods, simulators and planners.")
bench.command(table1)


@bench.command
def transfer(cases: Cases, *, planner: PlannerOfCase = None, talk: OutputOptions = OutputOptions()) -> int:
    """Measure whether the crashes of a folder of cases happen in SUMO (for cases recorded there) and in highway-env.

    SUMO runs twice: with all road users on their tracks, and with only the adversary on its track. The ego follows its
    track, or the planner that was attacked drives it. With --json every row also lists its cases.
    """
    from regents_cosim.benchmarks.transfer import PLACES
    from regents_cosim.benchmarks.transfer import transfer as run_transfer
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.reports.tables import TRANSFERRED, replay_row, traffic_row

    terminal = open_terminal(talk)
    rows = []
    for row, replays in terminal.each(run_transfer(load_suite(cases), PLACES, planner), "replaying", len(PLACES)):
        each = [replay_row(one) | traffic_row(one) | {"reason": one.reason} for one in replays]
        rows.append(dataclasses.asdict(row) | ({"replays": each} if talk.json else {}))
    terminal.show(f"transfer of {cases}", rows, essential=TRANSFERRED)
    return 0


@bench.command
def cross(
    cases: tuple[Cases, ...] = (),
    *,
    planners: tuple[str, ...] = (),
    method: Literal["king", "regents", "focused"] = "focused",
    count: Count = 8,
    seed: Seed = 0,
    nets: Networks = (),
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure whether adversaries found for one planner crash others.

    Windows in which a planner collides without an attack are left out for that planner.

    Parameters
    ----------
    cases
        folders of attacked cases, in place of attacks on networks
    planners
        systems under test; by default the planners that were attacked in the cases, if they come with the package
    method
        method of the attacks
    count
        windows per network
    seed
        random seed of SUMO and of the choice of windows
    """
    from regents_cosim.benchmarks.cross import attacked_for_each, by_attacked, cross_rows, planners_of
    from regents_cosim.benchmarks.runs import network_traffic
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.planners.under_test import PlannerUnderTest
    from regents_cosim.reports.tables import CROSSED

    terminal = open_terminal(talk)
    if cases:
        if nets:
            raise RegentsError("--nets makes attacks; cases that were attacked already stand alone")
        attacked = by_attacked(case for folder in cases for case in load_suite(folder))
        given = [PlannerUnderTest.of(one) for one in planners or planners_of(attacked)]
    elif len(planners) < 2:
        raise RegentsError("expected two or more --planners to attack, or folders of attacked cases")
    else:
        given = [PlannerUnderTest.of(one) for one in planners]
        traffic = network_traffic(nets, terminal, count=count, seed=seed)
        windows = [one for found in traffic.values() for one in found]
        attacked = attacked_for_each(windows, given, method, act_timeout_s=act_timeout, progress=terminal)
    with terminal.waiting("driving"):
        rows = cross_rows(attacked, given, act_timeout).to_dict()
    terminal.show("planners among adversaries that were found for others", rows, essential=CROSSED)
    return 0
