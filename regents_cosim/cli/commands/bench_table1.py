"""`regents bench table1`: the results table of the ReGentS paper, on any traffic."""

from pathlib import Path
from typing import Literal

from regents_cosim.cli.options import Count, Networks, OutputIfAny, OutputOptions, ProgramOptions, SearchRules, Seed
from regents_cosim.cli.shared import open_terminal

Method = Literal["king", "regents", "focused", "random", "cma-es", "starts", "sumo-aggressive"]


def table1(
    *,
    count: Count = 34,
    seed: Seed = 0,
    nets: Networks = (),
    logs: tuple[Path, ...] = (),
    prefer: Literal["conflicts", "none"] = "conflicts",
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[Method, ...] = (),
    equal_protocol: bool = False,
    tuned_on: tuple[str, ...] = (),
    ceiling: tuple[Literal["king", "regents", "focused", "random", "cma-es"], ...] = (),
    ceiling_count: Count | None = None,
    searches: tuple[Literal["joint", "per-candidate"], ...] = (),
    backgrounds: tuple[Literal["log", "reactive"], ...] = (),
    rules: SearchRules = SearchRules(),
    output: OutputIfAny = None,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """The results table of the ReGentS paper on your own traffic, and what it does not measure.

    Every crash is judged and verified in SUMO, every pair of methods compared on the same windows.

    Parameters
    ----------
    count
        windows per network
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
        places (names of networks or files; * stands for any letters) that a method was tuned on: the others, which
        were held out, are shown apart
    ceiling
        methods that try again, by the rules of focused with ten times the roll-outs, the windows in which no column
        has a telling crash
    ceiling_count
        such windows of each network or log that are tried again at most; all by default
    searches
        one search over all candidates, one for each of the nearest, or both; the preset's by default
    backgrounds
        others replay their log, or brake for what stands in their way, or both; the preset's by default
    output
        folder for table1.md, table1.json, table1.png and usual.png (telling crashes by how usual the adversary is), and
        for the runs: what is there already is not made again, so that a table that was interrupted goes on, and one of
        more places takes over those that it has
    """
    from regents_cosim.benchmarks.runs import TryAgain, columns, tables
    from regents_cosim.benchmarks.table1 import as_json, require_places
    from regents_cosim.benchmarks.table1 import table1 as make_table
    from regents_cosim.benchmarks.table1_sections import markdown, sections
    from regents_cosim.benchmarks.traffic import traffic_of

    wanted = columns(methods, searches, backgrounds, equal_protocol, vars(rules))
    terminal = open_terminal(talk)
    programs.keep()
    places = traffic_of(nets, logs, count, seed, prefer, terminal)
    require_places([window for found in places for window in found], tuned_on)
    again = TryAgain(ceiling, ceiling_count)
    grown = tables(places, planners, wanted, tuned_on=tuned_on, again=again, output=output, progress=terminal)
    *_, found = make_table([]), *grown
    grids = [(part.title.lstrip("# "), part.rows()) for part in sections(found)]
    terminal.publish(markdown(found), as_json(found), grids)
    return 0
