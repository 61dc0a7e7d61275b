"""`regents bench table1`: the results table of the ReGentS paper, on any traffic."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from regents_cosim.cli.options import Count, CountOrZero, OutputOptions, ProgramOptions, Seed
from regents_cosim.cli.shared import open_terminal

Method = Literal["king", "regents", "focused", "random", "cma-es", "starts", "sumo-aggressive"]


def table1(
    *,
    count: Count = 34,
    seed: Seed = 0,
    nets: tuple[str, ...] = (),
    logs: tuple[Path, ...] = (),
    prefer: Literal["conflicts", "none"] = "conflicts",
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[Method, ...] = (),
    equal_protocol: bool = False,
    tuned_on: tuple[str, ...] = (),
    ceiling: tuple[Literal["king", "regents", "focused", "random", "cma-es"], ...] = (),
    ceiling_count: Count | None = None,
    as_published: bool = False,
    searches: tuple[Literal["joint", "per-candidate"], ...] = (),
    backgrounds: tuple[Literal["log", "reactive"], ...] = (),
    nearest: Count | None = None,
    adversaries: Literal["all", "one"] | None = None,
    accept: Literal["any", "clean", "telling"] | None = None,
    law: Literal["any", "strict"] | None = None,
    starts: CountOrZero | None = None,
    attempts: Count | None = None,
    patience: CountOrZero | None = None,
    replan_every: CountOrZero | None = None,
    output: Annotated[Path | None, Parameter(["--output", "-o"])] = None,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """The results table of the ReGentS paper on your own traffic, and what it does not measure.

    Every crash is judged and verified in SUMO, every pair of methods compared on the same windows.

    Parameters
    ----------
    count
        windows per network
    nets
        shipped networks, or .sumocfg files; all shipped ones by default
    logs
        logged traffic (files, or folders of them), `count` windows of each; in place of networks, or beside those that
        `nets` names
    prefer
        which egos come first: those whose path another vehicle can cross or join within the window, or any
    planners
        systems under test; log_replay is the open loop, in which the ego replays its track
    methods
        king and regents of the papers, focused (the three by default); random, cma-es, starts (a look at what
        focused begins with, and no search) and sumo-aggressive to compare with
    equal_protocol
        let king, regents, focused, random, cma-es and starts search by the rules of focused (per candidate, the same
        number of candidates, attempts and roll-outs, the same crashes accepted, the same reactions), beside king and
        regents as in their papers: what is left between them is due to the methods
    tuned_on
        places (names of networks or files; * stands for any letters) that had a say in a method: the others, which
        had none, are shown apart
    ceiling
        methods that try again, by the rules of focused with ten times the roll-outs, the windows in which no column
        has a telling crash
    ceiling_count
        such windows of each network or log that are tried again at most; all by default
    as_published
        do as the public ReGentS code where it departs from its paper (king and regents only)
    searches
        one search over all candidates, one for each of the nearest, or both; the preset's by default
    backgrounds
        others replay their log, or brake for what stands in their way, or both; the preset's by default
    nearest
        candidates that get a search of their own
    adversaries
        of these: all that succeed, or the first, which ends a window's search
    accept
        which collisions end a search: any, one that nothing spoils, or only one that a careful driver avoids as well
    law
        strict: adversaries keep to their own lanes and turns, to lights and to the speed limit
    starts
        drives on other ways, timed to meet the ego, that are tried for each candidate before it is searched
    attempts
        searches for each candidate, from another start each
    patience
        updates without progress after which a search ends; 0: it goes on to the last
    replan_every
        iterations between two closed loops of the planners
    output
        folder for table1.md, table1.json, table1.png and usual.png (telling crashes by how usual the adversary is), and
        for the runs: what is there already is not made again, so that a table that was interrupted goes on, and one of
        more places takes over those that it has
    """
    from regents_cosim.benchmarks.runs import TryAgain, columns, tables
    from regents_cosim.benchmarks.table1 import as_json, markdown, require_places, sections
    from regents_cosim.benchmarks.table1 import table1 as make_table
    from regents_cosim.benchmarks.traffic import logged_traffic, network_traffic

    given = {
        "as_published": as_published,
        "nearest": nearest,
        "adversaries": adversaries,
        "accept": accept,
        "law": law,
        "starts": starts,
        "attempts": attempts,
        "patience": patience,
        "replan_every": replan_every,
    }
    wanted = columns(methods, searches, backgrounds, equal_protocol, given)
    terminal = open_terminal(talk)
    programs.keep()
    networks = network_traffic(nets, count, seed, prefer, terminal) if nets or not logs else {}
    recordings = logged_traffic(logs, count, seed, prefer, terminal) if logs else {}
    places = [found for found in (*networks.values(), *recordings.values()) if found] or [[]]
    require_places([window for found in places for window in found], tuned_on)
    again = TryAgain(ceiling, ceiling_count)
    grown = tables(places, planners, wanted, tuned_on=tuned_on, again=again, output=output, progress=terminal)
    *_, found = make_table([]), *grown
    grids = [(part.title.lstrip("# "), part.rows()) for part in sections(found)]
    terminal.publish(markdown(found), as_json(found), grids)
    return 0
